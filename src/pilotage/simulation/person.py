# SPDX-License-Identifier: Apache-2.0
"""A person of capsules and ellipsoids, who stands, sits or walks along a closed path."""

from __future__ import annotations

import math

import numpy as np

from pilotage.simulation.scene import Part, Scene
from pilotage.simulation.walkers import Walk

SHOULDER_M = 0.35  # half of somebody who walks, with a little room
SKIN = (0.78, 0.58, 0.46)
SEAT_M = 0.46  # height of a chair's seat
LOWER_M = 0.40  # so much lower than of one who stands is the trunk of one who sits


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
    _add_trunk(scene, body, shirt, skin)
    if walk is not None:
        scene.note(*walk.note())


def add_seated_person(scene: Scene, place_m: tuple[float, float]) -> None:
    """Add the body `person` on a chair at `place_m`, who looks to the world's origin."""
    rng = scene.rng
    yaw_rad = math.atan2(-place_m[1], -place_m[0])
    body = scene.body("person", [*place_m, 0], yaw_rad)
    shirt = scene.surface("poster", name="shirt", scale=0.3)
    trousers = scene.paint("trousers", rng.uniform(0.08, 0.4, 3).tolist())
    skin = scene.paint("skin", SKIN)
    shoes = scene.paint("shoes", (0.1, 0.08, 0.07))
    knee_m, thigh_m = 0.45, SEAT_M + 0.08
    for side in (1, -1):
        y = 0.1 * side
        thigh = [0, y, thigh_m, knee_m, y, thigh_m]
        body.geom("capsule", [0.075], [0, 0, 0], trousers, fromto=thigh)
        shin = [knee_m, y, thigh_m, knee_m, y, 0.12]
        body.geom("capsule", [0.065], [0, 0, 0], trousers, fromto=shin)
        body.geom("ellipsoid", [0.13, 0.05, 0.045], [knee_m + 0.05, y, 0.045], shoes)
        shoulder, elbow = [0, 0.22 * side, 1.38 - LOWER_M], [0.08, 0.27 * side, 0.74]
        body.geom("capsule", [0.045], [0, 0, 0], shirt, fromto=[*shoulder, *elbow])
        hand = [0.3, 0.12 * side, thigh_m + 0.1]
        body.geom("capsule", [0.04], [0, 0, 0], shirt, fromto=[*elbow, *hand])
        body.geom("ellipsoid", [0.08, 0.05, 0.03], hand, skin)
    _add_trunk(scene, body, shirt, skin, lower_m=LOWER_M)
    _add_seat(scene, body)


def _add_trunk(scene: Scene, body: Part, shirt: str, skin: str, *, lower_m: float = 0.0) -> None:
    body.geom("ellipsoid", [0.13, 0.2, 0.34], [0, 0, 1.14 - lower_m], shirt)
    body.geom("capsule", [0.05, 0.05], [0, 0, 1.46 - lower_m], skin)
    body.geom("ellipsoid", [0.1, 0.085, 0.125], [0, 0, 1.575 - lower_m], skin)
    hair = scene.paint("hair", scene.rng.uniform(0.05, 0.35, 3).tolist())
    body.geom("ellipsoid", [0.105, 0.09, 0.09], [-0.015, 0, 1.63 - lower_m], hair)


def _add_seat(scene: Scene, body: Part) -> None:
    wood = scene.surface("wood", name="seat", scale=0.5)
    body.geom("box", [0.22, 0.22, 0.02], [0.08, 0, SEAT_M - 0.02], wood)
    body.geom("box", [0.015, 0.2, 0.12], [-0.17, 0, 0.86], wood)
    for x in (-0.12, 0.28):
        top_m = 0.98 if x < 0 else SEAT_M - 0.04
        for y in (-0.2, 0.2):
            body.geom("box", [0.015, 0.015, top_m / 2], [x, y, top_m / 2], wood)


def round_walk(centre_m: tuple[float, float], radii_m: tuple[float, float], speed: float) -> Walk:
    """Return a walk of the body `person` around an ellipse, `speed` in m/s."""
    angle = np.linspace(0, 2 * math.pi, 37)[:-1]
    points = np.column_stack([np.cos(angle), np.sin(angle)]) * radii_m + centre_m
    return Walk("person", points, speed)
