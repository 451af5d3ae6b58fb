# SPDX-License-Identifier: Apache-2.0
"""Picture files: listed in natural order, decoded to grey, checked for being whole."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage.recordings.frames import Grey

SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff", ".webp"}
LARGEST_FILE_BYTES = 256 * 1024 * 1024


class PictureError(Exception):
    """Why one picture cannot be used; becomes a BadFrame or an InputError."""


def natural_key(file: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Return a key that sorts image2 before image10."""
    # Every second part is a number; without leading zeros, longer means larger.
    parts = re.split(r"([0-9]+)", file.name)
    digits = [part.lstrip("0") for part in parts]
    words = [(0, len(d), d) if i % 2 else (1, 0, parts[i]) for i, d in enumerate(digits)]
    return words, file.name


def list_pictures(folder: Path) -> list[Path]:
    """Return the pictures of a folder in natural order; empty when it is no folder."""
    if not folder.is_dir():
        return []
    files = (f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES and f.is_file())
    return sorted((f for f in files if not f.name.startswith(".")), key=natural_key)


def read_grey(file: Path) -> Grey:
    """Return (height, width) uint8: colour by OpenCV's weights, 16 bit scaled to 8, no rotation.

    Raises PictureError when the file is missing, empty, cut short or no picture.
    """
    return decode_grey(_content(file), file)


def read_color(file: Path) -> NDArray[np.uint8]:
    """Return (height, width, 3) uint8: red, green, blue; no rotation, so pixels are `read_grey`'s.

    Raises PictureError alike.
    """
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(np.frombuffer(_content(file), np.uint8), flags)
    except (cv2.error, MemoryError):
        picture = None
    if picture is None or picture.size == 0:
        raise PictureError(f"{file}: no picture that can be decoded")
    return np.asarray(picture[..., ::-1], np.uint8)


def _content(file: Path) -> bytes:
    try:
        if file.stat().st_size > LARGEST_FILE_BYTES:
            raise PictureError(f"{file}: larger than {LARGEST_FILE_BYTES} bytes")
        return file.read_bytes()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise PictureError(f"{file}: cannot be read ({reason})") from None


def decode_grey(data: bytes, file: Path | str) -> Grey:
    """Decode the bytes of one picture file, named `file` in errors; see `read_grey`."""
    if not data:
        raise PictureError(f"{file}: empty")
    if _is_cut_short(data):
        raise PictureError(f"{file}: cut short after {len(data)} bytes")
    try:
        # UNCHANGED leaves 16 bits alone and ignores the EXIF rotation.
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except (cv2.error, MemoryError):
        picture = None
    if picture is None or picture.size == 0:
        raise PictureError(f"{file}: no picture that can be decoded")
    return to_grey(picture, file)


def to_grey(picture: np.ndarray, file: Path | str) -> Grey:
    """Return one channel of 8 bits."""
    if picture.dtype == np.uint16:
        picture = cv2.convertScaleAbs(picture, alpha=255 / 65535)
    if picture.dtype != np.uint8:
        raise PictureError(f"{file}: pixels of type {picture.dtype}; 8 or 16 bit are needed")
    channels = 1 if picture.ndim == 2 else picture.shape[2]
    if channels == 1:
        return np.ascontiguousarray(picture.reshape(picture.shape[:2]))
    if channels not in (3, 4):
        raise PictureError(f"{file}: {channels} channels; 1, 3 or 4 are needed")
    code = cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY
    return np.asarray(cv2.cvtColor(picture, code), np.uint8)


def _is_cut_short(data: bytes) -> bool:
    """Decoders fill the rest of a cut file with grey; such a picture must not be trusted."""
    if data.startswith(b"\xff\xd8"):
        # The last scan (SOS) must be followed by the end marker (EOI); neither occurs inside one.
        scan = data.rfind(b"\xff\xda")
        return scan < 0 or data.find(b"\xff\xd9", scan) < 0
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data[-4096:]
    return False
