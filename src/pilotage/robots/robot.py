# SPDX-License-Identifier: Apache-2.0
"""The protocol of a robot, the values it takes and gives, and what only some robots can."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from pilotage import Transform
from pilotage.calibration.nao_head import HeadAngles
from pilotage.errors import InputError

__all__ = ["HasHead", "HasPostures", "HeadAngles", "Robot", "RobotState", "Velocity"]

LONGEST_LIFETIME_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Velocity:
    """What a robot is to strive for, in its own frame: m/s along x and y, rad/s about z.

    It holds for `lifetime_s` (at most 5) from when the robot takes it, on the robot's own clock,
    then the robot stops by itself. InputError when a value is not finite or the lifetime is off.
    """

    linear_m_s: float
    angular_rad_s: float
    lateral_m_s: float = 0.0
    lifetime_s: float

    def __post_init__(self) -> None:
        for key in ("linear_m_s", "angular_rad_s", "lateral_m_s"):
            if not math.isfinite(getattr(self, key)):
                raise InputError(f"velocity: {key} = {getattr(self, key)}: must be finite")
        if not 0 < self.lifetime_s <= LONGEST_LIFETIME_S:
            raise InputError(
                f"velocity: lifetime_s = {self.lifetime_s}: "
                f"must be positive and at most {LONGEST_LIFETIME_S:g}"
            )


@dataclass(frozen=True, kw_only=True)
class RobotState:
    """What a robot says of itself at `timestamp_ns` on its own clock.

    `odometry_from_robot` is its own dead reckoning from where it was switched on, with all its
    slip, None if it has none. Speeds are those it believes in. `battery` is a share, 0 to 1.
    """

    timestamp_ns: int
    linear_m_s: float
    angular_rad_s: float
    lateral_m_s: float = 0.0
    is_moving: bool
    odometry_from_robot: Transform | None = None
    battery: float | None = None
    head: HeadAngles | None = None  # as its encoders tell
    posture: str | None = None  # None as well while between two postures


class Robot(Protocol):
    """A body that can be sent about. `with` opens it and stops it on every way out.

    All raise DeviceError when the robot is not open or cannot be reached.
    """

    name: str

    def __enter__(self) -> Self:
        """Connect; nothing moves yet."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop and disconnect."""

    def send(self, command: Velocity) -> Velocity:
        """Take a command in place of the one before; return it as it is obeyed, within limits."""

    def stop(self) -> None:
        """Come to rest as fast as is safe, whatever was sent before."""

    def state(self) -> RobotState:
        """Return the newest state."""


class HasHead(Protocol):
    """A robot whose head turns."""

    def turn_head(self, head: HeadAngles) -> HeadAngles:
        """Start turning; return the goal as it is obeyed, within joints and shell.

        `RobotState.head` tells when it is there, as well as its encoders know.
        """


class HasPostures(Protocol):
    """A robot that can stand and crouch."""

    def take_posture(self, name: str) -> None:
        """Stop, then start to `stand` or to `crouch`; InputError for others.

        `RobotState.posture` tells when it is there.
        """
