# SPDX-License-Identifier: Apache-2.0
"""A walk of two legs: how its speed builds up, how it errs, how it shakes the body."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.simulation.body import REST, Motion

STEP_S = 0.5
LAG_S = 0.2
STILL_M_S, STILL_RAD_S = 1e-3, 5e-3  # slower than this the walk has ended
# Standard deviations: of the lengths over the whole walk and of each step, and of the turn that
# each metre or radian brings along.
SCALE_ERROR, STEP_ERROR, DRIFT_RAD_M = 0.04, 0.05, 0.10
SWAY_M, BOB_M, ROLL_RAD, PITCH_RAD = 0.012, 0.005, math.radians(2.0), math.radians(0.8)
# A foot that lands shakes the body: rad, decay, frequency.
KICK_RAD, KICK_S, KICK_HZ = math.radians(0.4), 0.08, 11.0


class Gait:
    """The walk of one Nao; all errors come from `rng`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._motion = REST
        self._amplitude = 0.0
        self._phase_s = 0.0
        self._steps = 0
        self._scale: NDArray[np.float64] = 1 + SCALE_ERROR * rng.standard_normal(3)
        self._drift_rad_m = DRIFT_RAD_M * rng.standard_normal()
        self._draw()

    @property
    def steps(self) -> int:
        """Return how many steps are done."""
        return self._steps

    def advance(self, wanted: Motion, duration_s: float) -> Motion:
        """Return the motion the robot believes in after a short time of wanting `wanted`."""
        share = 1 - math.exp(-duration_s / LAG_S)
        pairs = zip(self._motion, wanted, strict=True)
        self._motion = Motion(*(now + share * (goal - now) for now, goal in pairs))
        is_walking = wanted != REST
        self._amplitude += share * (float(is_walking) - self._amplitude)
        if not is_walking and _is_still(self._motion):
            self._motion = REST
        if not is_walking and self._motion == REST and self._amplitude < 0.01:
            self._amplitude = self._phase_s = 0.0
            return REST
        self._phase_s += duration_s
        if self._phase_s >= STEP_S:
            self._phase_s -= STEP_S
            self._steps += 1
            self._draw()
        return self._motion

    def true_motion(self, believed: Motion) -> Motion:
        """Return what the feet really do."""
        along, aside, turn = np.asarray(believed) * self._scale * self._slips
        walked = math.hypot(along, aside)
        return Motion(float(along), float(aside), float(turn + walked * self._veer_rad_m))

    def sway(self) -> Transform:
        """Return how the body is displaced from upright over the robot's origin."""
        if self._amplitude == 0:
            return Transform()
        half = math.pi * self._phase_s / STEP_S
        side = 1 if self._steps % 2 == 0 else -1
        swing = side * math.sin(half)
        ringing = math.exp(-self._phase_s / KICK_S) * math.sin(
            2 * math.pi * KICK_HZ * self._phase_s
        )
        roll, pitch, yaw = ringing * self._kick
        twist = np.array(
            [
                0.0,
                SWAY_M * swing,
                -BOB_M * math.sin(half) ** 2,
                -ROLL_RAD * swing + roll,
                PITCH_RAD * math.sin(2 * half) + pitch,
                yaw,
            ]
        )
        return Transform.exp(self._amplitude * twist)

    def _draw(self) -> None:
        """Draw the errors of the step that begins."""
        self._slips: NDArray[np.float64] = 1 + STEP_ERROR * self._rng.standard_normal(3)
        self._veer_rad_m = self._drift_rad_m + DRIFT_RAD_M * self._rng.standard_normal()
        self._kick: NDArray[np.float64] = KICK_RAD * self._rng.standard_normal(3)


def _is_still(motion: Motion) -> bool:
    speed = math.hypot(motion.linear_m_s, motion.lateral_m_s)
    return speed < STILL_M_S and abs(motion.angular_rad_s) < STILL_RAD_S
