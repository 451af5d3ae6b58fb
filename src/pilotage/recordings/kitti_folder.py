# SPDX-License-Identifier: Apache-2.0
"""KITTI odometry folders, written: rectified pairs, calib.txt, times.txt, poses.txt."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Rectifier, StereoRig, Transform
from pilotage.errors import InputError
from pilotage.recordings.folder_files import seconds, transform_of_pose, words, write_png
from pilotage.recordings.frames import StereoFrame, Truth

SIDES = ("image_0", "image_1")
ULPS_TRIED = 4


def write_kitti(
    rig: StereoRig, pairs: Iterator[StereoFrame], truth: Truth | None, folder: Path
) -> list[str]:
    """Write into an empty folder; return what the format could not hold.

    A pair that is not rectified goes through the odometry's own rectifier, its truth along.
    """
    try:
        rectifier = Rectifier(rig=rig)
    except ValueError as error:
        raise InputError(
            f"KITTI holds rectified pairs, and this rig cannot be rectified ({error}); "
            "convert to mcap or euroc"
        ) from None
    ideal = rig if rectifier.is_identity else _ideal_rig(rectifier)
    times_ns = _write_pictures(rectifier, pairs, folder)
    (folder / "times.txt").write_text("".join(f"{seconds(t)}\n" for t in times_ns))
    (folder / "calib.txt").write_text(_calibration(ideal))
    notes = []
    if not rectifier.is_identity:
        notes.append("KITTI holds rectified pairs: the pictures were rectified")
    if rig.robot_from_left is not None:
        notes.append("KITTI cannot say where the camera sits on the robot: that is left out")
    if rig.readout_s:
        notes.append(
            f"KITTI knows no rolling shutter: its readout of {1e3 * rig.readout_s:g} ms is left out"
        )
    if truth is not None:
        left_from_ideal = np.asarray(rectifier.rectified_from_left.inverse().matrix())
        poses = truth.world_from_left
        if not rectifier.is_identity:
            poses = poses @ left_from_ideal
        notes += _write_truth(Truth(truth.timestamps_ns, poses), times_ns, folder)
    return notes


def _write_pictures(rectifier: Rectifier, pairs: Iterator[StereoFrame], folder: Path) -> list[int]:
    times_ns = []
    for side in SIDES:
        (folder / side).mkdir()
    for number, pair in enumerate(pairs):
        pictures = (pair.left, pair.right)
        for side, name, picture in zip(SIDES, ("left", "right"), pictures, strict=True):
            is_ready = rectifier.is_identity
            ready = picture if is_ready else np.asarray(rectifier.rectify(picture, name))
            write_png(folder / side / f"{number:06d}.png", ready)
        times_ns.append(pair.timestamp_ns)
    return times_ns


def _ideal_rig(rectifier: Rectifier) -> StereoRig:
    ideal = rectifier.stereo
    left, right = (
        Camera(
            width_px=ideal.width_px, height_px=ideal.height_px, fx_px=ideal.focal_px,
            fy_px=ideal.focal_px, cx_px=cx_px, cy_px=ideal.cy_px,
        )
        for cx_px in (ideal.cx_px, ideal.cx_right_px)
    )  # fmt: skip
    base = Transform(translation_m=[-ideal.baseline_m, 0, 0])
    return StereoRig(left=left, right=right, right_from_left=base)


def _calibration(rig: StereoRig) -> str:
    lines = []
    shifts_m = (np.zeros(3), np.asarray(rig.right_from_left.translation_m))
    for side, (camera, shift_m) in enumerate(zip((rig.left, rig.right), shifts_m, strict=True)):
        projection = _projection(camera, shift_m)
        lines.append(f"P{side}: {' '.join(words(projection))}\n")
    return "".join(lines)


def _projection(camera: Camera, shift_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (3, 4), its last column such that dividing it out gives `shift_m`, if it can."""
    fx, fy, cx, cy = camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px
    k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    column = k @ shift_m
    tried = [column]
    for direction in (-np.inf, np.inf):
        near = column.copy()
        for _ in range(ULPS_TRIED):
            near = near.copy()
            near[0] = np.nextafter(near[0], direction)
            tried.append(near)
    exact = (c for c in tried if np.array_equal(np.linalg.solve(k, c), shift_m))
    return np.column_stack([k, next(exact, column)])


def _write_truth(truth: Truth, times_ns: list[int], folder: Path) -> list[str]:
    """Write poses.txt, which has a pose for each pair; else a table with times of its own."""
    places = np.searchsorted(truth.timestamps_ns, times_ns)
    places = np.minimum(places, len(truth.timestamps_ns) - 1)
    if np.array_equal(truth.timestamps_ns[places], times_ns):
        rows = (" ".join(words(pose[:3])) for pose in truth.world_from_left[places])
        (folder / "poses.txt").write_text("".join(f"{row}\n" for row in rows))
        left_out = len(truth.timestamps_ns) - len(times_ns)
        return [f"{left_out} true poses between the pairs are left out"] if left_out else []
    lines = ["# t[s] x y z qx qy qz qw of the left camera\n"]
    for timestamp_ns, matrix in zip(truth.timestamps_ns, truth.world_from_left, strict=True):
        pose = transform_of_pose(matrix, timestamp_ns)
        w, x, y, z = pose.quaternion_wxyz
        numbers = words(np.array([*pose.translation_m, x, y, z, w]))
        lines.append(f"{seconds(timestamp_ns)} {' '.join(numbers)}\n")
    (folder / "truth_left_tum.txt").write_text("".join(lines))
    return ["the truth's times are not those of the pairs: it is in truth_left_tum.txt"]
