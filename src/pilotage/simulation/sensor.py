# SPDX-License-Identifier: Apache-2.0
"""From radiance to the picture that a cheap camera makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Radiance = NDArray[np.float32]
Picture = NDArray[np.uint8]
WHITE = 255.0


@dataclass(frozen=True)
class Sensor:
    """A sensor and its lens, beside what the camera model says of the latter.

    Noise in grey values: of reading, and of light at white (it grows with the root of brightness).
    """

    blur_px: float = 0.6  # standard deviation of the lens
    vignetting: float = 0.2  # part of the light that is missing in the corners
    read_noise: float = 0.8
    shot_noise_at_white: float = 2.5
    target_grey: float = 110.0  # mean that the exposure is regulated to
    reaction: float = 0.3  # part of the way there, each picture


class Exposer:
    """Makes pictures of radiance; regulates one exposure for all cameras it serves."""

    def __init__(self, sensor: Sensor, *, seed: int) -> None:
        self._sensor = sensor
        self._random = np.random.default_rng([77, seed])
        self._gain = 0.0
        self._vignettes: dict[tuple[int, ...], Radiance] = {}

    def regulate(self, radiance: Radiance) -> None:
        """Move the exposure towards what suits this view; the first time all the way."""
        wanted = self._sensor.target_grey / max(1e-6, float(radiance.mean()))
        share = self._sensor.reaction if self._gain else 1.0
        self._gain += share * (wanted - self._gain)

    def expose(self, radiance: Radiance) -> Picture:
        """Return the (H, W) or (H, W, 3) picture of `radiance` with noise, clipped to 8 bits."""
        sensor = self._sensor
        light: Any = cv2.GaussianBlur(radiance, (0, 0), sensor.blur_px) * self._gain
        light *= self._vignette(radiance.shape)
        shot = sensor.shot_noise_at_white * np.sqrt(np.clip(light, 0, WHITE) / WHITE)
        noise = self._random.standard_normal(radiance.shape, dtype=np.float32)
        light += noise * np.sqrt(shot**2 + sensor.read_noise**2, dtype=np.float32)
        return np.asarray(np.clip(light + 0.5, 0, WHITE), np.uint8)

    def _vignette(self, shape: tuple[int, ...]) -> Radiance:
        if shape not in self._vignettes:
            height, width = shape[:2]
            y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
            fall = (1 - 0.5 * self._sensor.vignetting * (x**2 + y**2)).astype(np.float32)
            self._vignettes[shape] = fall[..., None] if len(shape) == 3 else fall
        return self._vignettes[shape]
