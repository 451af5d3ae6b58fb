# SPDX-License-Identifier: Apache-2.0
"""The first picture in grey, with a dot for each measured point and numbers (metres)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage.behaviors.depth import Array, Depth

SMALLEST_WIDTH_PX = 960  # small pictures are enlarged, for numbers need room
PALE = 0.6  # of the picture: dots and numbers must stand out
LEGEND_PX = 92
LEGEND_STEPS = 5
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.42
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
Picture = NDArray[np.uint8]


def depth_picture(depth: Depth, grey: NDArray[np.uint8]) -> bytes:
    """Return a PNG: dots red where near, blue where far, equal steps of inverse depth."""
    zoom = max(1, round(SMALLEST_WIDTH_PX / grey.shape[1]))
    large = cv2.resize(grey, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
    pale = (255 - PALE * (255 - large.astype(np.float32))).astype(np.uint8)
    canvas = np.asarray(cv2.cvtColor(pale, cv2.COLOR_GRAY2BGR), np.uint8)
    low, high = np.percentile(1 / depth.distance_m, [2, 98])
    colors = _colors(1 / depth.distance_m, low, high)
    places = np.rint((depth.pixels + 0.5) * zoom - 0.5).astype(int)
    for row in np.argsort(-depth.distance_m):  # the nearest last, on top
        cv2.circle(canvas, places[row].tolist(), 4, BLACK, -1, cv2.LINE_AA)
        cv2.circle(canvas, places[row].tolist(), 3, colors[row].tolist(), -1, cv2.LINE_AA)
    _write_numbers(canvas, places, depth)
    return cv2.imencode(".png", np.hstack([canvas, _legend(len(canvas), low, high)]))[1].tobytes()


def _colors(inverse: Array, low: float, high: float) -> Picture:
    part = np.clip((inverse - low) / max(high - low, 1e-12), 0, 1)
    levels = np.rint(255 * part).astype(np.uint8)
    return np.asarray(cv2.applyColorMap(levels[:, None], cv2.COLORMAP_TURBO)[:, 0], np.uint8)


def _write_numbers(canvas: Picture, places: NDArray[np.intp], depth: Depth) -> None:
    """Write as many distances as have room, those known best first."""
    taken = np.zeros(canvas.shape[:2], bool)
    for row in np.argsort(depth.distance_sigma_m / depth.distance_m, kind="stable"):
        text = f"{depth.distance_m[row]:.2f}" if depth.distance_m[row] < 10 else ">10"
        (width, height), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        x, y = int(places[row, 0]) + 7, int(places[row, 1]) + height // 2
        area = slice(y - height - 10, y + 10), slice(x - 22, x + width + 14)
        is_inside = x + width < canvas.shape[1] and min(y - height - 10, x - 22) >= 0
        if not is_inside or y + 10 > canvas.shape[0] or taken[area].any():
            continue
        taken[area] = True
        cv2.putText(canvas, text, (x, y), FONT, FONT_SCALE, WHITE, 4, cv2.LINE_AA)
        cv2.putText(canvas, text, (x, y), FONT, FONT_SCALE, BLACK, 1, cv2.LINE_AA)


def _legend(height: int, low: float, high: float) -> Picture:
    legend = np.full((height, LEGEND_PX, 3), 255, np.uint8)
    top, bottom = 44, height - 24
    inverse = np.linspace(low, high, bottom - top)  # far above, as in most pictures
    legend[top:bottom, 12:30] = _colors(inverse, low, high)[:, None]
    cv2.putText(legend, "metres", (10, 24), FONT, FONT_SCALE, BLACK, 1, cv2.LINE_AA)
    for step in range(LEGEND_STEPS):
        row = top + round(step * (bottom - top - 1) / (LEGEND_STEPS - 1))
        text = f"{1 / inverse[row - top]:.2f}"
        cv2.putText(legend, text, (36, row + 4), FONT, FONT_SCALE, BLACK, 1, cv2.LINE_AA)
    return legend
