# SPDX-License-Identifier: Apache-2.0
"""A yard under the sky: one kind of ground, with or without relief, and things on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pilotage.errors import InputError
from pilotage.simulation.grounds import GROUNDS
from pilotage.simulation.layout import Layout
from pilotage.simulation.marks import MARK_CLEAR_M, add_mark
from pilotage.simulation.options import chosen, ranged
from pilotage.simulation.paths import parse_path
from pilotage.simulation.relief import Relief, make_relief
from pilotage.simulation.scene import Scene
from pilotage.simulation.yard_objects import add_object, object_radius_m, pick_object

ANY = "any"


@dataclass(frozen=True)
class YardOptions:
    """What may be chosen; the rest is the seed's. `ground: any` leaves the ground to the seed."""

    ground: str = chosen(ANY, [ANY, *GROUNDS])
    relief_m: float = ranged(0.0, 0.0, 0.5)
    relief_wave_m: float = ranged(5.0, 1.0, 50.0)  # the longest; short ones tilt the robot more
    objects: int = ranged(20, 0, 400)
    size_m: float = ranged(30.0, 10.0, 200.0)
    clear_radius_m: float = ranged(1.5, 0.5, 50.0)
    path: str = "straight-1m"  # stays clear of objects; the yard lies around its middle
    path_clear_m: float = ranged(0.8, 0.3, 10.0)


def build_yard(scene: Scene, options: YardOptions) -> None:
    """Fill `scene`; the robot starts at the world's origin, along x."""
    rng = scene.rng
    layout = _layout(options)
    kinds = list(GROUNDS)
    kind = options.ground if options.ground != ANY else kinds[int(rng.integers(len(kinds)))]
    scene.sun(rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(25, 65)))
    scene.start(0, 0, 0)
    relief = make_relief(
        rng, layout.centre_m, layout.half_m, options.relief_m, options.relief_wave_m
    )
    places = {}
    far_m = min(6.0, 0.6 * layout.half_m)
    for letter, low_m, high_m in (("a", 2.5, 6.0), ("b", far_m, far_m + layout.half_m)):
        spot = layout.place_between(rng, MARK_CLEAR_M, low_m, high_m)
        relief = relief.level_around(spot.x_m, spot.y_m, 0.6)
        places[letter] = spot
    # Marks may lie where it is to stay clear, for they are flat; objects may not.
    layout.take(0, 0, options.clear_radius_m)
    _add_ground(scene, kind, relief)
    for letter, spot in places.items():
        height_m = relief.height_m(spot.x_m, spot.y_m)
        add_mark(scene, letter, (spot.x_m, spot.y_m, height_m))
    _add_objects(scene, options, layout, relief)


def side_for_m(path: str, path_clear_m: float = YardOptions.path_clear_m) -> int:
    """Return the side, m, of the smallest yard that a path fits into."""
    parsed = parse_path(path)
    half_m = float(np.abs(parsed.points - parsed.centre()).max()) + path_clear_m
    return math.ceil(2 * half_m)


def _layout(options: YardOptions) -> Layout:
    path = parse_path(options.path)
    middle = path.centre()
    half_m = options.size_m / 2
    needed_m = side_for_m(options.path, options.path_clear_m)
    if needed_m > options.size_m:
        raise InputError(
            f"yard: path = {options.path!r} does not fit into size_m = {options.size_m:g}; "
            f"raise size_m to {needed_m}"
        )
    centre_m = (float(middle[0]), float(middle[1]))
    # Every tenth point: a quarter of a metre apart is fine enough to keep a corridor free.
    return Layout(centre_m, half_m, path.points[::10], options.path_clear_m)


def _add_ground(scene: Scene, kind: str, relief: Relief) -> None:
    material = scene.surface(kind, name="ground")
    contact = GROUNDS[kind].attributes()
    lowest, highest = float(relief.heights_m.min()), float(relief.heights_m.max())
    if highest == lowest:
        scene.world.geom("plane", [0, 0, 1], [0, 0, 0], material, name="ground", **contact)
        return
    height = highest - lowest
    scene.height_field(
        "relief", [relief.half_m, relief.half_m, height, 0.5], (relief.heights_m - lowest) / height
    )
    x, y = relief.centre_m
    scene.world.geom(
        "hfield", [], [x, y, lowest], material, name="ground", hfield="relief", **contact
    )
    # The land beyond the yard, seen up to the horizon.
    below = lowest - 0.02
    scene.world.geom("plane", [0, 0, 1], [0, 0, below], material, name="beyond", **contact)


def _add_objects(scene: Scene, options: YardOptions, layout: Layout, relief: Relief) -> None:
    for number in range(options.objects):
        kind = pick_object(scene.rng)
        radius_m = object_radius_m(scene.rng, kind)
        spot = layout.place(scene.rng, radius_m)
        if spot is None:
            raise InputError(
                f"yard: objects = {options.objects}: only {number} find room; "
                "lower objects or raise size_m"
            )
        height_m = relief.height_m(spot.x_m, spot.y_m)
        add_object(scene, kind, f"{kind}_{number}", spot, height_m)
