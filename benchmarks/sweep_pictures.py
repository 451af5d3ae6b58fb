# SPDX-License-Identifier: Apache-2.0
"""Sweeps of a simulated Nao's head before things at a known distance, rendered with their truth.

The head goes where its encoders tell that it is at the goal: half the play off, to the side it
came from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pilotage import Transform
from pilotage.behaviors.sweep import Features, View
from pilotage.calibration.nao_head import (
    CAMERAS,
    HEAD_Z_M,
    HeadAngles,
    head_from_camera,
    neck_from_head,
    torso_from_neck,
)
from pilotage.simulation import Encoders, Simulation, robot_model
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.nao import TORSO_M, Nao
from pilotage.simulation.pictures import Pictures, camera_rays
from pilotage.simulation.scene import Scene
from pilotage.simulation.sensor import Sensor
from pilotage.simulation.world import World

Array = npt.NDArray[Any]
YAWS_DEG = (33.5, 0.0, -33.5)
SETTLING_NS = 300_000_000
STEP_NS = 20_000_000
EYE_M = TORSO_M["stand"] + HEAD_Z_M
SURFACES = ("poster", "wood", "brick", "plaster", "bark")
WALL_BEHIND_M = 2.0  # behind the things, at least
HALF_ROOM_M = 8.0


@dataclass(frozen=True, eq=False)
class TrueView:
    """A picture with what it really was: `world_from_camera`, and depth along z for each pixel."""

    view: View
    world_from_camera: Transform
    depth_m: Array


def things_at(distances_m: Sequence[float], seed: int) -> World:
    """Return a room with things all around the robot, the distance of each one of those given.

    Between them walls are seen, further behind.
    """
    rng = np.random.default_rng([53, seed, *(round(1000 * at_m) for at_m in distances_m)])
    scene = Scene("sweep", rng)
    _add_floor(scene)
    _add_walls(scene, max(distances_m) + WALL_BEHIND_M)
    for number, bearing_deg in enumerate(range(-75, 76, 15)):
        bearing_rad = math.radians(bearing_deg + rng.uniform(-2, 2))
        _add_thing(scene, number, bearing_rad, float(rng.choice(np.array(distances_m))))
    return World("sweep", seed, scene.text())


def walls_at(distance_m: float, seed: int) -> World:
    """Return a room with nothing in it, its walls that far ahead and to both sides."""
    scene = Scene("sweep", np.random.default_rng([59, seed, round(1000 * distance_m)]))
    _add_floor(scene)
    _add_walls(scene, distance_m)
    return World("sweep", seed, scene.text())


def _add_floor(scene: Scene) -> None:
    scene.start(0, 0, 0)
    carpet = scene.surface("carpet", name="floor")
    scene.world.geom("plane", [0, 0, 1], [0, 0, 0], carpet, name="ground")


def _add_walls(scene: Scene, wall_m: float) -> None:
    for number, (x_m, y_m, yaw_rad) in enumerate(
        [(wall_m, 0, math.pi / 2), (0, wall_m, 0), (0, -wall_m, 0), (-3.0, 0, math.pi / 2)]
    ):
        part = scene.body(f"wall_{number}", [x_m, y_m, 0], yaw_rad)
        material = scene.surface("brick" if number % 2 else "poster", name=f"wall_{number}")
        part.geom("box", [HALF_ROOM_M, 0.01, 2.0], [0, 0, 2.0], material)


def _add_thing(scene: Scene, number: int, bearing_rad: float, distance_m: float) -> None:
    """Add a board, a box or a pillar that faces the robot, as wide as eight to ten degrees."""
    rng = scene.rng
    half_m = 0.5 * distance_m * math.tan(math.radians(rng.uniform(8, 10)))
    kind = SURFACES[int(rng.integers(len(SURFACES)))]
    material = scene.surface(kind, name=f"thing_{number}", scale=0.5)
    height_m = rng.uniform(0.5, 0.9) * (1 + 0.5 * distance_m)
    deep_m = rng.uniform(0.02, 0.2)
    away_m = distance_m + deep_m
    at = [away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad), 0]
    part = scene.body(f"thing_{number}", at, bearing_rad)
    part.geom("box", [deep_m, half_m, height_m / 2], [0, 0, height_m / 2], material)


class SweepingNao:
    """A Nao that stands in a world and looks around; the same arguments give the same pictures."""

    def __init__(self, world: World, *, width_px: int, seed: int, encoders: float = 1.0) -> None:
        """`encoders` is how much those of the head err: 1 as a Nao's, 0 not at all."""
        model = robot_model("nao")
        nao = model.make_body(encoders=Encoders().scaled(encoders))
        self._simulation = Simulation(world, nao, seed=seed)
        body = self._simulation.body
        if not isinstance(body, Nao):
            raise TypeError("the simulation's body is no Nao")
        self._body, self._stand = body, body.robot_from_torso
        self._pictures = Pictures(self._simulation)
        lenses = model.single_lenses(width_px)
        self._lenses = {name: group[name] for name, group in lenses.items()}
        self._rays = {name: camera_rays(lens) for name, lens in self._lenses.items()}
        self._groups = camera_groups(
            self._simulation, lenses, Sensor(), seed=seed, pictures=self._pictures
        )

    def crouch(self) -> None:
        """Get down, as the robot does between two sweeps at one stop."""
        self._body.take_posture("crouch")
        while self._body.posture is None:
            self._simulation.advance(self._simulation.time_ns + STEP_NS)

    def look_at(self, goals: Sequence[HeadAngles]) -> list[TrueView]:
        """Return what both cameras see at each of the head's goals, in that order."""
        return [seen for goal in goals for seen in self._look(goal)]

    def _look(self, goal: HeadAngles) -> list[TrueView]:
        way = np.sign(np.subtract(goal, self._body.head))
        true = np.subtract(goal, 0.5 * self._body.encoders.play_rad * way)
        wanted = self._body.turn_head(*true.tolist())
        simulation = self._simulation
        while self._body.head != wanted:
            simulation.advance(simulation.time_ns + STEP_NS)
        simulation.advance(simulation.time_ns + SETTLING_NS)
        return [self._take(name, goal) for name in CAMERAS]

    def _take(self, name: str, goal: HeadAngles) -> TrueView:
        shot = self._groups[name].take()
        if shot is None:
            raise RuntimeError("no picture was taken")
        told = self._body.told_head
        torso_from_head = torso_from_neck(told.yaw_rad) @ neck_from_head(told.pitch_rad)
        view = View(
            name=f"{name} {math.degrees(goal.yaw_rad):+.1f} {math.degrees(goal.pitch_rad):+.1f}",
            grey=shot.pictures[name], lens=self._lenses[name], camera=name, head=told,
            torso_from_camera=torso_from_head @ head_from_camera(name),
            stop_from_torso=self._stand.inverse() @ self._body.robot_from_torso,
        )  # fmt: skip
        depth_m = self._pictures.depth_m(name, self._rays[name], at_ns=shot.taken_ns)
        return TrueView(view, self._simulation.camera_pose(name, shot.taken_ns), depth_m)


