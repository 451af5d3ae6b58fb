# SPDX-License-Identifier: Apache-2.0
"""An office: desks and shelves along the walls, a round table, and a person."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilotage.simulation.furniture import (
    DEEPEST_M,
    WIDEST_M,
    add_cabinet,
    add_desk,
    add_round_table,
    add_shelf,
)
from pilotage.simulation.grounds import FLOORS
from pilotage.simulation.marks import add_mark
from pilotage.simulation.options import chosen, ranged
from pilotage.simulation.person import SHOULDER_M, add_person, add_seated_person, round_walk
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

BEHIND_M = 2.4  # from the start to the wall behind it
LOOP_M = 1.05  # radius of the person's round about the table
PIECES: tuple[Callable[[Scene, Wall, float], None], ...] = (add_desk, add_shelf, add_cabinet)


@dataclass(frozen=True)
class OfficeOptions:
    """What may be chosen; `length_m` runs along x, `width_m` along y."""

    floor: str = chosen("carpet", list(FLOORS))
    length_m: float = ranged(8.4, 8.0, 20.0)
    width_m: float = ranged(6.8, 6.0, 20.0)
    person: str = chosen("walk", ["none", "stand", "sit", "walk"])
    person_m_s: float = ranged(0.5, 0.05, 2.0)


def build_office(scene: Scene, options: OfficeOptions) -> None:
    """Fill `scene`; the robot starts at the world's origin, along x into the room."""
    scene.start(0, 0, 0)
    add_floor(scene, options.floor)
    low = np.array([-BEHIND_M, -options.width_m / 2])
    high = low + np.array([options.length_m, options.width_m])
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    for number in range(4):
        wall = add_wall(scene, f"wall_{number}", corners[number], corners[(number + 1) % 4])
        _furnish(scene, wall, number, has_door=number == 3)
    middle, half = (low + high) / 2, (high - low) / 2
    add_ceiling(scene, middle, half)
    for number, share in enumerate((-0.5, 0.5)):
        add_lamp(scene, f"lamp_{number}", middle + np.array([share * half[0], 0.0]))
    table = (float(high[0]) - DEEPEST_M - LOOP_M - SHOULDER_M, float(scene.rng.uniform(-0.3, 0.3)))
    add_round_table(scene, *table)
    _add_person(scene, options, table)
    side = 1 if scene.rng.random() < 0.5 else -1
    add_mark(scene, "a", (0.9, side * float(scene.rng.uniform(0.9, 1.3)), 0.0))
    add_mark(scene, "b", (0.9, -side * float(scene.rng.uniform(0.9, 1.3)), 0.0))


def _add_person(scene: Scene, options: OfficeOptions, table: tuple[float, float]) -> None:
    if options.person == "none":
        return
    room_m = options.width_m / 2 - DEEPEST_M - SHOULDER_M - abs(table[1])
    radii = (LOOP_M, min(room_m, LOOP_M * float(scene.rng.uniform(0.95, 1.15))))
    walk = round_walk(table, radii, options.person_m_s)
    place = walk.points[int(scene.rng.integers(len(walk.points)))]
    place_m = (float(place[0]), float(place[1]))
    if options.person == "sit":
        add_seated_person(scene, place_m)
    else:
        add_person(scene, walk if options.person == "walk" else None, place_m)


def _furnish(scene: Scene, wall: Wall, number: int, *, has_door: bool) -> None:
    """Put furniture along a wall, clear of the corners, and posters over what is low."""
    rng = scene.rng
    at = DEEPEST_M + WIDEST_M / 2
    door_at = wall.length_m / 2
    if has_door:
        add_door(scene, wall, door_at)
    while at + WIDEST_M / 2 < wall.length_m - DEEPEST_M:
        near_door = has_door and abs(at - door_at) < (WIDEST_M + DOOR_M[0]) / 2 + 0.2
        if not near_door:
            piece = PIECES[int(rng.choice(len(PIECES), p=(0.45, 0.35, 0.2)))]
            piece(scene, wall, at)
            if piece is not add_shelf:
                add_poster(scene, wall, at, f"poster_{number}_{round(100 * at)}")
        at += WIDEST_M + rng.uniform(0.05, 0.5)
