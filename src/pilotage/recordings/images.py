# SPDX-License-Identifier: Apache-2.0
"""A folder of left and right pictures, or of side-by-side ones, with a calibration beside them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage.calibration.files import find_calibration, load_rig
from pilotage.errors import InputError
from pilotage.recordings.frames import Truth
from pilotage.recordings.pairs import Pair, PairRecording, check_times, match_names, steady_times
from pilotage.recordings.pictures import list_pictures
from pilotage.recordings.times import times_in_names
from pilotage.recordings.truth import body_from_left, find_truth

# Folders that may hold the pictures, and the names of one folder a side.
PICTURE_FOLDERS = ("", "images", "data", "frames")
SIDE_FOLDERS = (
    ("left", "right"), ("Left", "Right"), ("L", "R"), ("l", "r"), ("image_left", "image_right"),
    ("images_left", "images_right"), ("left_images", "right_images"), ("cam0", "cam1"), ("0", "1"),
)  # fmt: skip
# How left and right names differ: at the end (a_left, a-L, a_0) or at the start (left01, cam0_01).
LEFT_WORDS, RIGHT_WORDS = ("left", "cam0", "l", "0"), ("right", "cam1", "r", "1")
NAME_PATTERNS = (r"(?P<key>.*?)[ _.-]{side}", r"{side}[ _.-]?(?P<key>.+)", r"(?P<key>.*){side}")


class ImagesRecording(PairRecording):
    """Pairs by name; times from the names when they are times, else a steady rate."""

    looks_for = (
        "a folder of pictures: subfolders left and right, names that end or begin with left and "
        "right (or 0 and 1), or side-by-side pictures"
    )

    def __init__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> None:
        keys, lefts, rights = _find_sides(path)
        self._calibration = calibration or _find_calibration(path)
        rig = load_rig(self._calibration)
        times_ns = _times(keys, lefts[0].parent, rate_hz)
        pairs = [Pair(*row) for row in zip(times_ns, lefts, rights, strict=True)]
        super().__init__(path, pairs, rig)

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by pictures in one of the known folders."""
        sides = [name for names in SIDE_FOLDERS for name in names]
        return any(
            list_pictures(path / folder / side)
            for folder in PICTURE_FOLDERS
            for side in ("", *sides)
        )

    def truth(self) -> Truth | None:
        """Return the poses beside the pictures, of the left camera or by T_BS of the body."""
        return find_truth(self.path, self._body_from_left)

    def _body_from_left(self) -> NDArray[np.float64] | None:
        return body_from_left(self.rig, self._calibration, find_calibration(self.path))


def _find_sides(path: Path) -> tuple[list[str], list[Path], list[Path | None]]:
    """Return names without their side, left and right pictures; right is None side by side."""
    for folder in PICTURE_FOLDERS:
        for left_name, right_name in SIDE_FOLDERS:
            lefts = list_pictures(path / folder / left_name)
            rights = list_pictures(path / folder / right_name)
            if lefts or rights:
                return _pair_folders(lefts, rights, path / folder)
        pictures = list_pictures(path / folder)
        if pictures:
            return _pair_names(pictures, path / folder)
    raise InputError(f"{path}: holds no pictures; looked for {ImagesRecording.looks_for}")


def _pair_folders(
    lefts: list[Path], rights: list[Path], folder: Path
) -> tuple[list[str], list[Path], list[Path | None]]:
    """Pair by name, or by what is left of the names without the words for the sides."""
    sides = []
    for files, words in ((lefts, LEFT_WORDS[:2]), (rights, RIGHT_WORDS[:2])):
        side = re.compile("|".join(words), re.IGNORECASE)
        sides.append({side.sub("", file.stem): file for file in files})
    left, right = sides
    if (len(left), len(right)) != (len(lefts), len(rights)):
        left, right = ({file.stem: file for file in files} for files in (lefts, rights))
    keys = match_names(left, right, folder)
    return keys, [left[key] for key in keys], [right[key] for key in keys]


def _pair_names(
    pictures: list[Path], folder: Path
) -> tuple[list[str], list[Path], list[Path | None]]:
    for left_word, right_word in zip(LEFT_WORDS, RIGHT_WORDS, strict=True):
        for pattern in NAME_PATTERNS:
            left = _matching(pictures, pattern, left_word)
            right = _matching(pictures, pattern, right_word)
            # Some without a side would mean that the sides are read into the names.
            if left and right and len(left) + len(right) == len(pictures):
                keys = match_names(left, right, folder)
                return keys, [left[key] for key in keys], [right[key] for key in keys]
    return [f.stem for f in pictures], pictures, [None] * len(pictures)


def _matching(pictures: list[Path], pattern: str, side: str) -> dict[str, Path]:
    compiled = re.compile(pattern.format(side=side), re.IGNORECASE)
    found = ((compiled.fullmatch(file.stem), file) for file in pictures)
    return {match["key"]: file for match, file in found if match}


def _times(keys: list[str], folder: Path, rate_hz: float | None) -> list[int]:
    if rate_hz is not None:
        return steady_times(len(keys), rate_hz)
    times_ns = times_in_names(keys, folder)
    if times_ns is None:
        return steady_times(len(keys), None)
    check_times(times_ns, folder)
    return times_ns


def _find_calibration(path: Path) -> Path:
    for folder in PICTURE_FOLDERS:
        found = find_calibration(path / folder)
        if found is not None:
            return found
    raise InputError(
        f"{path}: holds pictures but no calibration; put rig.yaml (or left.yaml and right.yaml, "
        "or a Kalibr camchain.yaml) beside them, or give one (--calibration)"
    )
