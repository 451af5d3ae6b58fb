# SPDX-License-Identifier: Apache-2.0
"""The marks A and B on the ground: flat discs of different colours, as the rover's paper has."""

from __future__ import annotations

from pilotage.simulation.scene import Scene

MARK_RADIUS_M = 0.20
# Free ground around a mark, so that a robot can stand 0.5 m before it on any side.
MARK_CLEAR_M = 1.1
COLOURS = {"a": (0.80, 0.06, 0.06), "b": (0.05, 0.15, 0.75)}
WHITE = (0.92, 0.92, 0.90)
# Rings from outside in: share of the radius, half height in metres, coloured or white.
RINGS = ((1.0, 0.0010, True), (0.66, 0.0015, False), (0.33, 0.0020, True))


def add_mark(scene: Scene, letter: str, position_m: tuple[float, float, float]) -> None:
    """Add the mark `a` or `b`; its outermost disc is the geom `mark_a` or `mark_b`.

    A mark is not solid: a track rolls over it as over paint.
    """
    colour = scene.paint(f"mark_{letter}", COLOURS[letter])
    white = scene.paint("mark_white", WHITE)
    for index, (share, half_height_m, coloured) in enumerate(RINGS):
        scene.world.geom(
            "cylinder",
            [share * MARK_RADIUS_M, half_height_m],
            position_m,
            colour if coloured else white,
            solid=False,
            name=f"mark_{letter}" + (f"_ring_{index}" if index else ""),
        )
