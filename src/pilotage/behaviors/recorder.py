# SPDX-License-Identifier: Apache-2.0
"""What a simulated robot sees, believes and truly does, written into a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pilotage import Transform
from pilotage.recordings.mcap_writer import ROBOT, McapWriter
from pilotage.simulation import Simulation
from pilotage.simulation.camera_group import CameraGroup

ODOM = "odom"
LATEST_NS = 150_000_000  # no picture was taken longer before it is there; poses are kept for longer


@dataclass(frozen=True, kw_only=True)
class Moment:
    """How far a recording is: `shots` are pairs, or pictures of single cameras."""

    time_ns: int
    shots: int
    share_done: float
    world_from_robot: Transform


class Recorder:
    """Writes what groups of cameras see, with the robot's odometry and the truth.

    Truth waits until no picture can be older, for its messages rise in time; `finish` comes last.
    """

    def __init__(
        self, simulation: Simulation, groups: Mapping[str, CameraGroup], writer: McapWriter
    ) -> None:
        self.shots = 0
        self._simulation = simulation
        self._groups = groups
        self._writer = writer
        self._truth_ns: set[int] = set()
        self._newest_note_ns = -1

    def shoot(self, ended_ns: int | None = None) -> None:
        """Let every camera take its picture, now or at a time of the last 0.2 s.

        The truth of that time goes with it. `shots` counts those of which a group came whole.
        """
        is_whole = False
        for group in self._groups.values():
            shot = group.take(ended_ns)
            if shot is None:
                continue
            is_whole |= len(shot.pictures) == len(shot.stamps_ns)
            # Of the moment the pictures show, whatever their stamps say.
            self._truth_ns.add(shot.taken_ns)
            for name, picture in shot.pictures.items():
                self._writer.write_picture(
                    name,
                    timestamp_ns=shot.stamps_ns[name],
                    picture=picture,
                    encoding="mono8" if picture.ndim == 2 else "bgr8",
                )
        self.shots += is_whole

    def note(self) -> None:
        """Write odometry, moving frames and truth of now, once for each time."""
        now_ns, body = self._simulation.time_ns, self._simulation.body
        if now_ns <= self._newest_note_ns:
            return
        self._newest_note_ns = now_ns
        odom_from_robot = body.odometry.at_height()
        forward, left, turn = body.motion
        self._writer.write_odometry(
            timestamp_ns=now_ns,
            odom_from_robot=odom_from_robot,
            twist=(forward, left, 0.0, 0.0, 0.0, turn),
        )
        moving = {(ODOM, ROBOT): odom_from_robot, **self._moving_frames()}
        self._writer.write_transforms(moving, timestamp_ns=now_ns)
        self._truth_ns.add(now_ns)
        self._write_truth(now_ns - LATEST_NS)

    def finish(self) -> None:
        """Write what was still waited for."""
        self._write_truth(self._simulation.time_ns)

    def _moving_frames(self) -> dict[tuple[str, str], Transform]:
        """Return how the robot believes its own parts sit on each other, by (parent, child)."""
        return {}

    def _write_truth(self, until_ns: int) -> None:
        for time_ns in sorted(time_ns for time_ns in self._truth_ns if time_ns <= until_ns):
            self._truth_ns.remove(time_ns)
            self._write_truth_of(time_ns)

    def _write_truth_of(self, time_ns: int) -> None:
        pose = self._simulation.robot_pose(time_ns)
        self._writer.write_truth(timestamp_ns=time_ns, world_from_body=pose)
