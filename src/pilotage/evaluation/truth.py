# SPDX-License-Identifier: Apache-2.0
"""Truth from wherever it is: KITTI poses, TUM, EuRoC csv, a recording, another results folder."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.evaluation.poses import Array, interpolate, pose_matrices
from pilotage.pose_files import PoseRecord, read_text
from pilotage.results import is_results_folder, read_results

Body = Literal["left", "body", "robot"]

# Between samples further apart than this a straight line is no truth any more.
WIDEST_GAP_NS = 250_000_000


@dataclass(frozen=True)
class TruthPoses:
    """(N, 4, 4) `world_from_body` at (N,) times; or a pose per pair where the times are None.

    `body` tells whose poses these are: the left camera's, the recording's own body (an IMU), or
    the robot's. A pose may be NaN. `robot_from_left` (4, 4) is where the left camera sat by the
    truth's own account, None where that says nothing.
    """

    poses: Array
    timestamps_ns: NDArray[np.int64] | None
    body: Body
    robot_from_left: Array | None = None

    def at(self, records: Sequence[PoseRecord]) -> Array:
        """Return (M, 4, 4) poses for the pairs `records`; NaN where there is no truth."""
        if self.timestamps_ns is None:
            indices = np.array([record.index for record in records])
            poses = np.full((len(records), 4, 4), np.nan)
            inside = indices < len(self.poses)
            poses[inside] = self.poses[indices[inside]]
            return poses
        return interpolate(
            times_ns=self.timestamps_ns,
            poses=self.poses,
            at_ns=np.array([record.timestamp_ns for record in records], dtype=np.int64),
            widest_gap_ns=WIDEST_GAP_NS,
        )


def load_truth(path: Path) -> TruthPoses:
    """Read truth from a file or a folder; the format of a file is told by its first line.

    Twelve numbers a line are KITTI poses, otherwise it is a TUM trajectory or an ASL (EuRoC) csv.
    The latter is of the body; a TUM file is where it lies in a recording that says where the left
    camera sits on its body (T_BS), and of the left camera otherwise. InputError names the file.
    """
    from pilotage.recordings.truth import read_truth

    if path.is_dir():
        return _truth_of_folder(path)
    if len(_first_row(path)) == 12:
        return _kitti(path)
    truth = read_truth(path)
    is_of_body = path.suffix.lower() == ".csv" or find_body_from_left(path.parent) is not None
    return TruthPoses(truth.world_from_left, truth.timestamps_ns, "body" if is_of_body else "left")


def _first_row(path: Path) -> list[str]:
    for line in read_text(path).splitlines():
        if line.strip() and not line.startswith("#"):
            return line.split()
    raise InputError(f"{path}: holds no pose")


def find_body_from_left(*places: Path) -> Array | None:
    """Return where the left camera sits on the recording's body, (4, 4), None where nothing says.

    Asked are the calibrations in `places` and up to three folders above each.
    """
    from pilotage.calibration.files import load_body_from_left

    for place in places:
        for folder in [place, *list(place.absolute().parents)[:3]]:
            # What lies further up may be any file: one that cannot be read says nothing.
            with contextlib.suppress(InputError, OSError):
                body_from_left = load_body_from_left(folder) if folder.is_dir() else None
                if body_from_left is not None:
                    return body_from_left
    return None


def _truth_of_folder(path: Path) -> TruthPoses:
    if is_results_folder(path):
        results = read_results(path)
        body: Body = "robot" if results.summary.get("body") == "robot" else "left"
        known = [record for record in results.records if record.position_m is not None]
        times = np.array([record.timestamp_ns for record in known], dtype=np.int64)
        return TruthPoses(poses_of(known), times, body)
    from pilotage.recordings.recording import open_recording

    recording = open_recording(path)
    truth = recording.truth()
    if truth is None:
        raise InputError(f"{path}: the recording holds no truth")
    sits = recording.rig.robot_from_left
    if sits is None:
        return TruthPoses(truth.world_from_left, truth.timestamps_ns, "left")
    # Of the robot: of several stereo pairs the run may have used another one.
    robot_from_left = np.asarray(sits.matrix(), np.float64)
    poses = truth.world_from_left @ np.asarray(sits.inverse().matrix(), np.float64)
    return TruthPoses(poses, truth.timestamps_ns, "robot", robot_from_left)


def poses_of(records: Sequence[PoseRecord]) -> Array:
    """Return the (N, 4, 4) poses of `records`, NaN where lost."""
    poses = np.full((len(records), 4, 4), np.nan)
    known = [at for at, record in enumerate(records) if record.position_m is not None]
    if known:
        positions = np.array([records[at].position_m for at in known], dtype=np.float64)
        quaternions = np.array([records[at].quaternion_wxyz for at in known], dtype=np.float64)
        poses[known] = pose_matrices(positions, quaternions)
    return poses


def _kitti(path: Path) -> TruthPoses:
    """Read a row-major 3x4 matrix a line; a line of `nan`, as our own files have, is no pose."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        try:
            rows.append(np.array(line.split(), dtype=np.float64).reshape(3, 4))
        except ValueError:
            raise InputError(f"{path}, line {number}: must hold 12 numbers") from None
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :] = rows
    poses[~np.isfinite(poses).all(axis=(1, 2))] = np.nan
    turned = poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)
    wrong = np.abs(turned - np.eye(3)).max(axis=(1, 2)) > 1e-3
    if wrong.any():
        raise InputError(f"{path}, line {int(np.argmax(wrong)) + 1}: its 3x3 part is no rotation")
    return TruthPoses(poses, None, "left")
