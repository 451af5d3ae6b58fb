# SPDX-License-Identifier: Apache-2.0
"""Whether a picture shows anything, or the sensor's noise alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from pilotage.recordings.frames import Grey

CELL_PX = 16
LEAST_CONTRAST = 8.0  # grey values in a cell, smoothed: less is noise
LEAST_DETAIL = 0.02  # of a picture's cells


def has_detail(grey: Grey) -> bool:
    """Tell whether a picture (height, width) of uint8 shows more than noise."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 2).astype(np.float32)
    height, width = (side // CELL_PX * CELL_PX for side in smooth.shape)
    if not height or not width:
        return False
    cells = smooth[:height, :width].reshape(height // CELL_PX, CELL_PX, width // CELL_PX, CELL_PX)
    return bool((np.ptp(cells, axis=(1, 3)) > LEAST_CONTRAST).mean() > LEAST_DETAIL)
