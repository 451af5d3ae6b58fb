# SPDX-License-Identifier: Apache-2.0
"""Rooms: walls with doors, posters and skirting, floors, ceilings with lamps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pilotage.simulation.grounds import FLOORS
from pilotage.simulation.paths import Points
from pilotage.simulation.scene import Part, Scene

HEIGHT_M = 2.6
THICK_M = 0.1
DOOR_M = (0.9, 2.05)
WHITE = (0.9, 0.9, 0.88)


@dataclass(frozen=True)
class Wall:
    """A wall: x of `part` runs along it from 0 to `length_m`, y points into the room."""

    part: Part
    length_m: float


def add_floor(scene: Scene, kind: str) -> None:
    """Add the floor, one of `FLOORS`, at height 0."""
    material = scene.surface(kind, name="floor")
    contact = FLOORS[kind].attributes()
    scene.world.geom("plane", [0, 0, 1], [0, 0, 0], material, name="ground", **contact)


def add_wall(scene: Scene, name: str, begin: Points, end: Points) -> Wall:
    """Add a wall from `begin` to `end` (2,), the room on its left, with a skirting board."""
    along = end - begin
    length_m = float(np.linalg.norm(along))
    part = scene.body(name, [*begin, 0], math.atan2(along[1], along[0]))
    half = length_m / 2
    # Longer by its thickness at both ends, so that outer corners close.
    part.geom(
        "box",
        [half + THICK_M, THICK_M / 2, HEIGHT_M / 2],
        [half, -THICK_M / 2, HEIGHT_M / 2],
        scene.surface("plaster", name="wall"),
    )
    skirting = scene.paint("skirting", WHITE)
    part.geom("box", [half, 0.006, 0.04], [half, 0.006, 0.04], skirting, solid=False)
    return Wall(part, length_m)


def add_door(scene: Scene, wall: Wall, along_m: float) -> None:
    """Add a closed door with frame and handle, its middle at `along_m`."""
    width, height = DOOR_M
    frame = scene.paint("frame", WHITE)
    size = [width / 2 + 0.06, 0.01, height / 2 + 0.03]
    wall.part.geom("box", size, [along_m, 0.01, height / 2 + 0.03], frame, solid=False)
    leaf = [width / 2, 0.015, height / 2]
    wood = scene.surface("wood", name="door", scale=1.5)
    wall.part.geom("box", leaf, [along_m, 0.015, height / 2], wood, solid=False)
    metal = scene.paint("metal", (0.6, 0.6, 0.62))
    wall.part.geom(
        "ellipsoid",
        [0.06, 0.025, 0.012],
        [along_m + width / 2 - 0.1, 0.05, 1.05],
        metal,
        solid=False,
    )


def add_poster(scene: Scene, wall: Wall, along_m: float, name: str) -> None:
    """Add a poster of its own surface at eye height."""
    rng = scene.rng
    half = [rng.uniform(0.25, 0.45), 0.003, rng.uniform(0.3, 0.5)]
    material = scene.surface("poster", name=name)
    at = [along_m, 0.003, rng.uniform(1.2, 1.6)]
    wall.part.geom("box", half, at, material, solid=False, name=name)


def add_ceiling(scene: Scene, middle: Points, half: Points) -> None:
    """Add a ceiling over the rectangle of half extents `half` (2,) around `middle` (2,)."""
    material = scene.surface("plaster", name="ceiling")
    scene.world.geom("box", [*half, 0.02], [*middle, HEIGHT_M + 0.02], material)


def add_lamp(scene: Scene, name: str, place: Points) -> None:
    """Add a lamp with its white panel under the ceiling."""
    panel = scene.paint("lamp_panel", (1.0, 1.0, 0.97))
    scene.world.geom("box", [0.3, 0.3, 0.01], [*place, HEIGHT_M - 0.01], panel, solid=False)
    scene.lamp(name, [*place, HEIGHT_M - 0.1])
