# SPDX-License-Identifier: Apache-2.0
"""A long hallway with corners, doors, posters, and a few things along its walls."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from pilotage.simulation.grounds import FLOORS
from pilotage.simulation.marks import add_mark
from pilotage.simulation.options import chosen, ranged
from pilotage.simulation.paths import Points
from pilotage.simulation.room import (
    DOOR_M,
    Wall,
    add_ceiling,
    add_door,
    add_floor,
    add_lamp,
    add_poster,
    add_wall,
)
from pilotage.simulation.scene import Scene

ANY = "any"
BEHIND_M = 2.0  # of the hallway behind the start
LAMP_EVERY_M = 4.0


@dataclass(frozen=True)
class CorridorOptions:
    """What may be chosen; `length_m` is that of the whole hallway along its middle."""

    floor: str = chosen(ANY, [ANY, *FLOORS])
    length_m: float = ranged(36.0, 12.0, 400.0)
    width_m: float = ranged(2.2, 1.6, 5.0)
    corners: int = ranged(2, 0, 8)
    objects: int = ranged(6, 0, 100)


def build_corridor(scene: Scene, options: CorridorOptions) -> None:
    """Fill `scene`; the robot starts at the world's origin in the middle, along x."""
    kinds = list(FLOORS)
    kind = options.floor if options.floor != ANY else kinds[int(scene.rng.integers(len(kinds)))]
    scene.start(0, 0, 0)
    add_floor(scene, kind)
    middle = _middle_line(scene.rng, options)
    walls = []
    for number, (begin, end) in enumerate(_wall_lines(middle, options.width_m)):
        wall = add_wall(scene, f"wall_{number}", begin, end)
        _furnish(scene, wall, number)
        walls.append(wall)
    _add_ceilings(scene, middle, options.width_m)
    _add_objects(scene, walls, options)
    aside = options.width_m / 2 - 0.7
    add_mark(scene, "a", (2.5, float(scene.rng.uniform(-aside, aside)), 0.0))
    before_end = middle[-1] - 1.2 * _directions(middle)[-1]
    add_mark(scene, "b", (float(before_end[0]), float(before_end[1]), 0.0))


def _middle_line(rng: np.random.Generator, options: CorridorOptions) -> Points:
    """Return the corners (N, 2); turns alternate, so that the hallway never meets itself."""
    parts = options.corners + 1
    shares = rng.uniform(0.7, 1.3, parts)
    lengths = np.maximum(options.length_m * shares / shares.sum(), 2 * options.width_m)
    lengths[0] = max(lengths[0], BEHIND_M + 4.5)
    side = 1 if rng.random() < 0.5 else -1
    points = [np.array([-BEHIND_M, 0.0])]
    for number, length in enumerate(lengths):
        direction = np.array([1.0, 0.0]) if number % 2 == 0 else np.array([0.0, float(side)])
        points.append(points[-1] + length * direction)
    return np.array(points)


def _directions(middle: Points) -> Points:
    steps = np.diff(middle, axis=0)
    return np.asarray(steps / np.linalg.norm(steps, axis=1)[:, None])


def _wall_lines(middle: Points, width_m: float) -> list[tuple[Points, Points]]:
    """Return begin and end of each wall, the hallway on its left."""
    along = _directions(middle)
    left = np.column_stack([-along[:, 1], along[:, 0]])
    # At a right angle the offsets of both sides add up to the corner of the wall.
    inner = [(left[i - 1] + left[i]) for i in range(1, len(left))]
    offsets = np.array([left[0], *inner, left[-1]]) * width_m / 2
    right_side, left_side = middle - offsets, middle + offsets
    around = np.concatenate([right_side, left_side[::-1]])
    return [(around[i], around[(i + 1) % len(around)]) for i in range(len(around))]


def _furnish(scene: Scene, wall: Wall, number: int) -> None:
    """Put doors and posters along a wall, each in its own stretch."""
    rng = scene.rng
    at = rng.uniform(0.8, 1.6)
    while at + DOOR_M[0] < wall.length_m - 0.3:
        middle = at + DOOR_M[0] / 2
        if rng.random() < 0.55:
            add_door(scene, wall, middle)
        else:
            add_poster(scene, wall, middle, f"poster_{number}_{round(100 * middle)}")
        at += DOOR_M[0] + rng.uniform(0.4, 1.6)


def _add_ceilings(scene: Scene, middle: Points, width_m: float) -> None:
    for number, (begin, end) in enumerate(itertools.pairwise(middle)):
        half = np.abs(end - begin) / 2 + width_m / 2
        add_ceiling(scene, (begin + end) / 2, half)
        length = float(np.linalg.norm(end - begin))
        for lamp, along in enumerate(np.arange(1.0, length - 0.5, LAMP_EVERY_M)):
            place = begin + (end - begin) * along / length
            add_lamp(scene, f"lamp_{number}_{lamp}", place)


def _add_objects(scene: Scene, walls: list[Wall], options: CorridorOptions) -> None:
    """Stand bins and cartons against the walls, one at most in each stretch of a metre."""
    rng = scene.rng
    slots = [
        (wall, along)
        for wall in walls
        for along in np.arange(1.5, wall.length_m - 1.5, 1.0)
        if wall.length_m > 2 * options.width_m  # not the walls at the ends
    ]
    order = rng.permutation(len(slots))[: options.objects]
    for index in order:
        wall, along = slots[index]
        height, radius = rng.uniform(0.2, 0.45), rng.uniform(0.1, 0.2)
        at = [along + rng.uniform(-0.2, 0.2), radius + 0.03, height]
        if rng.random() < 0.5:
            paint = scene.paint(f"bin_{rng.integers(4)}", rng.uniform(0.15, 0.8, 3).tolist())
            wall.part.geom("cylinder", [radius, height], at, paint)
        else:
            carton = scene.surface("poster", name="carton", scale=0.5)
            wall.part.geom("box", [radius, radius, height], at, carton)
