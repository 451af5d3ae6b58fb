# SPDX-License-Identifier: Apache-2.0
"""A drive through a simulated world, recorded with its exact truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pilotage import Camera, StereoRig, Transform
from pilotage.errors import InputError
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.simulation import Drive, Simulation
from pilotage.simulation.body import Pose2
from pilotage.simulation.camera_faults import written_rig
from pilotage.simulation.camera_group import CameraGroup
from pilotage.simulation.scene import yaw_quaternion
from pilotage.simulation.sensor import Sensor

# The rover paper's camera at its full width; smaller pictures see the same.
FULL_WIDTH_PX, FULL_FOCAL_PX = 1280, 855.0
DISTORTION = [-0.12, 0.03, 0.0003, -0.0002, 0.0]
LEFT, RIGHT = "front_left", "front_right"
Encoding = Literal["mono8", "bgr8"]


@dataclass(frozen=True)
class Recorded:
    """What a simulated drive came to."""

    pairs: int
    length_m: float
    duration_s: float
    has_arrived: bool


def rover_rig(simulation: Simulation, width_px: int) -> StereoRig:
    """Return the rover's forward pair at that width (4:3), placed as in the world's body."""
    if not 160 <= width_px <= FULL_WIDTH_PX or width_px % 16:
        raise InputError(f"width {width_px} px: must be a multiple of 16 from 160 to 1280")
    focal_px, height_px = FULL_FOCAL_PX * width_px / FULL_WIDTH_PX, width_px * 3 // 4
    left, right = (
        Camera(
            width_px=width_px,
            height_px=height_px,
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(width_px - 1) / 2 + shift,
            cy_px=(height_px - 1) / 2 - shift,
            distortion="brown",
            coefficients=DISTORTION,
        )
        for shift in (1.5, -2.0)
    )
    robot_from_world = simulation.robot_pose().inverse()
    world_from_left = simulation.camera_pose(LEFT)
    return StereoRig(
        left=left,
        right=right,
        right_from_left=simulation.camera_pose(RIGHT).inverse() @ world_from_left,
        robot_from_left=robot_from_world @ world_from_left,
    )


def record_drive(  # noqa: PLR0913, what a recording is made of
    *,
    simulation: Simulation,
    drive: Drive,
    out: Path,
    width_px: int,
    rate_hz: float,
    sensor: Sensor,
    on_pair: Callable[[int, float], None],
) -> Recorded:
    """Drive, and write pictures, odometry and truth to the MCAP file `out`.

    on_pair(pairs so far, part of the path done) is called after each pair. Raises RunError when the
    file cannot be written or the physics breaks down; what was written stays in `<out>.part`.
    """
    if not 0.5 <= rate_hz <= 60:
        raise InputError(f"rate {rate_hz:g} Hz: must lie from 0.5 to 60")
    rig = rover_rig(simulation, width_px)
    recorder = _Recorder(simulation, rig, sensor, seed=simulation.world.seed)
    period_ns, next_ns, length_m = round(1e9 / rate_hz), simulation.time_ns, 0.0
    before = simulation.robot_pose().translation_m
    with McapWriter(out) as writer:
        written = written_rig(rig, simulation.faults, "front")
        writer.add_rig(written, timestamp_ns=simulation.time_ns)
        for time_ns in drive:
            here = simulation.robot_pose().translation_m
            length_m += float(np.linalg.norm(here - before))
            before = here
            if time_ns >= next_ns:
                recorder.write(writer)
                next_ns += period_ns
                on_pair(recorder.pairs, drive.progress_m / drive.path.length_m)
    return Recorded(recorder.pairs, length_m, simulation.time_ns * 1e-9, drive.has_arrived)


class _Recorder:
    """Takes the pair of the present moment and writes what comes of it."""

    def __init__(
        self, simulation: Simulation, rig: StereoRig, sensor: Sensor, *, seed: int
    ) -> None:
        self._simulation = simulation
        cameras = {LEFT: rig.left, RIGHT: rig.right}
        self._group = CameraGroup(simulation, cameras, sensor, seed=seed)
        self._encoding: Encoding = "bgr8" if sensor.channels == 3 else "mono8"
        self.pairs = 0

    def write(self, writer: McapWriter) -> None:
        now_ns = self._simulation.time_ns
        shot = self._group.take()
        odometry = _planar(self._simulation.body.odometry)
        writer.write_odometry(timestamp_ns=now_ns, odom_from_robot=odometry)
        if shot is None:
            return
        for name, picture in shot.pictures.items():
            stamp_ns = shot.stamps_ns[name]
            writer.write_picture(
                name, timestamp_ns=stamp_ns, picture=picture, encoding=self._encoding
            )
        # The truth is of the moment the pictures show, whatever their stamps say.
        truth = self._simulation.robot_pose(shot.taken_ns)
        writer.write_truth(timestamp_ns=shot.taken_ns, world_from_body=truth)
        self.pairs += len(shot.pictures) == 2


def _planar(pose: Pose2) -> Transform:
    return Transform(translation_m=[pose[0], pose[1], 0.0], quaternion_wxyz=yaw_quaternion(pose[2]))
