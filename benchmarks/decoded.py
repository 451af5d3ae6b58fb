# SPDX-License-Identifier: Apache-2.0
"""Pictures of a recording decoded once into a plain file, so that every system gets the same bytes.

Reading a pair back costs no decoding and keeps no more than that pair in memory; both would
otherwise be counted as the odometry's.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pilotage.recordings.recording import StereoFrame, open_recording

Array = npt.NDArray[Any]
# Where real recordings are looked for: $PILOTAGE_DATA, or shared/data beside the repository.
DATA_FOLDER = Path(
    os.environ.get("PILOTAGE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
)
CALIBRATIONS = Path(__file__).parent / "calibrations"


@dataclass(frozen=True)
class DecodedPairs:
    """Pairs (left, right) of (height, width) uint8 in one file; `index[i]` is -1 for a bad pair."""

    path: Path
    shape: tuple[int, int]
    timestamps_ns: npt.NDArray[np.int64]
    index: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    def pair(self, i: int) -> tuple[Array, Array] | None:
        """Return left and right of the i-th pair, None when it could not be read."""
        if self.index[i] < 0:
            return None
        size = self.shape[0] * self.shape[1]
        # fromfile, not a memory map: mapped pages would count as resident memory.
        offset = int(self.index[i]) * 2 * size
        both = np.fromfile(self.path, np.uint8, count=2 * size, offset=offset)
        left, right = both.reshape(2, *self.shape)
        return left, right

    def save(self) -> None:
        """Write what belongs to the pictures beside them."""
        np.savez(
            self.path.with_suffix(".npz"),
            shape=np.array(self.shape),
            timestamps_ns=self.timestamps_ns,
            index=self.index,
        )


def load_pairs(path: Path) -> DecodedPairs:
    """Return what `decode` wrote."""
    with np.load(path.with_suffix(".npz")) as saved:
        height, width = saved["shape"].tolist()
        return DecodedPairs(path, (height, width), saved["timestamps_ns"], saved["index"])


def open_for_benchmark(path: Path) -> Any:
    """Open a recording; where it brings no calibration, ours of the same name stands in."""
    return open_recording(path, calibration=stand_in_calibration(path))


def stand_in_calibration(recording: Path) -> Path | None:
    """Return our calibration for a recording that brings none."""
    file = CALIBRATIONS / f"{recording.resolve().name}.yaml"
    return file if file.is_file() else None


def decode(recording: Any, out: Path, every: int = 1, limit: int | None = None) -> DecodedPairs:
    """Write every n-th pair of `recording` to the file `out`, at most `limit` pairs."""
    stamps: list[int] = []
    index: list[int] = []
    camera = recording.rig.left
    shape = (camera.height_px, camera.width_px)
    with out.open("wb") as file:
        for frame in recording.frames():
            if frame.index % every:
                continue
            if limit is not None and len(stamps) == limit:
                break
            stamps.append(frame.timestamp_ns)
            good = isinstance(frame, StereoFrame)
            index.append(sum(i >= 0 for i in index) if good else -1)
            if good:
                file.write(np.ascontiguousarray(frame.left).tobytes())
                file.write(np.ascontiguousarray(frame.right).tobytes())
    pairs = DecodedPairs(out, shape, np.array(stamps, np.int64), np.array(index, np.int64))
    pairs.save()
    return pairs
