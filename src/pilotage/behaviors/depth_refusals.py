# SPDX-License-Identifier: Apache-2.0
"""Why two pictures tell no depth, and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import cv2
import numpy as np

from pilotage import PictureFate

if TYPE_CHECKING:
    from pilotage.recordings.frames import Grey

REFUSALS: Mapping[PictureFate, tuple[str, str]] = {
    PictureFate.few_features: (
        "the pictures show hardly any detail",
        "look at something with texture, with more light and less motion",
    ),
    PictureFate.no_matches: (
        "the pictures show nothing in common, or only what repeats itself",
        "take both of the same things, from places nearer to each other",
    ),
    PictureFate.no_parallax: (
        "both pictures were taken from one place: the camera turned or stood",
        "move the camera itself, up, down or sideways, a tenth of what it looks at or more",
    ),
    PictureFate.not_connected: (
        "too little of what both pictures show fits one motion of the camera",
        "let nothing move between the two, and check the calibration",
    ),
}
CELL_PX = 16
LEAST_CONTRAST = 8.0  # grey values in a cell, smoothed: less is noise
LEAST_DETAIL = 0.02  # of a picture's cells


def cause_of(fate: PictureFate, greys: list[Grey]) -> PictureFate:
    """Return what is behind `fate`: noise of a blank wall is no detail."""
    return fate if all(_has_detail(grey) for grey in greys) else PictureFate.few_features


def _has_detail(grey: Grey) -> bool:
    smooth = cv2.GaussianBlur(grey, (0, 0), 2).astype(np.float32)
    height, width = (side // CELL_PX * CELL_PX for side in smooth.shape)
    if not height or not width:
        return False
    cells = smooth[:height, :width].reshape(height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX)
    return bool((np.ptp(cells, axis=(1, 3)) > LEAST_CONTRAST).mean() > LEAST_DETAIL)