def sweep_goals(*, from_left: bool, pitch_deg: float = 0.0) -> list[HeadAngles]:
    """Return the paper's three yaws, begun at the left or at the right."""
    yaws_deg = YAWS_DEG if from_left else YAWS_DEG[::-1]
    return [HeadAngles(math.radians(yaw), math.radians(pitch_deg)) for yaw in yaws_deg]


def true_depths(true: TrueView, pixels: Array) -> tuple[Array, Array]:
    """Return depths along z (N,) that pixels (N, 2) show, and which of them lie on no edge."""
    x, y = np.rint(pixels).astype(int).T
    height, width = true.depth_m.shape
    x, y = x.clip(2, width - 3), y.clip(2, height - 3)
    around = np.stack([true.depth_m[y + dy, x + dx] for dy in range(-2, 3) for dx in range(-2, 3)])
    known = (around.min(axis=0) > 0) & (around.max(axis=0) < 1.1 * around.min(axis=0))
    return true.depth_m[y, x].astype(np.float64), known


def true_points(true: TrueView, of_view: Features) -> tuple[Array, Array]:
    """Return the world's points (N, 3) that features show, and which of them lie on no edge."""
    depth_m, known = true_depths(true, of_view.pixels)
    rays = of_view.rays / of_view.rays[:, 2:]
    return true.world_from_camera @ np.ascontiguousarray(rays * depth_m[:, None]), known
