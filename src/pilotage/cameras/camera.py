# SPDX-License-Identifier: Apache-2.0
"""The protocol of a camera and the frames it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True)
class Frame:
    """What one camera, or the two of a stereo camera at once, saw.

    `timestamp_ns` is the middle of the exposure of the middle row, on the clock of the robot or,
    without one, of this machine. `pictures` maps frames (`front_left`, `top`) to (height, width)
    grey or (height, width, 3) blue-green-red pictures, as the camera gave them.
    """

    timestamp_ns: int
    pictures: Mapping[str, Picture]
    exposure_s: float | None = None


class Camera(Protocol):
    """A source of frames. `with` opens it and lets it go on every way out.

    A picture that does not come is None, for that is to be expected; DeviceError means that the
    camera is not open or is gone.
    """

    name: str
    frames: tuple[str, ...]  # the keys of every Frame's pictures

    def __enter__(self) -> Self:
        """Open the device and start it."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the device and let it go."""

    def read(self, *, timeout_s: float) -> Frame | None:
        """Wait for a frame newer than any given so far; None when none comes in time."""

    def latest(self, *, max_age_s: float) -> Frame | None:
        """Return the newest frame at once; None when it is older than that, or there is none."""
