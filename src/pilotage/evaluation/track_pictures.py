# SPDX-License-Identifier: Apache-2.0
"""Pictures of a model with its tracks: dots, and lines to where another has them."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage.evaluation.plots import BLUE, GREEN, RED, YELLOW
from pilotage.evaluation.poses import Array
from pilotage.models import Model
from pilotage.recordings.pictures import PictureError, read_color

COUNT = 6
WIDTH_PX = 640
JPEG_QUALITY = 82
# A track of at least so many pictures, its colour and how it is called.
CLASSES = (
    (2, RED, "2 pictures"),
    (3, YELLOW, "3"),
    (4, GREEN, "4 to 6"),
    (7, BLUE, "7 or more"),
)
DOT_PX, RIM_PX = 4.4, 6.2  # of a picture WIDTH_PX wide


def track_figures(model: Model, order: Iterable[int], folder: Path) -> Iterable[str]:
    """Yield a figure of the page for some of the pictures, spread over `order`.

    `order` has their indices in the model. A picture that `folder` holds no more is left out.
    """
    lengths = np.bincount(model.point, minlength=len(model.points_in_world))
    for i in spread(list(order), np.bincount(model.picture, minlength=len(model.names))):
        name = model.names[i]
        try:
            picture = read_color(folder / name)
        except PictureError:
            continue
        if picture.shape[:2] != (model.camera_of(i).height_px, model.camera_of(i).width_px):
            continue
        rows = model.picture == i
        kin = _nearest_kin(model, i)
        ahead = _pixels(model, kin)[model.point[rows]]
        dots = _dots(model.pixel_px[rows], ahead, lengths[model.point[rows]], picture)
        said = f"{escape(name)}: {np.count_nonzero(rows)} points"
        said += "" if kin is None else f", lines to {escape(model.names[kin])}"
        yield (
            f"<figure class='card' role='img' aria-label='tracks in {escape(name)}'>{dots}"
            f"<figcaption class='caption'>{said}</figcaption></figure>"
        )


def spread(indices: list[int], counts: NDArray[Any]) -> list[int]:
    """Return the index that has the largest of `counts` in each of up to COUNT even stretches."""
    stretches = np.array_split(np.array(indices, dtype=int), max(1, min(COUNT, len(indices))))
    return [int(one[counts[one].argmax()]) for one in stretches if len(one)]


def _nearest_kin(model: Model, picture: int) -> int | None:
    """Return the other picture of that camera that shows most of its points; None without any."""
    shown = np.zeros(len(model.points_in_world), bool)
    shown[model.point[model.picture == picture]] = True
    shared = np.bincount(model.picture[shown[model.point]], minlength=len(model.names))
    shared[model.camera_index != model.camera_index[picture]] = 0
    shared[picture] = 0
    best = int(shared.argmax())
    return best if shared[best] else None


def _pixels(model: Model, picture: int | None) -> Array:
    """Return (N, 2) where a picture shows each point of the model, NaN where it does not."""
    found = np.full((len(model.points_in_world), 2), np.nan)
    rows = model.picture == picture
    found[model.point[rows]] = model.pixel_px[rows]
    return found


def legend() -> str:
    """Return the line that tells what the colours of the dots mean."""
    marks = " &emsp; ".join(
        "<span style='white-space:nowrap'>"
        "<svg viewBox='-1 -1 2 2' style='display:inline;width:10px;vertical-align:baseline'>"
        f"<circle r='1' fill='{colour}'/></svg> {said}</span>"
        for _, colour, said in CLASSES
    )
    return (
        "<p class='made'>Each dot is a point of the model; a line leads to where it is in the"
        f" picture that shows most of the same. Seen in &emsp; {marks}</p>"
    )


def _dots(pixel_px: Array, ahead_px: Array, lengths: Array, picture: Any) -> str:
    """Return SVG text: the picture, made small, with a dot at each of (K, 2) pixels and a line from
    it to (K, 2) where the other picture shows it."""
    height, width = picture.shape[:2]
    scale = min(1.0, WIDTH_PX / width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(small[..., ::-1]), quality)
    # SVG counts from the corner of the first pixel.
    places, ahead = ((px + 0.5) * (np.array(size) / (width, height)) for px in (pixel_px, ahead_px))
    kinds = np.searchsorted([least for least, _, _ in CLASSES], lengths, side="right") - 1
    kinds = np.maximum(kinds, 0)
    paths = "".join(
        _lines(places[kinds == kind], ahead[kinds == kind], colour)
        for kind, (_, colour, _) in enumerate(CLASSES)
    )
    paths += "".join(
        _path(places[kinds == kind], colour) for kind, (_, colour, _) in enumerate(CLASSES)
    )
    return (
        f"<svg viewBox='0 0 {size[0]} {size[1]}'><image width='{size[0]}' height='{size[1]}' "
        f"href='data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}'/>"
        f"{paths}</svg>"
    )


def _lines(places: Array, ahead: Array, colour: str) -> str:
    """Return a line from each place to the other one, where that is known."""
    ends = np.hstack([places, ahead])[np.isfinite(ahead).all(axis=1)]
    if not len(ends):
        return ""
    line = "".join(f"M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" for x, y, u, v in ends.tolist())
    style = "style='fill:none'"
    return f"<path d='{line}' {style} stroke='{colour}' stroke-opacity='.7' stroke-width='1'/>"


def _path(places: Array, colour: str) -> str:
    """Return round dots as one path: lines of no length with round ends, on a dark rim."""
    if not len(places):
        return ""
    # As a style, for the style that comes with Matplotlib's figures holds in the whole page.
    style = "style='fill:none;stroke-linecap:round'"
    line = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in places.tolist())
    return (
        f"<path d='{line}' {style} stroke='#111' stroke-opacity='.8' stroke-width='{RIM_PX}'/>"
        f"<path d='{line}' {style} stroke='{colour}' stroke-width='{DOT_PX}'/>"
    )
