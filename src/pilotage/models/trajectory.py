# SPDX-License-Identifier: Apache-2.0
"""The poses of a reconstruction as a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pilotage.atomic_files import write_atomically
from pilotage.models.model import Model
from pilotage.pose_files import PoseRecord, tum_line


def write_tum(
    path: Path, model: Model, timestamps_ns: Sequence[int], *, camera: int | None = None
) -> None:
    """Write `world_from_camera` of each registered picture in TUM's format, in order of time.

    `timestamps_ns` has one for each of `model.names`; ValueError otherwise. Of a `camera`, an index
    into `model.cameras`, its pictures alone. RunError when the file cannot be written.
    """
    rows = [
        (timestamp_ns, pose)
        for timestamp_ns, pose, taken_by in zip(
            timestamps_ns, model.camera_from_world, model.camera_index.tolist(), strict=True
        )
        if camera in {None, taken_by}
    ]
    lines = []
    for i, (timestamp_ns, camera_from_world) in enumerate(sorted(rows, key=lambda row: row[0])):
        pose = camera_from_world.inverse()
        x, y, z = (float(value) for value in pose.translation_m)
        qw, qx, qy, qz = (float(value) for value in pose.quaternion_wxyz)
        lines.append(tum_line(PoseRecord(i, timestamp_ns, "", "", (x, y, z), (qw, qx, qy, qz))))
    write_atomically(path, "".join(lines))
