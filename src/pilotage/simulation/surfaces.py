# SPDX-License-Identifier: Apache-2.0
"""What grounds and things look like to a rendered camera: noise of several sizes, photographs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from pilotage import _core

Array = NDArray[np.float64]
SIDE = 512
# A sample's values are kept within this many standard deviations.
WIDEST_SIGMA = 3.0


@dataclass(frozen=True)
class Band:
    """Detail of some size: a style, metres a texel, and its standard deviation over the albedo."""

    style: str
    texel_m: float
    contrast: float


SURFACES: dict[str, tuple[Band, ...]] = {
    "asphalt": (Band("grains", 0.0006, 0.22), Band("octaves", 0.01, 0.14)),
    "soil": (
        Band("octaves", 0.0005, 0.20),
        Band("grains", 0.002, 0.14),
        Band("octaves", 0.02, 0.18),
    ),
    "sand": (Band("grains", 0.0003, 0.14), Band("octaves", 0.004, 0.10)),
    "carpet": (Band("fibres", 0.0004, 0.18), Band("octaves", 0.008, 0.10)),
    "plaster": (Band("octaves", 0.0006, 0.06), Band("octaves", 0.012, 0.07)),
    "wood": (Band("fibres", 0.0012, 0.16), Band("octaves", 0.02, 0.10)),
    "grass": (
        Band("octaves", 0.0003, 0.08),
        Band("photographed grass", 0.001, 0.32),
        Band("octaves", 0.02, 0.16),
    ),
    "gravel": (
        Band("octaves", 0.0003, 0.07),
        Band("photographed gravel", 0.001, 0.31),
        Band("octaves", 0.02, 0.10),
    ),
    "brick": (
        Band("octaves", 0.0004, 0.08),
        Band("photographed brick", 0.0018, 0.23),
        Band("octaves", 0.02, 0.08),
    ),
    "poster": (Band("grains", 0.004, 0.45), Band("octaves", 0.01, 0.20)),
    "bark": (Band("fibres", 0.001, 0.30), Band("octaves", 0.01, 0.16)),
    "leaves": (Band("grains", 0.004, 0.40), Band("octaves", 0.02, 0.20)),
}


def octaves(random: np.random.Generator) -> Array:
    """Return (SIDE, SIDE) noise of equal strength in every octave."""
    return _shaped(random, np.hypot)


def fibres(random: np.random.Generator) -> Array:
    """Return the same drawn out along y, as threads, blades and grain are."""
    return _shaped(random, lambda fx, fy: np.hypot(0.4 * fx, 3.0 * fy))


def grains(random: np.random.Generator) -> Array:
    """Return stones: cells about random points, each of one brightness, dark between them."""
    points = random.uniform(0, SIDE, (SIDE * SIDE // 60, 2))
    shade = random.normal(size=len(points))
    y, x = np.mgrid[:SIDE, :SIDE]
    places = np.column_stack([x.ravel(), y.ravel()])
    away, nearest = cKDTree(points, boxsize=SIDE).query(places, k=2)
    between = np.exp(-(((away[:, 1] - away[:, 0]) / 1.5) ** 2))
    values = shade[nearest[:, 0]] - 1.5 * between
    return np.asarray(gaussian_filter(values.reshape(SIDE, SIDE), 0.6, mode="wrap"))


def photograph(name: str) -> Array:
    """Return one of the pictures in `textures/`, (SIDE, SIDE), made to wrap around.

    Its periodic component (Moisan 2011): what is left without the smooth picture that takes up the
    jumps between opposite edges.
    """
    data = resources.files("pilotage.simulation").joinpath(f"textures/{name}.png").read_bytes()
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    values = np.asarray(picture, np.float64)
    jumps = np.zeros_like(values)
    jumps[0] = values[-1] - values[0]
    jumps[-1] = -jumps[0]
    sideways = values[:, -1] - values[:, 0]
    jumps[:, 0] += sideways
    jumps[:, -1] -= sideways
    turns = 2 * np.cos(2 * np.pi * np.fft.fftfreq(SIDE))
    laplacian = turns[:, None] + turns[None] - 4
    laplacian[0, 0] = 1
    spectrum = np.fft.fft2(jumps) / laplacian
    spectrum[0, 0] = 0
    return np.asarray(values - np.fft.ifft2(spectrum).real)


STYLES: dict[str, Callable[[np.random.Generator], Array]] = {
    "octaves": octaves,
    "fibres": fibres,
    "grains": grains,
    "photographed grass": lambda _: photograph("grass"),
    "photographed gravel": lambda _: photograph("gravel"),
    "photographed brick": lambda _: photograph("brick"),
}
WITH_GRAIN = {"fibres", "photographed brick"}


class SurfacePainter:
    """Makes the surfaces of one scene; samples are drawn once for each style."""

    def __init__(self, scene: _core.Scene) -> None:
        self._scene = scene
        self._exemplars: dict[str, int] = {}

    def layers(
        self, kind: str, *, albedo: float, seed: int, scale: float
    ) -> list[_core.SurfaceLayer]:
        """Return the surface `kind` on that mean albedo; `scale` 2 is twice as coarse."""
        return [
            _core.SurfaceLayer(
                exemplar=self._exemplar(band.style),
                amplitude=WIDEST_SIGMA * band.contrast * albedo,
                texel_m=scale * band.texel_m,
                seed=(seed + 7919 * number) % 2**32,
                has_grain=band.style in WITH_GRAIN,
            )
            for number, band in enumerate(SURFACES[kind])
        ]

    def _exemplar(self, style: str) -> int:
        if style not in self._exemplars:
            random = np.random.default_rng(list(STYLES).index(style))
            values = STYLES[style](random)
            values = (values - values.mean()) / (WIDEST_SIGMA * values.std())
            sample = np.ascontiguousarray(np.clip(values, -1, 1), np.float32)
            self._exemplars[style] = self._scene.add_exemplar(sample)
        return self._exemplars[style]


def _shaped(random: np.random.Generator, frequency: Callable[[Array, Array], Array]) -> Array:
    fy, fx = np.meshgrid(np.fft.fftfreq(SIDE), np.fft.fftfreq(SIDE), indexing="ij")
    # Power over the squared frequency: equal in every octave of a picture.
    size = np.maximum(frequency(fx, fy), 1.0 / SIDE)
    spectrum = np.fft.fft2(random.normal(size=(SIDE, SIDE))) / size
    spectrum[0, 0] = 0
    return np.asarray(np.fft.ifft2(spectrum).real)
