# SPDX-License-Identifier: Apache-2.0
"""From light to the picture a sensor makes of it: exposure, gain, noise, 8 bits."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import _core
from pilotage.simulation.sensor import Sensor

Radiance = NDArray[np.float32]
Picture = NDArray[np.uint8]
WHITE = 255.0
DARKEST = 1e-6  # radiance below which no exposure is worth reckoning


class Exposer:
    """Regulates one exposure for all cameras that fire together.

    `light` is the light there is over that of a bright day.
    """

    def __init__(self, sensor: Sensor, *, light: float) -> None:
        self._sensor = sensor
        self._grey_s = WHITE * light / sensor.exposure_at_white_s  # grey a second of radiance 1
        self._wanted_s = 0.0  # exposure times gain

    @property
    def is_metered(self) -> bool:
        """Tell whether any light was seen yet."""
        return self._wanted_s > 0

    @property
    def exposure_s(self) -> float:
        """Return the exposure time of the next picture."""
        return self._sensor.exposure_s or min(self._wanted_s, self._sensor.longest_exposure_s)

    @property
    def gain(self) -> float:
        """Return the gain of the next picture, 1 or more."""
        return min(max(self._wanted_s / self.exposure_s, 1.0), self._sensor.largest_gain)

    @property
    def grey(self) -> float:
        """Return the grey value of radiance 1 in the next picture."""
        return self._grey_s * self.exposure_s * self.gain

    def regulate(self, brightness: float) -> None:
        """Move towards what suits a mean radiance; the first time all the way."""
        most_s = self._sensor.longest_exposure_s * self._sensor.largest_gain
        suiting_s = self._sensor.target_grey / (self._grey_s * max(DARKEST, brightness))
        if self._sensor.exposure_s:
            most_s = self._sensor.exposure_s * self._sensor.largest_gain
        suiting_s = min(suiting_s, most_s)
        if not self.is_metered:
            self._wanted_s = suiting_s
        self._wanted_s *= (suiting_s / self._wanted_s) ** self._sensor.reaction


class Imager:
    """One camera's sensor; `random` draws what differs from one to the next of its kind."""

    def __init__(self, sensor: Sensor, random: np.random.Generator) -> None:
        self._sensor = sensor
        self._sensitivity = max(0.1, 1 + sensor.gain_mismatch * float(random.standard_normal()))
        self._random = random
        self._maps: dict[tuple[int, ...], Radiance] = {}

    def expose(self, light: Radiance, exposer: Exposer, *, seed: int) -> Picture:
        """Return the (H, W), or (H, W, 3) blue-green-red, picture of light: grey, or red first.

        `seed` is that of the picture's noise, 0 to 2^64 - 1.
        """
        sensor = self._sensor
        picture: Picture = np.asarray(
            _core.expose(
                np.ascontiguousarray(light),
                self._map(light.shape),
                grey=exposer.grey,
                read_noise=sensor.read_noise * exposer.gain,
                # What a gain multiplies came from fewer electrons by as much.
                shot_noise2=sensor.shot_noise_at_white**2 * exposer.gain / WHITE,
                seed=seed,
            )
        )
        if picture.ndim == 3:
            picture = np.ascontiguousarray(picture[..., ::-1])
        return _compressed(picture, sensor.jpeg_quality) if sensor.jpeg_quality else picture

    def _map(self, shape: tuple[int, ...]) -> Radiance:
        """Return what each pixel makes of its light: vignetting, pattern, sensitivity."""
        if shape not in self._maps:
            height, width = shape[:2]
            y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
            fall = 1 - 0.5 * self._sensor.vignetting * (x**2 + y**2)
            fall = fall[..., None] if len(shape) == 3 else fall
            pattern = 1 + self._sensor.pattern * self._random.standard_normal(shape)
            sensitivity = self._sensitivity * fall * pattern
            self._maps[shape] = np.ascontiguousarray(sensitivity, np.float32)
        return self._maps[shape]


def _compressed(picture: Picture, quality: int) -> Picture:
    data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint8)
