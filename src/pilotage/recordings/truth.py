# SPDX-License-Identifier: Apache-2.0
"""True poses stored with a recording: KITTI rows, TUM rows, or an ASL table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import StereoRig
from pilotage.calibration.files import load_body_from_left
from pilotage.calibration.rig import check_transform
from pilotage.errors import InputError
from pilotage.recordings.frames import Truth
from pilotage.recordings.times import finite_numbers, nanoseconds, read_lines, seconds_to_ns

BODY_NAMES = (
    "state_groundtruth_estimate0/data.csv",
    "mav0/state_groundtruth_estimate0/data.csv",
    "truth_body_tum.txt",
)
LEFT_NAMES = ("truth_left_tum.txt", "*.tum")
Row = tuple[int, NDArray[np.float64]]


def find_truth(
    folder: Path, body_from_left: Callable[[], NDArray[np.float64] | None]
) -> Truth | None:
    """Return the truth beside a recording; `body_from_left` is asked when it is of a body."""
    for name in BODY_NAMES:
        file = folder / name
        if file.is_file():
            from_left = body_from_left()
            if from_left is None:
                raise InputError(
                    f"{file}: is of the body, and the calibration does not say where the camera "
                    "sits on it; add robot_from_left to the calibration"
                )
            truth = read_truth(file)
            return Truth(truth.timestamps_ns, truth.world_from_left @ from_left)
    for pattern in LEFT_NAMES:
        for file in sorted(folder.glob(pattern)):
            return read_truth(file)
    return None


def body_from_left(rig: StereoRig, *calibrations: Path | None) -> NDArray[np.float64] | None:
    """Return (4, 4) from the first calibration that knows a body, else the rig's robot."""
    for file in calibrations:
        found = load_body_from_left(file) if file is not None and file.exists() else None
        if found is not None:
            return found
    return None if rig.robot_from_left is None else np.asarray(rig.robot_from_left.matrix())


def read_truth(file: Path) -> Truth:
    """Return a TUM (`t x y z qx qy qz qw`, seconds) or ASL table's poses, as they stand."""
    rows = list(_asl_rows(file) if file.suffix.lower() == ".csv" else _tum_rows(file))
    if not rows:
        raise InputError(f"{file}: holds no poses; remove it or put the truth in")
    timestamps_ns = np.array([timestamp_ns for timestamp_ns, _ in rows], np.int64)
    falls = np.flatnonzero(np.diff(timestamps_ns) <= 0)
    if len(falls):
        raise InputError(
            f"{file}: time {timestamps_ns[falls[0] + 1]} ns does not come after "
            f"{timestamps_ns[falls[0]]} ns; sort the rows"
        )
    return Truth(timestamps_ns, np.stack([pose for _, pose in rows]))


def read_kitti_poses(file: Path, timestamps_ns: list[int]) -> Truth:
    """Return poses.txt, a row-major 3x4 world_from_left a line, one for each pair."""
    poses = []
    for place, words in _table(file, None):
        pose = np.vstack([np.reshape(finite_numbers(words, 12, place), (3, 4)), [0, 0, 0, 1]])
        poses.append(check_transform(file, place, pose))
    if len(poses) != len(timestamps_ns):
        raise InputError(
            f"{file}: {len(poses)} poses for {len(timestamps_ns)} pairs; there must be one each"
        )
    return Truth(np.array(timestamps_ns, np.int64), np.stack(poses))


def _tum_rows(file: Path) -> Iterator[Row]:
    for place, words in _table(file, None):
        x, y, z, qx, qy, qz, qw = finite_numbers(words[1:], 7, place)
        yield seconds_to_ns(words[0], place), _pose([x, y, z], [qw, qx, qy, qz], place)


def _asl_rows(file: Path) -> Iterator[Row]:
    for place, words in _table(file, ","):
        # Velocity and biases may follow.
        numbers = finite_numbers(words[1:8], 7, place)
        yield nanoseconds(words[0], place), _pose(numbers[:3], numbers[3:], place)


def _table(file: Path, separator: str | None) -> Iterator[tuple[str, list[str]]]:
    for number, line in enumerate(read_lines(file), start=1):
        if line.strip() and not line.startswith("#"):
            yield f"{file}:{number}", line.split(separator)


def _pose(
    translation_m: list[float], quaternion_wxyz: list[float], place: str
) -> NDArray[np.float64]:
    length = float(np.linalg.norm(quaternion_wxyz))
    if abs(length - 1) > 1e-2:
        raise InputError(f"{place}: its quaternion has length {length:.4g}, not 1; correct it")
    w, *vector = (value / length for value in quaternion_wxyz)
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += 2 * w * cross + 2 * cross @ cross
    pose[:3, 3] = translation_m
    return pose
