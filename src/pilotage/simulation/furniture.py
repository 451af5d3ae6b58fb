# SPDX-License-Identifier: Apache-2.0
"""Furniture of an office, each piece against a wall, made of boxes and cylinders."""

from __future__ import annotations

import math

from pilotage.simulation.room import Wall
from pilotage.simulation.scene import Part, Scene

DEEPEST_M = 1.35  # a desk with its chair, from the wall
WIDEST_M = 1.6


def add_desk(scene: Scene, wall: Wall, along_m: float) -> None:
    """Add a desk with a screen and a chair before it."""
    rng, part = scene.rng, wall.part
    top = scene.surface("wood", name="desk", scale=0.7)
    metal = scene.paint("metal", (0.6, 0.6, 0.62))
    part.geom("box", [0.7, 0.35, 0.015], [along_m, 0.37, 0.725], top)
    for side in (-0.64, 0.64):
        for depth in (0.08, 0.66):
            part.geom("box", [0.025, 0.025, 0.355], [along_m + side, depth, 0.355], metal)
    dark = scene.paint("screen", (0.06, 0.06, 0.07))
    part.geom("box", [0.27, 0.015, 0.17], [along_m + rng.uniform(-0.2, 0.2), 0.2, 1.0], dark)
    _add_chair(scene, part, along_m + rng.uniform(-0.25, 0.25), rng.uniform(0.85, 1.05))


def add_shelf(scene: Scene, wall: Wall, along_m: float) -> None:
    """Add a shelf full of books of many colours."""
    rng, part = scene.rng, wall.part
    wood = scene.surface("wood", name="shelf", scale=0.6)
    width, depth, height = 0.9, 0.32, 1.9
    for side in (-1, 1):
        at = [along_m + side * width / 2, depth / 2, height / 2]
        part.geom("box", [0.012, depth / 2, height / 2], at, wood)
    part.geom("box", [width / 2, 0.006, height / 2], [along_m, 0.006, height / 2], wood)
    for level in range(6):
        base = 0.02 + level * 0.375
        part.geom("box", [width / 2, depth / 2, 0.012], [along_m, depth / 2, base], wood)
        book_m = along_m - width / 2 + 0.02
        while level < 5 and book_m < along_m + width / 2 - 0.08:
            thick, tall = rng.uniform(0.015, 0.04), rng.uniform(0.2, 0.32)
            paint = scene.paint(f"book_{rng.integers(24)}", rng.uniform(0.08, 0.85, 3).tolist())
            middle = [book_m + thick, 0.17, base + 0.012 + tall / 2]
            part.geom("box", [thick, 0.11, tall / 2], middle, paint, solid=False)
            book_m += 2 * thick + (rng.uniform(0.05, 0.2) if rng.random() < 0.15 else 0.002)


def add_cabinet(scene: Scene, wall: Wall, along_m: float) -> None:
    """Add a low cabinet with a plant on it."""
    part = wall.part
    grey = scene.paint("cabinet", (0.55, 0.57, 0.6))
    part.geom("box", [0.5, 0.22, 0.4], [along_m, 0.23, 0.4], grey)
    pot = scene.paint("pot", (0.5, 0.25, 0.15))
    part.geom("cylinder", [0.09, 0.08], [along_m + 0.2, 0.23, 0.88], pot)
    leaves = scene.surface("leaves")
    part.geom("ellipsoid", [0.16, 0.14, 0.2], [along_m + 0.2, 0.23, 1.12], leaves, solid=False)


def add_round_table(scene: Scene, x_m: float, y_m: float) -> None:
    """Add a round table on one leg."""
    part = scene.body("round_table", [x_m, y_m, 0])
    top = scene.surface("wood", name="desk", scale=0.7)
    metal = scene.paint("metal", (0.6, 0.6, 0.62))
    part.geom("cylinder", [0.5, 0.015], [0, 0, 0.735], top)
    part.geom("cylinder", [0.035, 0.35], [0, 0, 0.37], metal)
    part.geom("cylinder", [0.28, 0.012], [0, 0, 0.012], metal)


def _add_chair(scene: Scene, part: Part, along_m: float, depth_m: float) -> None:
    fabric = scene.surface("carpet", name="chair", scale=0.5)
    metal = scene.paint("metal", (0.6, 0.6, 0.62))
    part.geom("box", [0.22, 0.22, 0.03], [along_m, depth_m, 0.45], fabric)
    part.geom("box", [0.21, 0.025, 0.22], [along_m, depth_m + 0.22, 0.78], fabric)
    part.geom("cylinder", [0.03, 0.2], [along_m, depth_m, 0.23], metal)
    for spoke in range(5):
        angle = 2 * math.pi * spoke / 5
        tip = [along_m + 0.22 * math.cos(angle), depth_m + 0.22 * math.sin(angle)]
        line = [along_m, depth_m, 0.06, *tip, 0.03]
        part.geom("capsule", [0.018], [0, 0, 0], metal, fromto=line)
