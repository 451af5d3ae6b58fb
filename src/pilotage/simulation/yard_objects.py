# SPDX-License-Identifier: Apache-2.0
"""What stands in a yard: poles, boxes, walls, trees."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pilotage.simulation.layout import Circle
from pilotage.simulation.scene import Part, Scene

SUNK_M = 0.2  # into the ground, so that nothing hovers over a slope
CROWN_M = 1.2  # leaves hang no lower
KINDS = ("pole", "box", "wall", "tree")
SHARES = (0.2, 0.35, 0.15, 0.3)
# The circle an object stands in, metres; a tree's is its trunk's and the roots' surroundings.
RADII_M = {"pole": (0.05, 0.12), "box": (0.25, 0.9), "wall": (0.9, 2.0), "tree": (0.4, 0.7)}


def pick_object(rng: np.random.Generator) -> str:
    """Return the kind of the next object."""
    return KINDS[int(rng.choice(len(KINDS), p=SHARES))]


def object_radius_m(rng: np.random.Generator, kind: str) -> float:
    """Return the radius of the circle the object will stand in."""
    return float(rng.uniform(*RADII_M[kind]))


def add_object(scene: Scene, kind: str, name: str, spot: Circle, height_m: float) -> None:
    """Add an object within the circle, its foot at `height_m`."""
    yaw_rad = scene.rng.uniform(-math.pi, math.pi)
    body = scene.body(name, [spot.x_m, spot.y_m, height_m], yaw_rad)
    ADD[kind](scene, body, spot.radius_m)


def _add_pole(scene: Scene, body: Part, radius_m: float) -> None:
    height = scene.rng.uniform(1.0, 3.0)
    paint = scene.paint(f"paint_{scene.rng.integers(6)}", scene.rng.uniform(0.1, 0.9, 3).tolist())
    half = (height + SUNK_M) / 2
    body.geom("cylinder", [radius_m, half], [0, 0, height - half], paint)


def _add_box(scene: Scene, body: Part, radius_m: float) -> None:
    rng = scene.rng
    angle = rng.uniform(0.5, 1.07)
    sides = [radius_m * math.cos(angle), radius_m * math.sin(angle)]
    height = rng.uniform(0.3, 1.2)
    kind = ("wood", "poster", "brick")[int(rng.integers(3))]
    half = (height + SUNK_M) / 2
    body.geom("box", [*sides, half], [0, 0, height - half], scene.surface(kind))


def _add_wall(scene: Scene, body: Part, radius_m: float) -> None:
    height, thick = scene.rng.uniform(0.6, 2.2), 0.12
    kind = ("brick", "plaster")[int(scene.rng.integers(2))]
    half = (height + SUNK_M) / 2
    length = math.sqrt(radius_m**2 - thick**2)
    body.geom("box", [length, thick, half], [0, 0, height - half], scene.surface(kind))


def _add_tree(scene: Scene, body: Part, radius_m: float) -> None:
    rng = scene.rng
    trunk, height = rng.uniform(0.07, 0.16), rng.uniform(1.6, 3.0)
    half = (height + SUNK_M) / 2
    body.geom("capsule", [trunk, half], [0, 0, height - half], scene.surface("bark"))
    leaves = scene.surface("leaves")
    # Crowns end above any robot and may touch those of the next tree.
    for _ in range(int(rng.integers(2, 5))):
        size = rng.uniform(0.5, 0.9, 3) * (0.6 + radius_m)
        lowest = max(height, CROWN_M + size[2])
        at = [*rng.uniform(-0.4, 0.4, 2), lowest + size[2] * rng.uniform(0.0, 0.6)]
        body.geom("ellipsoid", size, at, leaves, solid=False)


ADD: dict[str, Callable[[Scene, Part, float], None]] = {
    "pole": _add_pole,
    "box": _add_box,
    "wall": _add_wall,
    "tree": _add_tree,
}
