# SPDX-License-Identifier: Apache-2.0
"""What the light passes before the sensor: blur, covers, dirt, glare."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from pilotage.simulation.camera_faults import CameraActing
from pilotage.simulation.exposure import Radiance

DIRT_RADIUS = (0.03, 0.10)  # of a blotch, over the picture's width
DIRT_DIMS = 0.85  # part of the light that is missing in a blotch
DIRT_SCATTERS = 0.1  # part of the mean light that it gives instead
# Over the mean radiance: bright enough to stay white when the exposure is cut down to it.
GLARE, VEIL = 60.0, 0.5
EDGE = 0.02  # blur of the edge of what lies on the lens, over the picture's width


class Lens:
    """The front of one camera; where blotches and glare lie comes from `seed`."""

    def __init__(self, blur_px: float, seed: list[int]) -> None:
        self._blur_px = blur_px
        self._seed = seed
        self._masks: dict[tuple[object, ...], Radiance] = {}

    def pass_on(self, radiance: Radiance, acting: CameraActing) -> Radiance:
        """Return the light behind the lens, (H, W) or (H, W, 3)."""
        blur_px = math.hypot(self._blur_px, acting.blur_px)
        light: Any = radiance
        if acting.darkness > 0:
            light = light * np.float32(1 - acting.darkness)
        if blur_px > 0:
            light = cv2.GaussianBlur(light, (0, 0), blur_px)
        mean = float(light.mean()) if acting.dirt > 0 or acting.glare > 0 else 0.0
        if acting.dirt > 0:
            dim = self._mask(_blotches, acting.dirt, radiance.shape)
            light = light * (1 - DIRT_DIMS * dim) + np.float32(DIRT_SCATTERS * mean) * dim
        if acting.glare > 0:
            light = light + np.float32(VEIL * mean)
            light += np.float32(GLARE * mean) * self._mask(_dazzled, acting.glare, radiance.shape)
        if acting.blind > 0:
            light = light * (1 - self._mask(_covered, acting.blind, radiance.shape))
        return np.asarray(light, np.float32)

    def _mask(
        self,
        paint: Callable[[tuple[int, int], float, np.random.Generator], Radiance],
        share: float,
        shape: tuple[int, ...],
    ) -> Radiance:
        key = (paint, share, shape)
        if key not in self._masks:
            random = np.random.default_rng([*self._seed, *map(ord, paint.__name__)])
            mask = np.asarray(paint((shape[0], shape[1]), share, random), np.float32)
            self._masks[key] = mask[..., None] if len(shape) == 3 else mask
        return self._masks[key]


def _covered(size: tuple[int, int], share: float, random: np.random.Generator) -> Radiance:
    """Return a cover that comes in from the left, its edge out of focus."""
    del random
    height, width = size
    x = (np.arange(width) + 0.5) / width
    edge = np.clip(0.5 + (share - x) / EDGE, 0, 1) if share < 1 else np.ones(width)
    return np.asarray(np.broadcast_to(edge, (height, width)), np.float32)


def _blotches(size: tuple[int, int], share: float, random: np.random.Generator) -> Radiance:
    """Return round blotches, far out of focus, thrown until they cover the share."""
    height, width = size
    covered = np.zeros(size, np.float32)
    while covered.mean() < share:
        x, y = random.uniform(0, width), random.uniform(0, height)
        radius = max(1.0, random.uniform(*DIRT_RADIUS) * width)
        cv2.circle(covered, (round(x), round(y)), round(radius), 1.0, thickness=-1)
    return np.asarray(cv2.GaussianBlur(covered, (0, 0), EDGE * width), np.float32)


def _dazzled(size: tuple[int, int], share: float, random: np.random.Generator) -> Radiance:
    """Return a bright disc that fills the share, with a halo about it."""
    height, width = size
    x0, y0 = random.uniform(0.2, 0.8) * width, random.uniform(0.0, 0.5) * height
    y, x = np.mgrid[:height, :width]
    away = np.hypot(x - x0, y - y0)
    radius = max(1.0, float(np.quantile(away, share)))
    halo = 0.05 * (radius / np.maximum(away, radius)) ** 2
    return np.asarray(np.where(away <= radius, 1.0, halo), np.float32)
