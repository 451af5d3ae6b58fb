# SPDX-License-Identifier: Apache-2.0
"""What a recording tells of a walk with stops: its pictures, by joints and steps where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.behaviors.stops import YAW, standing_runs
from pilotage.calibration.nao_head import (
    JOINT_SIGMA_RAD,
    SEAT_SIGMA_M,
    SEAT_SIGMA_RAD,
    seat_covariance,
)
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame
from pilotage.recordings.single import PictureRecording, SinglePicture

if TYPE_CHECKING:
    from pilotage import Camera, MarkAccount, StepAccount, WalkAccount

# How much a walk of two legs errs, and the floor it walks on: metres and radians, then their growth
# with the way (m) and the turn (rad). A tenth of the way is what the second paper's robot errs; the
# sides of it are the simulator's (simulation/gait.py).
PLACE_SIGMA_M, PLACE_GROWTH = 0.01, 0.1
YAW_SIGMA_RAD, YAW_GROWTH_RAD_M, YAW_GROWTH = 0.02, 0.2, 0.1
HEIGHT_SIGMA_M, TILT_SIGMA_RAD = 0.01, 0.02


@dataclass(frozen=True, kw_only=True)
class RecordedWalk:
    """Pictures of a robot that stands, by stop, and what it tells of them.

    `cameras` are those of `camera_names`; `moving` pictures were taken on the way and are left
    out, `bad` could not be read.
    """

    recording: PictureRecording
    camera_names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    pictures: tuple[SinglePicture, ...]
    stop_of_picture: tuple[int, ...]
    moving: int
    bad: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Return a file name for each picture: stop, number and camera."""
        return tuple(
            f"stop{stop:03d}_{number:04d}_{picture.camera}.png"
            for number, (stop, picture) in enumerate(
                zip(self.stop_of_picture, self.pictures, strict=True)
            )
        )

    @property
    def firsts(self) -> tuple[SinglePicture, ...]:
        """Return the first picture of each stop."""
        stops = self.stop_of_picture
        return tuple(p for i, p in enumerate(self.pictures) if i == 0 or stops[i] > stops[i - 1])

    def account(self, marks: MarkAccount | None = None) -> WalkAccount:
        """Return what joints and steps tell, and marks of a known size where there are any."""
        from pilotage import _core

        odometry = [first.odom_from_robot for first in self.firsts]
        return _core.WalkAccount(
            stop_of_picture=list(self.stop_of_picture),
            stop_from_camera=[_seat(picture) for picture in self.pictures],
            joint_covariances=[_joint_covariance(picture) for picture in self.pictures],
            steps=[None, *(_step(a, b) for a, b in pairwise(odometry))],
            marks=marks or _core.MarkAccount(sightings=[], side_m=1.0, side_sigma_m=0.0),
        )


def read_walk(recording: PictureRecording) -> RecordedWalk:
    """Return the pictures of a recording that were taken standing, by stop.

    InputError where there are none, or where the recording does not tell where its cameras are on
    the robot and whether it stood.
    """
    names = tuple(recording.cameras)
    counted = _Counted(recording)
    standing: list[SinglePicture] = []
    stops: list[int] = []
    for number, (run, _) in enumerate(standing_runs(counted.pictures())):
        standing += run
        stops += [number] * len(run)
    _check(recording, standing, counted)
    if stops[-1] == 0:
        raise InputError(
            f"{recording.path}: the robot stood in one place only ({counted.moving} pictures were"
            " taken on the way); a walk has two stops or more, pilotage mosaic joins what one stop"
            " shows, pilotage localize follows stereo pairs on the way"
        )
    return RecordedWalk(
        recording=recording,
        camera_names=names,
        cameras=tuple(recording.cameras[name] for name in names),
        pictures=tuple(standing),
        stop_of_picture=tuple(stops),
        moving=counted.moving,
        bad=tuple(counted.bad),
    )


class _Counted:
    """A recording's pictures, and how many of them are of no use."""

    def __init__(self, recording: PictureRecording) -> None:
        self._recording = recording
        self.moving = 0
        self.bad: list[str] = []

    def pictures(self) -> Iterator[SinglePicture | BadFrame]:
        """Yield the pictures, counting."""
        for picture in self._recording.pictures():
            if isinstance(picture, BadFrame):
                self.bad.append(picture.reason)
            else:
                self.moving += bool(picture.is_moving)
            yield picture


def _check(
    recording: PictureRecording, standing: Sequence[SinglePicture], counted: _Counted
) -> None:
    if not standing and counted.moving:
        raise InputError(
            f"{recording.path}: all {counted.moving} pictures were taken on the way; a walk with"
            " stops is wanted, pilotage localize follows stereo pairs on the way"
        )
    if not standing:
        said = counted.bad[0] if counted.bad else "it is empty"
        raise InputError(f"{recording.path}: holds no picture that can be read: {said}")
    for picture in standing:
        where = f"{recording.path}: {picture.camera} at {picture.timestamp_ns} ns"
        if picture.robot_from_camera is None:
            raise InputError(
                f"{where}: not told where it is on the robot (/tf, /tf_static); reconstruct its"
                " pictures from a folder instead"
            )
        if picture.odom_from_robot is None:
            raise InputError(
                f"{where}: no odometry (/odom) tells where the robot stood; reconstruct its"
                " pictures from a folder instead"
            )


def _turn_of(step: Transform) -> float:
    w, *vector = step.quaternion_wxyz
    return 2 * math.atan2(float(np.linalg.norm(vector)), abs(w))


def _seat(picture: SinglePicture) -> Transform:
    assert picture.robot_from_camera is not None  # read_walk has checked
    return picture.robot_from_camera


def _joint_covariance(picture: SinglePicture) -> NDArray[np.float64]:
    torso_from_camera, joints = picture.torso_from_camera, picture.joints_rad
    if torso_from_camera is not None and YAW in joints:
        return seat_covariance(_seat(picture), torso_from_camera, joints[YAW])
    turn_sigma = math.hypot(JOINT_SIGMA_RAD, SEAT_SIGMA_RAD)
    return np.diag([SEAT_SIGMA_M**2] * 3 + [turn_sigma**2] * 3)


def _step(a: Transform | None, b: Transform | None) -> StepAccount | None:
    from pilotage import _core

    if a is None or b is None:
        return None
    step = a.inverse() @ b
    way_m = float(np.linalg.norm(step.translation_m))
    place_m = PLACE_SIGMA_M + PLACE_GROWTH * way_m
    yaw_rad = YAW_SIGMA_RAD + YAW_GROWTH_RAD_M * way_m + YAW_GROWTH * _turn_of(step)
    sigmas = [place_m, place_m, HEIGHT_SIGMA_M, TILT_SIGMA_RAD, TILT_SIGMA_RAD, yaw_rad]
    return _core.StepAccount(previous_from_stop=step, covariance=np.diag(np.square(sigmas)))
