# SPDX-License-Identifier: Apache-2.0
"""What faults do to a simulated body: slipping and stuck tracks, pushes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pilotage.simulation.faults import BODY, KINDS, PUSH_S, PUSHES, Fault


@dataclass
class Disturbance:
    """What the faults do to a body at one moment; left before right.

    `grip` and `speed` are the shares that are left, `push_n` a force (x, y) in the robot's frame.
    """

    grip: tuple[float, float] = (1.0, 1.0)
    speed: tuple[float, float] = (1.0, 1.0)
    push_n: tuple[float, float] = (0.0, 0.0)


CALM = Disturbance()


def disturbance(faults: Sequence[Fault], time_ns: int) -> Disturbance:
    """Return what all faults of a body do together at a time; shares of one kind multiply."""
    active = [f for f in faults if KINDS[f.name].part == BODY and f.is_active(time_ns)]
    if not active:
        return CALM
    shares = {"slip": [1.0, 1.0], "stuck": [1.0, 1.0]}
    push = [0.0, 0.0]
    for fault in active:
        if fault.name in PUSHES:
            push[fault.name == "push_left"] += fault.size / PUSH_S
            continue
        what, _, side = fault.name.partition("_")
        for index, name in enumerate(("left", "right")):
            if side in {"", name}:
                shares[what][index] *= 1 - fault.size
    grip, speed = shares["slip"], shares["stuck"]
    return Disturbance((grip[0], grip[1]), (speed[0], speed[1]), (push[0], push[1]))
