# SPDX-License-Identifier: Apache-2.0
"""Poses as text: TUM, KITTI and the full table. Formats are told in docs/results_folder.md."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError

AXES = ("x", "y", "z", "rx", "ry", "rz")
UPPER_TRIANGLE = tuple(combinations_with_replacement(range(6), 2))
POSITION_COLUMNS = ("x_m", "y_m", "z_m")
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
COVARIANCE_COLUMNS = tuple(f"cov_{AXES[row]}_{AXES[column]}" for row, column in UPPER_TRIANGLE)
MEASURE_COLUMNS = ("segment", "matches", "inliers", "residual_px", "y_parallax_px", "is_keyframe")
POSE_COLUMNS = (
    *("index", "timestamp_ns", "status", "reason"),
    *POSITION_COLUMNS,
    *QUATERNION_COLUMNS,
    *MEASURE_COLUMNS,
    *COVARIANCE_COLUMNS,
)


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """What is known of one stereo pair; position, quaternion and covariance are None when lost.

    The pose is `world_from_body`; covariance is (6, 6): x y z along the axes of the world, metres,
    then rotation about them, radians. `segment` grows where tracking resumed without a tie to what
    was before. Residual and y-parallax are NaN where nothing matched.
    """

    index: int
    timestamp_ns: int
    status: str
    reason: str = "none"
    position_m: tuple[float, float, float] | None = None
    quaternion_wxyz: tuple[float, float, float, float] | None = None
    covariance: NDArray[np.float64] | None = None
    segment: int = 0
    matches: int = 0
    inliers: int = 0
    residual_px: float = math.nan
    y_parallax_px: float = math.nan
    is_keyframe: bool = False


def tum_line(record: PoseRecord) -> str:
    """Return `t[s] x y z qx qy qz qw` and a newline; empty for a pair without pose."""
    if record.position_m is None or record.quaternion_wxyz is None:
        return ""
    w, *vector = record.quaternion_wxyz
    values = " ".join(f"{value:.10g}" for value in (*record.position_m, *vector, w))
    return f"{seconds(record.timestamp_ns)} {values}\n"


def kitti_line(record: PoseRecord) -> str:
    """Return the row-major 3x4 matrix on one line; twelve `nan` for a pair without pose."""
    if record.position_m is None or record.quaternion_wxyz is None:
        return " ".join(["nan"] * 12) + "\n"
    rotation = rotation_matrix(record.quaternion_wxyz)
    matrix = np.column_stack([rotation, record.position_m])
    return " ".join(f"{value:.9e}" for value in matrix.ravel()) + "\n"


def rotation_matrix(quaternion_wxyz: Sequence[float]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation of a unit quaternion."""
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def csv_header() -> str:
    """Return the first line of poses.csv."""
    return ",".join(POSE_COLUMNS) + "\n"


def csv_line(record: PoseRecord) -> str:
    """Return one line of poses.csv; cells of what is not known are empty."""
    cells = [str(record.index), str(record.timestamp_ns), record.status, record.reason]
    cells += _numbers(record.position_m, len(POSITION_COLUMNS))
    cells += _numbers(record.quaternion_wxyz, len(QUATERNION_COLUMNS))
    cells += [str(record.segment), str(record.matches), str(record.inliers)]
    cells += _numbers([record.residual_px, record.y_parallax_px], 2)
    cells.append(str(int(record.is_keyframe)))
    covariance = record.covariance
    triangle = None if covariance is None else [covariance[at] for at in UPPER_TRIANGLE]
    cells += _numbers(triangle, len(UPPER_TRIANGLE))
    return ",".join(cells) + "\n"


def _numbers(values: Iterable[float] | None, count: int) -> list[str]:
    if values is None:
        return [""] * count
    return [f"{value:.10g}" if math.isfinite(value) else "" for value in values]


def read_pose_table(path: Path) -> list[PoseRecord]:
    """Read poses.csv or poses_live.csv; a last line cut short by a crash is left out.

    Raises InputError naming file and line.
    """
    text = read_text(path)
    complete = text[: text.rfind("\n") + 1]
    rows = csv.reader(io.StringIO(complete))
    if tuple(next(rows, ())) != POSE_COLUMNS:
        raise InputError(f"{path}: the first line does not name the columns of a pose table")
    records = []
    for number, row in enumerate(rows, start=2):
        try:
            records.append(_parse_row(row))
        except (ValueError, KeyError) as error:
            raise InputError(f"{path}, line {number}: not a line of a pose table") from error
    return records


def _parse_row(row: list[str]) -> PoseRecord:
    cells = dict(zip(POSE_COLUMNS, row, strict=True))
    position = _floats(cells, POSITION_COLUMNS)
    quaternion = _floats(cells, QUATERNION_COLUMNS)
    return PoseRecord(
        index=int(cells["index"]),
        timestamp_ns=int(cells["timestamp_ns"]),
        status=cells["status"],
        reason=cells["reason"],
        position_m=(position[0], position[1], position[2]) if position else None,
        quaternion_wxyz=tuple(quaternion) if quaternion else None,  # type: ignore[arg-type]
        covariance=_covariance(_floats(cells, COVARIANCE_COLUMNS)),
        segment=int(cells["segment"]),
        matches=int(cells["matches"]),
        inliers=int(cells["inliers"]),
        residual_px=float(cells["residual_px"] or "nan"),
        y_parallax_px=float(cells["y_parallax_px"] or "nan"),
        is_keyframe=bool(int(cells["is_keyframe"])),
    )


def _floats(cells: dict[str, str], columns: Sequence[str]) -> list[float]:
    texts = [cells[column] for column in columns]
    return [] if "" in texts else [float(text) for text in texts]


def _covariance(triangle: list[float]) -> NDArray[np.float64] | None:
    if not triangle:
        return None
    covariance = np.empty((6, 6))
    for (row, column), value in zip(UPPER_TRIANGLE, triangle, strict=True):
        covariance[row, column] = covariance[column, row] = value
    return covariance


def read_text(path: Path) -> str:
    """Return the text of `path`; InputError naming the file where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file") from error
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error


def seconds(timestamp_ns: int) -> str:
    """Return nanoseconds as decimal seconds with no digit lost."""
    sign = "-" if timestamp_ns < 0 else ""
    whole, rest = divmod(abs(timestamp_ns), 10**9)
    return f"{sign}{whole}.{rest:09d}"
