# SPDX-License-Identifier: Apache-2.0
"""What a robot said of its own motion while it recorded: odometry, and angles of its joints."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError

Times = NDArray[np.int64]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class FramePoses:
    """Poses (N, 4, 4) of one frame in another, metres, at `timestamps_ns` (N,)."""

    timestamps_ns: Times
    poses: Array


@dataclass(frozen=True)
class OdometryPoses:
    """The robot's own dead reckoning, with all its slip, at `timestamps_ns` (N,), rising.

    `odom_from_robot` (N, 4, 4), metres; `covariances` (N, 6, 6) of x y z rx ry rz, all zero where
    the robot does not tell; `twists` (N, 6) in the robot's axes, m/s and rad/s.
    """

    timestamps_ns: Times
    odom_from_robot: Array
    covariances: Array
    twists: Array


@dataclass(frozen=True)
class JointAngles:
    """Angles (N, J), rad, of the joints `names` at `timestamps_ns` (N,), rising.

    NaN where a joint was not told of at that time.
    """

    timestamps_ns: Times
    names: tuple[str, ...]
    positions_rad: Array

    def of(self, name: str) -> Array:
        """Return the angles (N,) of one joint, rad; InputError where there is none such."""
        if name not in self.names:
            raise InputError(f"joint {name!r}: not recorded; there are: {', '.join(self.names)}")
        return np.asarray(self.positions_rad[:, self.names.index(name)])


def read_odometry(path: str | Path, *, topic: str | None = None) -> OdometryPoses | None:
    """Return the robot's own odometry of a recording, None where it holds none.

    Of MCAP files it is on /odom, else the only Odometry, or on `topic`. InputError where the
    recording is broken, or several topics could be meant.
    """
    from pilotage.recordings import mcap_motion, ros_messages
    from pilotage.recordings.mcap_index import read_index
    from pilotage.recordings.mcap_writer import ODOMETRY_TOPIC

    file = find_mcap(path)
    if file is None:
        return None
    topics = read_index(file)
    found = mcap_motion.find_topic(topics, ros_messages.ODOMETRY, ODOMETRY_TOPIC, topic, file)
    return None if found is None else mcap_motion.read_odometry(file, found)


def read_joints(path: str | Path, *, topic: str | None = None) -> JointAngles | None:
    """Return the joint angles of a recording, None where it holds none.

    Of MCAP files they are on /joint_states, else the only JointState, or on `topic`. InputError
    where the recording is broken, or several topics could be meant.
    """
    from pilotage.recordings import mcap_motion, ros_messages
    from pilotage.recordings.mcap_index import read_index
    from pilotage.recordings.mcap_writer import JOINTS_TOPIC

    file = find_mcap(path)
    if file is None:
        return None
    topics = read_index(file)
    found = mcap_motion.find_topic(topics, ros_messages.JOINTS, JOINTS_TOPIC, topic, file)
    return None if found is None else mcap_motion.read_joints(file, found)


def nearest(times_ns: Times, time_ns: int, *, within_ns: int) -> int | None:
    """Return the index of the time nearest to `time_ns`, None where it is not that near."""
    after = int(np.searchsorted(times_ns, time_ns))
    indices = [i for i in (after - 1, after) if 0 <= i < len(times_ns)]
    apart = [(abs(int(times_ns[i]) - time_ns), i) for i in indices]
    if not apart or min(apart)[0] > within_ns:
        return None
    return min(apart)[1]


def find_mcap(path: str | Path) -> Path | None:
    """Return the MCAP file of a recording, None where it is of another format.

    InputError where it does not exist or was never finished.
    """
    from pilotage.recordings.mcap_index import find_file, is_mcap

    source = Path(path)
    try:
        if not source.exists():
            raise InputError(f"{source}: does not exist; check the path")
        return find_file(source) if is_mcap(source) else None
    except (OSError, ValueError) as error:  # no permission, a zero byte in a name
        raise InputError(f"{str(source)!r}: cannot be read ({error}); check the path") from error
