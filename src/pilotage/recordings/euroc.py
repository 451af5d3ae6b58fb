# SPDX-License-Identifier: Apache-2.0
"""EuRoC (ASL) folders: cam0 and cam1 with data.csv, data/ and sensor.yaml, in mav0/ or bare."""

from __future__ import annotations

from bisect import bisect_left
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage.calibration.files import load_rig
from pilotage.errors import InputError
from pilotage.recordings.frames import Truth
from pilotage.recordings.pairs import Pair, PairRecording, check_times, steady_times
from pilotage.recordings.pictures import list_pictures
from pilotage.recordings.times import nanoseconds, read_lines
from pilotage.recordings.truth import body_from_left, find_truth

# Cameras of a pair fire together; a small offset is the clock's, a larger one another picture.
PAIR_TOLERANCE_NS = 2_000_000


class EurocRecording(PairRecording):
    """Pairs matched by time; a picture without partner is a bad frame, as in the real sets."""

    looks_for = "EuRoC folders mav0/cam0 and mav0/cam1 (or cam0 and cam1) with data/"

    def __init__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> None:
        root = _root(path)
        left, right = (_read_table(root / camera) for camera in ("cam0", "cam1"))
        rig = load_rig(calibration or _sensor_file(root))
        pairs = _match(left, right, root)
        if rate_hz is not None:
            times_ns = steady_times(len(pairs), rate_hz)
            pairs = [
                Pair(t, p.left, p.right, p.problem) for t, p in zip(times_ns, pairs, strict=True)
            ]
        super().__init__(path, pairs, rig)
        self._root = root
        self._calibration = calibration

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by the two cameras' folders and something of EuRoC in them."""
        cameras = [_root(path) / camera for camera in ("cam0", "cam1")]
        return all((c / "data").is_dir() or (c / "data.csv").is_file() for c in cameras)

    def truth(self) -> Truth | None:
        """Return the left camera's poses, from the body's by T_BS."""
        for folder in (self._root, self.path):
            found = find_truth(folder, self._body_from_left)
            if found is not None:
                return found
        return None

    def _body_from_left(self) -> NDArray[np.float64] | None:
        return body_from_left(self.rig, self._calibration, self._root / "cam0" / "sensor.yaml")


def _root(path: Path) -> Path:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _sensor_file(root: Path) -> Path:
    file = root / "cam0" / "sensor.yaml"
    if not file.is_file():
        raise InputError(f"{file}: does not exist; add it, or give a calibration (--calibration)")
    return file


def _read_table(camera: Path) -> dict[int, Path]:
    """Return the pictures by time, ns: from data.csv, or from the names when it is absent."""
    file, folder = camera / "data.csv", camera / "data"
    rows: list[tuple[int, Path]] = []
    if file.is_file():
        for number, line in enumerate(read_lines(file), start=1):
            if not line.strip() or line.startswith("#"):
                continue
            time, comma, name = line.partition(",")
            if not comma or not name.strip():
                raise InputError(f"{file}:{number}: {line[:60]!r}: must read 'time [ns],file name'")
            rows.append((nanoseconds(time, f"{file}:{number}"), folder / name.strip()))
    else:
        rows = [(nanoseconds(f.stem, str(f)), f) for f in list_pictures(folder)]
        file = folder
    if not rows:
        raise InputError(f"{file}: lists no pictures; put them in")
    check_times([time_ns for time_ns, _ in rows], file)
    return dict(rows)


def _match(left: dict[int, Path], right: dict[int, Path], root: Path) -> list[Pair]:
    right_times = list(right)
    pairs = []
    for time_ns, file in left.items():
        place = bisect_left(right_times, time_ns)
        near = right_times[max(place - 1, 0) : place + 1]
        partner = min(near, key=lambda t: abs(t - time_ns))
        if abs(partner - time_ns) <= PAIR_TOLERANCE_NS:
            pairs.append(Pair(time_ns, file, right[partner]))
        else:
            pairs.append(Pair(time_ns, file, None, f"{file}: has no right picture at its time"))
    if all(pair.problem for pair in pairs):
        raise InputError(
            f"{root}: none of {len(left)} left and {len(right)} right pictures are of the same "
            f"time; left starts at {next(iter(left))} ns, right at {right_times[0]} ns"
        )
    return pairs
