# SPDX-License-Identifier: Apache-2.0
"""A person of capsules and ellipsoids, who stands or walks along a closed path."""

from __future__ import annotations

import math

import numpy as np

from pilotage.simulation.scene import Scene
from pilotage.simulation.walkers import Walk

SHOULDER_M = 0.35  # half of somebody who walks, with a little room
SKIN = (0.78, 0.58, 0.46)


def add_person(scene: Scene, walk: Walk | None, place_m: tuple[float, float]) -> None:
    """Add the body `person`, 1.7 m tall, facing its x, at `place_m` or on its walk."""
    rng = scene.rng
    body = scene.body("person", [*place_m, 0], rng.uniform(-math.pi, math.pi), mocap=True)
    shirt = scene.surface("poster", name="shirt", scale=0.3)
    trousers = scene.paint("trousers", rng.uniform(0.08, 0.4, 3).tolist())
    skin = scene.paint("skin", SKIN)
    shoes = scene.paint("shoes", (0.1, 0.08, 0.07))
    stride = 0.14 if walk is not None else 0.0
    for side, swing in ((1, stride), (-1, -stride)):
        y = 0.1 * side
        leg = [0, y, 0.85, swing, y, 0.12]
        body.geom("capsule", [0.075], [0, 0, 0], trousers, fromto=leg)
        body.geom("ellipsoid", [0.13, 0.05, 0.045], [swing + 0.05, y, 0.045], shoes)
        arm = [0, 0.22 * side, 1.38, -swing, 0.26 * side, 0.85]
        body.geom("capsule", [0.045], [0, 0, 0], shirt, fromto=arm)
        body.geom("ellipsoid", [0.05, 0.03, 0.08], [-swing, 0.26 * side, 0.76], skin)
    body.geom("ellipsoid", [0.13, 0.2, 0.34], [0, 0, 1.14], shirt)
    body.geom("capsule", [0.05, 0.05], [0, 0, 1.46], skin)
    body.geom("ellipsoid", [0.1, 0.085, 0.125], [0, 0, 1.575], skin)
    hair = scene.paint("hair", rng.uniform(0.05, 0.35, 3).tolist())
    body.geom("ellipsoid", [0.105, 0.09, 0.09], [-0.015, 0, 1.63], hair)
    if walk is not None:
        scene.note(*walk.note())


def round_walk(centre_m: tuple[float, float], radii_m: tuple[float, float], speed: float) -> Walk:
    """Return a walk of the body `person` around an ellipse, `speed` in m/s."""
    angle = np.linspace(0, 2 * math.pi, 37)[:-1]
    points = np.column_stack([np.cos(angle), np.sin(angle)]) * radii_m + centre_m
    return Walk("person", points, speed)
