# SPDX-License-Identifier: Apache-2.0
"""Which paths fit into a world: a robot's way is tried with an upright cylinder in its place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from pilotage.errors import InputError
from pilotage.simulation.paths import SPACING_M, Points, parse_path
from pilotage.simulation.person import SHOULDER_M
from pilotage.simulation.scene import WALK_PREFIX
from pilotage.simulation.sight import height_below_m
from pilotage.simulation.walkers import read_walk
from pilotage.simulation.world import World, start_of

# The cylinder is tried so often along the path, and stands clear of the ground's unevenness.
EVERY_M = 0.1
BEYOND_M = 0.35
FROM_M, TO_M = 0.12, 0.70
SEARCH_HEIGHT_M = 1.0
EDGE = "the edge of the ground"  # beyond it there is nothing to drive on
LENGTHS_M = (50, 40, 30, 25, 20, 15, 12, 10, 8, 6, 5, 4, 3, 2, 1)
SUGGESTED = ("closed", "open", "straight")


class Touch(NamedTuple):
    """Where along a path a robot would touch something, and what."""

    along_m: float
    what: str


class FreeFloor:
    """The floor of a world that a robot of a radius can use, standing alone in it."""

    def __init__(self, world: World, radius_m: float) -> None:
        self._name = world.name
        self._radius_m = radius_m
        spec = world.spec()
        self._start = start_of(spec, world.name)
        self._walks = [
            read_walk(text.name, text.data)
            for text in spec.texts
            if text.name.startswith(WALK_PREFIX)
        ]
        # Free to move: MuJoCo looks for no contact between two things that stand still for good.
        probe = spec.worldbody.add_body(name="probe")
        probe.add_freejoint()
        kind, half_m = mujoco.mjtGeom.mjGEOM_CYLINDER, (TO_M - FROM_M) / 2
        probe.add_geom(name="probe", type=kind, size=[radius_m, half_m, 0], group=2)
        try:
            self._model: Any = spec.compile()
        except ValueError as error:
            raise world.fault(error) from error
        self._data: Any = mujoco.MjData(self._model)
        self._probe = self._model.geom("probe").id
        mujoco.mj_forward(self._model, self._data)

    def first_touch(self, path: str) -> Touch | None:
        """Return where the robot on its way along `path` touches something first, None if never."""
        x_m, y_m, yaw_rad = self._start
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        points = parse_path(path).points[:: round(EVERY_M / SPACING_M)]
        # No robot stops on the spot, nor ends where its middle is.
        ahead = (points[-1] - points[-2]) / np.linalg.norm(points[-1] - points[-2])
        beyond = points[-1] + np.outer(np.arange(EVERY_M, BEYOND_M, EVERY_M), ahead)
        points = np.concatenate([points, beyond])
        for number, point in enumerate(points @ np.array([[c, s], [-s, c]]) + (x_m, y_m)):
            what = self._touched(point)
            if what is not None:
                return Touch(number * EVERY_M, what)
        return None

    def choose(self, paths: Sequence[str]) -> str:
        """Return the first of `paths` that fits; InputError when none does."""
        for path in paths:
            if self.first_touch(path) is None:
                return path
        touch = self.first_touch(paths[-1])
        what = touch.what if touch else "something"
        raise InputError(
            f"{self._name}: no path fits, not even {paths[-1]}: {what} is in the way; "
            "choose another seed or a larger room (--set)"
        )

    def check(self, path: str) -> None:
        """Raise InputError, naming paths that fit, unless `path` does."""
        touch = self.first_touch(path)
        if touch is None:
            return
        fitting = ", ".join(self._longest()) or "none"
        raise InputError(
            f"path {path!r} does not fit into {self._name}: {touch.along_m:.1f} m along it the "
            f"robot would touch {touch.what}; paths that fit: {fitting}"
        )

    def _longest(self) -> Iterator[str]:
        for shape in SUGGESTED:
            names = (f"{shape}-{length}m" for length in LENGTHS_M)
            fitting = next((name for name in names if self.first_touch(name) is None), None)
            if fitting is not None:
                yield fitting

    def _touched(self, point: Points) -> str | None:
        for walk in self._walks:
            loop = np.concatenate([walk.points, walk.points[:1]])
            if _distance_m(point, loop) < self._radius_m + SHOULDER_M:
                return f"the walking {walk.body}"
        model, data = self._model, self._data
        ground_m = height_below_m(model, data, np.array([*point, SEARCH_HEIGHT_M]))
        if ground_m is None:
            return EDGE
        data.qpos[model.jnt_qposadr[model.body("probe").jntadr[0]] :][:7] = [
            *point,
            ground_m + (FROM_M + TO_M) / 2,
            1.0,
            0.0,
            0.0,
            0.0,
        ]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        for contact in data.contact[: data.ncon]:
            touched = set(contact.geom.tolist())
            if self._probe in touched:
                other = (touched - {self._probe}).pop()
                return self._name_of(other)
        return None

    def _name_of(self, geom: int) -> str:
        body = self._model.body(self._model.geom_bodyid[geom]).name
        return str(self._model.geom(geom).name or (body if body != "world" else "a thing"))


def _distance_m(point: Points, loop: Points) -> float:
    """Return the distance of `point` (2,) to the polyline `loop` (N, 2)."""
    begin, step = loop[:-1], np.diff(loop, axis=0)
    share = np.clip(((point - begin) * step).sum(axis=1) / (step**2).sum(axis=1), 0, 1)
    return float(np.linalg.norm(begin + share[:, None] * step - point, axis=1).min())
