# SPDX-License-Identifier: Apache-2.0
"""A few of a run's pictures on one sheet, for its report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

COLUMNS, COUNT = 3, 6
WIDTH_PX = 340
JPEG_QUALITY = 80


class ContactSheet:
    """Keeps small copies of pictures that are spread evenly over the indices of a run.

    `name` is written on each, where there are several stereo pairs.
    """

    def __init__(self, indices: range, name: str = "") -> None:
        places = np.linspace(0, len(indices) - 1, min(COUNT, len(indices))).round().astype(int)
        self._wanted = {indices[place] for place in places.tolist()}
        self._name = name
        self._start_ns: int | None = None
        self._kept: list[NDArray[np.uint8]] = []

    def look(self, index: int, timestamp_ns: int, picture: NDArray[np.uint8]) -> None:
        """Keep the picture (H, W) or (H, W, 3) if its index is one of the sheet's."""
        if self._start_ns is None:
            self._start_ns = timestamp_ns
        if index not in self._wanted:
            return
        height_px = max(1, round(picture.shape[0] * WIDTH_PX / picture.shape[1]))
        small: Any = cv2.resize(picture, (WIDTH_PX, height_px), interpolation=cv2.INTER_AREA)
        if small.ndim == 2:
            small = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
        said = f"{self._name} {(timestamp_ns - self._start_ns) * 1e-9:.1f} s".strip()
        for colour, width in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(
                small, said, (8, height_px - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, width,
                cv2.LINE_AA,
            )  # fmt: skip
        self._kept.append(small)

    def jpeg(self) -> bytes | None:
        """Return the sheet as a JPEG file, None without a picture."""
        return sheets_jpeg([self])

    def rows(self) -> list[NDArray[np.uint8]]:
        """Return the rows of the sheet, each a picture of up to `COLUMNS` ones."""
        if not self._kept:
            return []
        white = np.full_like(self._kept[0], 255)
        missing = -len(self._kept) % min(COLUMNS, len(self._kept))
        shown = [*self._kept, *[white] * missing]
        columns = min(COLUMNS, len(shown))
        return [np.hstack(shown[at : at + columns]) for at in range(0, len(shown), columns)]


def sheets_jpeg(sheets: Sequence[ContactSheet]) -> bytes | None:
    """Return sheets below each other as a JPEG file, None without a picture."""
    rows = [row for sheet in sheets for row in sheet.rows()]
    if not rows:
        return None
    width_px = max(row.shape[1] for row in rows)
    padded = [
        np.pad(row, ((0, 0), (0, width_px - row.shape[1]), (0, 0)), constant_values=255)
        for row in rows
    ]
    done, data = cv2.imencode(".jpg", np.vstack(padded), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes() if done else None
