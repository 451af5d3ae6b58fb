# SPDX-License-Identifier: Apache-2.0
"""The protocol of a simulated body; `models.py` has the table of those there are."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

from pilotage import Transform
from pilotage.errors import InputError
from pilotage.simulation.disturbance import Disturbance
from pilotage.simulation.scene import yaw_quaternion

# A body's parts are called by this prefix in the model: `robot/chassis`.
PREFIX = "robot/"


class Pose2(NamedTuple):
    """A place on the ground: metres, radians about z."""

    x_m: float
    y_m: float
    yaw_rad: float

    def at_height(self, height_m: float = 0.0) -> Transform:
        """Return the pose of what stands there upright."""
        return Transform(
            translation_m=[self.x_m, self.y_m, height_m],
            quaternion_wxyz=yaw_quaternion(self.yaw_rad),
        )


class Motion(NamedTuple):
    """A velocity in the robot's frame: m/s along x and y, rad/s about z."""

    linear_m_s: float
    lateral_m_s: float
    angular_rad_s: float

    def within(self, limits: Motion) -> Motion:
        """Return the motion with each part cut to what `limits` allow either way.

        InputError when a part is no number: a body could never get rid of it again.
        """
        if any(map(math.isnan, self)):
            raise InputError(f"motion {tuple(self)}: must be numbers, not NaN")
        pairs = zip(self, limits, strict=True)
        return Motion(*(min(max(float(part), -limit), limit) for part, limit in pairs))


REST = Motion(0.0, 0.0, 0.0)


class Body(Protocol):
    """What moves through a world. The simulation alone calls all but `command`.

    `faults` names the kinds of faults it can suffer.
    """

    faults: frozenset[str]
    odometry: Pose2  # what the body itself believes, from where it started
    motion: Motion  # what it believes to be doing
    energy_j: float  # taken from the battery since the start
    capacity_j: float

    def mjcf(self) -> str:
        """Return the body's own MJCF; its first body is called `robot`, or `torso` above it."""

    def bind(self, model: Any, data: Any, start: Transform, seed: int) -> None:
        """Find the parts in the compiled model and stand at `start` (world_from_robot)."""

    def command(self, motion: Motion, until_ns: int) -> Motion:
        """Strive for `motion` until that time, then for rest; return it within the limits."""

    def before_step(self, time_ns: int, acting: Disturbance) -> None:
        """Set what acts during the next step."""

    def after_step(self, time_ns: int) -> None:
        """Take note of what the step did."""
