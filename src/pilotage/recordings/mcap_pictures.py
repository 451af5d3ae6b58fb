# SPDX-License-Identifier: Apache-2.0
"""Pictures of ROS 2 messages as grey ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotage.recordings import ros_messages as ros
from pilotage.recordings.frames import Grey
from pilotage.recordings.pictures import PictureError, decode_grey, to_grey

# Channels, bytes a channel, and whether red comes first.
ENCODINGS = {
    "mono8": (1, 1, False),
    "8UC1": (1, 1, False),
    "mono16": (1, 2, False),
    "16UC1": (1, 2, False),
    "rgb8": (3, 1, True),
    "bgr8": (3, 1, False),
    "8UC3": (3, 1, False),
    "rgba8": (4, 1, True),
    "bgra8": (4, 1, False),
}


def decode_message(data: bytes, type_name: str, place: str) -> Grey:
    """Return the picture of an Image or CompressedImage, (height, width) uint8.

    PictureError, naming `place`, says why there is none.
    """
    try:
        message = ros.read_message(data, type_name)
    except ros.MessageError as error:
        raise PictureError(f"{place}: {error}") from None
    if type_name == ros.COMPRESSED_IMAGE:
        return decode_grey(message.data.tobytes(), place)
    return to_grey(_pixels(message, place), place)


def _pixels(message: Any, place: str) -> NDArray[Any]:
    """Return (height, width) or (height, width, channels), blue first, of 8 or 16 bits."""
    if message.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise PictureError(f"{place}: encoding {message.encoding[:40]!r}; must be one of {known}")
    channels, depth, is_red_first = ENCODINGS[message.encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * depth
    if not 0 < row <= step or height < 1 or message.data.size < step * height:
        raise PictureError(
            f"{place}: {message.data.size} bytes, too few for {width}x{height} px of "
            f"{message.encoding} with {step} bytes a row"
        )
    rows = message.data[: step * height].reshape(height, step)[:, :row]
    order = ">u2" if message.is_bigendian else "<u2"
    pixels = np.ascontiguousarray(rows).view(np.uint8 if depth == 1 else order)
    pixels = pixels.astype(np.uint8 if depth == 1 else np.uint16, copy=False)
    if channels == 1:
        return pixels.reshape(height, width)
    pixels = pixels.reshape(height, width, channels)
    if is_red_first:
        pixels = pixels[..., [2, 1, 0, 3][:channels]]
    return np.ascontiguousarray(pixels)
