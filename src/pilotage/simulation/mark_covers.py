# SPDX-License-Identifier: Apache-2.0
"""Leaves that hide a mark from the onset of a fault on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.simulation.faults import KINDS, MARK, Fault
from pilotage.simulation.scene import SURFACES, yaw_quaternion
from pilotage.simulation.world import World

LEAF_M = (0.045, 0.028, 0.0008)  # half its length, width and thickness
GRID = 80  # points across a mark by which its cover is counted
BELOW_M = 1000.0  # where leaves wait for their onset: under any ground
PREFIX = "leaves/"


@dataclass(frozen=True)
class Cover:
    """The leaves of one fault: a mocap body, and where it belongs."""

    body: str
    fault: Fault
    place_m: tuple[float, float, float]

    def move(self, model: Any, data: Any, time_ns: int) -> None:
        """Lay the leaves on the mark while the fault acts, take them away otherwise."""
        depth_m = 0.0 if self.fault.is_active(time_ns) else BELOW_M
        mocap = model.body(self.body).mocapid[0]
        data.mocap_pos[mocap] = np.asarray(self.place_m) - [0, 0, depth_m]


def cover_marks(spec: Any, world: World, faults: Sequence[Fault]) -> list[Cover]:
    """Add leaves for every fault that covers a mark to `spec`; InputError without such a mark."""
    covering = [fault for fault in faults if KINDS[fault.name].part == MARK]
    return [
        _cover(spec, world, fault, number)
        for number, fault in enumerate(covering)
        if fault.size > 0
    ]


def _cover(spec: Any, world: World, fault: Fault, number: int) -> Cover:
    mark = fault.name.removesuffix("_covered")
    place_m, radius_m, top_m = _find(spec, world, mark)
    name = f"{PREFIX}{number}"
    body = spec.worldbody.add_body(name=name, mocap=True)
    random = np.random.default_rng([world.seed, number, 5])
    for x, y, yaw in scatter(random, fault.size, radius_m):
        shade = random.uniform(0.6, 1.4)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=LEAF_M,
            pos=[x, y, top_m + random.uniform(0.001, 0.004)],
            quat=yaw_quaternion(yaw),
            rgba=[*np.clip(np.multiply(SURFACES["leaves"], shade), 0, 1), 1.0],
            contype=0,
            conaffinity=0,
        )
    return Cover(name, fault, place_m)


def scatter(
    random: np.random.Generator, share: float, radius_m: float
) -> list[tuple[float, float, float]]:
    """Return x, y (m from the middle) and yaw of leaves that hide `share` of a disc.

    Leaf after leaf falls on a point that is still free, until so much is hidden.
    """
    side = np.linspace(-radius_m, radius_m, GRID)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    inside = np.hypot(x, y) <= radius_m
    x, y = x[inside], y[inside]
    is_free = np.ones(len(x), bool)
    leaves: list[tuple[float, float, float]] = []
    while is_free.mean() > 1 - share:
        at = random.choice(np.flatnonzero(is_free))
        yaw = float(random.uniform(0, 2 * math.pi))
        leaves.append((float(x[at]), float(y[at]), yaw))
        is_free &= ~_is_under(leaves[-1], x, y)
    return leaves


def _is_under(
    leaf: tuple[float, float, float], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.bool_]:
    dx, dy = x - leaf[0], y - leaf[1]
    c, s = math.cos(leaf[2]), math.sin(leaf[2])
    along, across = c * dx + s * dy, c * dy - s * dx
    return np.asarray((along / LEAF_M[0]) ** 2 + (across / LEAF_M[1]) ** 2 <= 1)


def _find(spec: Any, world: World, mark: str) -> tuple[tuple[float, float, float], float, float]:
    """Return a mark's place in the world, its radius and how far it rises, metres."""
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, mark)
    if found < 0:
        raise InputError(f"{world.name}: fault {mark}_covered: there is no geom {mark!r} to cover")
    x, y, z = data.geom_xpos[found].tolist()
    # The rings of our marks rise a little above the outermost disc.
    return (x, y, z), float(model.geom_size[found, 0]), 2 * float(model.geom_size[found, 1])
