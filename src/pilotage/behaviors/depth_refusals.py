# SPDX-License-Identifier: Apache-2.0
"""Why two pictures tell no depth, and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pilotage import PictureFate
from pilotage.behaviors.picture_detail import has_detail

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


def cause_of(fate: PictureFate, greys: list[Grey]) -> PictureFate:
    """Return what is behind `fate`: noise of a blank wall is no detail."""
    return fate if all(has_detail(grey) for grey in greys) else PictureFate.few_features
