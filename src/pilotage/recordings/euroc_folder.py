# SPDX-License-Identifier: Apache-2.0
"""EuRoC (ASL) folders, written: mav0 with cam0, cam1 and the truth of the body."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.rig import READOUT
from pilotage.errors import InputError
from pilotage.recordings.folder_files import transform_of_pose, words, write_png
from pilotage.recordings.frames import StereoFrame, Truth

LENSES = {
    "none": "radial-tangential",
    "brown": "radial-tangential",
    "kannala_brandt": "equidistant",
}
TRUTH_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m],"
    " q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
)


def write_euroc(
    rig: StereoRig, pairs: Iterator[StereoFrame], truth: Truth | None, folder: Path
) -> list[str]:
    """Write into an empty folder; return what the format could not hold.

    The body is the robot where the rig knows one, the left camera otherwise.
    """
    body_from_left = rig.robot_from_left or Transform()
    body_from_right = body_from_left @ rig.right_from_left.inverse()
    cameras = (("cam0", rig.left, body_from_left), ("cam1", rig.right, body_from_right))
    for name, camera, body_from_camera in cameras:
        (folder / "mav0" / name / "data").mkdir(parents=True)
        text = _sensor_text(camera, body_from_camera)
        text += f"{READOUT}: {rig.readout_s!r}\n" if rig.readout_s else ""
        (folder / "mav0" / name / "sensor.yaml").write_text(text)
    times_ns = _write_pictures(pairs, folder / "mav0")
    table = "#timestamp [ns],filename\n" + "".join(f"{t},{t}.png\n" for t in times_ns)
    for name in ("cam0", "cam1"):
        (folder / "mav0" / name / "data.csv").write_text(table)
    if truth is not None:
        _write_truth(truth, body_from_left, folder / "mav0" / "state_groundtruth_estimate0")
    if rig.robot_from_left is None:
        return []
    return ["EuRoC knows a body and no robot: the robot is that body, its pose T_BS of cam0"]


def _write_pictures(pairs: Iterator[StereoFrame], root: Path) -> list[int]:
    times_ns = []
    for pair in pairs:
        if pair.timestamp_ns < 0:
            raise InputError(
                f"pair {pair.index}: time {pair.timestamp_ns} ns: EuRoC's times are not negative; "
                "give others (--rate-hz)"
            )
        for name, picture in (("cam0", pair.left), ("cam1", pair.right)):
            write_png(root / name / "data" / f"{pair.timestamp_ns}.png", picture)
        times_ns.append(pair.timestamp_ns)
    return times_ns


def _sensor_text(camera: Camera, body_from_camera: Transform) -> str:
    coefficients = list(camera.coefficients) or [0.0] * 4
    if camera.distortion == "brown" and not any(coefficients[4:]):
        coefficients = coefficients[:4]  # as EuRoC itself has it
    intrinsics = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
    pose = np.asarray(body_from_camera.matrix())
    return (
        "sensor_type: camera\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{', '.join(words(pose))}]\n"
        f"resolution: [{camera.width_px}, {camera.height_px}]\n"
        "camera_model: pinhole\n"
        f"intrinsics: [{', '.join(words(np.array(intrinsics)))}]\n"
        f"distortion_model: {LENSES[camera.distortion]}\n"
        f"distortion_coefficients: [{', '.join(words(np.array(coefficients)))}]\n"
    )


def _write_truth(truth: Truth, body_from_left: Transform, folder: Path) -> None:
    left_from_body = body_from_left.inverse()
    lines = [TRUTH_HEADER]
    for timestamp_ns, matrix in zip(truth.timestamps_ns, truth.world_from_left, strict=True):
        world_from_body = transform_of_pose(matrix, timestamp_ns) @ left_from_body
        numbers = np.r_[world_from_body.translation_m, world_from_body.quaternion_wxyz]
        lines.append(f"{timestamp_ns},{','.join(words(numbers))}\n")
    folder.mkdir()
    (folder / "data.csv").write_text("".join(lines))
