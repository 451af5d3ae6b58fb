# SPDX-License-Identifier: Apache-2.0
"""Why a pair was not tracked, in plain words, and what to do about it: the closed list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """What happened (a phrase that can follow "because") and what the user can do.

    `short` says it in three words, for a line that goes by.
    """

    words: str
    remedy: str
    short: str = ""


REASONS: dict[str, Reason] = {
    "none": Reason("nothing was wrong", "Nothing to do.", "no reason told"),
    "too_dark": Reason(
        "the pictures are too dark",
        "Add light, lengthen the exposure or raise the gain.",
        "too dark",
    ),
    "too_bright": Reason(
        "the pictures are overexposed",
        "Shorten the exposure, or keep the sun and lamps out of the view.",
        "too bright",
    ),
    "blurred": Reason(
        "the pictures are blurred",
        "Shorten the exposure, move or turn more slowly, and check the focus.",
        "blurred",
    ),
    "too_few_points": Reason(
        "too few points could be followed",
        "Point the cameras at something with texture, keep people and vehicles from filling the"
        " view, and let the views overlap more (more pairs a second, slower turns).",
        "too few points",
    ),
    "no_parallax": Reason(
        "nothing in view is near enough to measure its distance",
        "Bring nearer things into view, or use a pair of cameras with a longer base.",
        "nothing near",
    ),
    "ambiguous": Reason(
        "the ground repeats its pattern and looks the same in several places",
        "Let a camera see something else beside it, or take more pairs a second, so that less than"
        " half a pattern passes between two.",
        "repeating pattern",
    ),
    "calibration_does_not_fit": Reason(
        "the pictures do not fit the calibration",
        "Calibrate the stereo pair again, and check that the calibration belongs to these cameras"
        " at this picture size.",
        "calibration does not fit",
    ),
    "frames_missing": Reason(
        "pictures are missing or unreadable",
        "Look for dropped frames: a full disk, a slow card, a loose cable.",
        "pictures missing",
    ),
    "left_right_swapped": Reason(
        "the left and the right pictures are exchanged",
        "Exchange the two cameras, or the two folders of pictures.",
        "left and right exchanged",
    ),
    "left_right_out_of_step": Reason(
        "left and right were not taken at the same moment",
        "Trigger both cameras together, and match the pictures by their time stamps.",
        "left and right out of step",
    ),
    "pairs_disagree": Reason(
        "the stereo pairs of the robot contradict each other",
        "Look at judge.csv and the report for which one; a pair that was knocked out of place needs"
        " its calibration anew.",
        "pairs disagree",
    ),
}


def short_words(key: str) -> str:
    """Return `key` in three words or so; the key itself where it is not in the list."""
    reason = REASONS.get(key)
    return reason.short if reason else key.replace("_", " ")


def reason_words(key: str) -> str:
    """Return the phrase for `key`; the key itself where it is not in the list."""
    reason = REASONS.get(key)
    return reason.words if reason else key.replace("_", " ")


def reason_remedy(key: str) -> str:
    """Return the remedy for `key`; empty where it is not in the list."""
    reason = REASONS.get(key)
    return reason.remedy if reason else ""


def some_names(names: Sequence[str], most: int) -> str:
    """Return names for a sentence, of which many are cut to the first `most`."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"
