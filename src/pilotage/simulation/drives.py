# SPDX-License-Identifier: Apache-2.0
"""Test drives along named paths, steered by the true pose: a driver, not a navigation."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.simulation.body import REST, Motion
from pilotage.simulation.paths import SPACING_M, DrivePath, Points, parse_path
from pilotage.simulation.physics import Simulation

PERIOD_NS = 20_000_000
LIFETIME_NS = 200_000_000
LOOKAHEAD_M = 0.35
WINDOW_M = 1.0  # of the path ahead in which the nearest point is sought
# A skid-steered body turns less than it is told; pure pursuit makes up for the rest.
TURN_GAIN = 1.3
TURN_IN_PLACE_RAD, TURN_RAD_S = 1.0, 0.8
ARRIVED_M = 0.01
BRAKE_PER_S = 1.5  # speed for each metre left, near the end
SLOWEST_M_S = 0.03
PATIENCE = 4.0  # times what the drive should take, plus as many seconds more


class Drive:
    """A drive of a simulation's body along a path that begins where it stands.

    Iterate over it: each item is the time (ns) up to which the simulation has come, 20 ms apart,
    until the body stands at the end (`has_arrived`) or has taken far too long. Who advances the
    simulation between two items holds the drive up for that time. `path` is a name such as
    `closed-10m`; InputError when there is none such or the speed is not positive.
    """

    def __init__(
        self, simulation: Simulation, path: DrivePath | str, *, speed_m_s: float = 0.4
    ) -> None:
        if not 0.01 <= speed_m_s <= 2:
            raise InputError(f"speed_m_s = {speed_m_s!r}: must lie from 0.01 to 2")
        self.path = parse_path(path) if isinstance(path, str) else path
        self.has_arrived = False
        self.progress_m = 0.0
        self.largest_deviation_m = 0.0
        self._simulation = simulation
        self.speed_m_s = speed_m_s
        position, yaw_rad = self._place()
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        self._points: Points = self.path.points @ np.array([[c, s], [-s, c]]) + position
        self._index = 0

    @property
    def points_in_world(self) -> Points:
        """Return the path's points (N, 2) in the world, metres."""
        return self._points

    def __iter__(self) -> Iterator[int]:
        speed_m_s = self._simulation.body.command(
            Motion(self.speed_m_s, 0.0, 0.0), self._simulation.time_ns + LIFETIME_NS
        ).linear_m_s
        allowed_s = PATIENCE * (1 + self.path.length_m / max(speed_m_s, SLOWEST_M_S)) + 10
        periods_left = round(allowed_s * 1e9 / PERIOD_NS)
        while not self._is_there() and periods_left > 0:
            periods_left -= 1
            now_ns = self._simulation.time_ns
            self._simulation.body.command(self._steer(speed_m_s), now_ns + LIFETIME_NS)
            self._simulation.advance(now_ns + PERIOD_NS)
            yield self._simulation.time_ns
        self._simulation.body.command(REST, self._simulation.time_ns)
        until_ns = self._simulation.time_ns + 1_000_000_000
        while self._simulation.time_ns < until_ns:
            self._simulation.advance(self._simulation.time_ns + PERIOD_NS)
            yield self._simulation.time_ns

    def run(self) -> bool:
        """Drive to the end and return whether the body got there."""
        for _ in self:
            pass
        return self.has_arrived

    def _is_there(self) -> bool:
        self._look()
        self.has_arrived = self._left_m() < ARRIVED_M
        return self.has_arrived

    def _place(self) -> tuple[NDArray[np.float64], float]:
        """Return the true position (2,) and yaw."""
        matrix = self._simulation.robot_pose().matrix()
        return matrix[:2, 3].copy(), math.atan2(matrix[1, 0], matrix[0, 0])

    def _look(self) -> None:
        """Find the nearest point ahead on the path; progress never goes back."""
        position, _ = self._place()
        ahead = self._points[self._index : self._index + round(WINDOW_M / SPACING_M)]
        apart = np.linalg.norm(ahead - position, axis=1)
        nearest = int(np.argmin(apart))
        self._index += nearest
        self.progress_m = self._index * self.path.length_m / (len(self._points) - 1)
        self.largest_deviation_m = max(self.largest_deviation_m, float(apart[nearest]))

    def _left_m(self) -> float:
        """Return what is left of the path, measured along its last direction at its end."""
        last = len(self._points) - 1
        if self._index < last - 2:
            return self.path.length_m - self.progress_m
        position, _ = self._place()
        direction = self._points[-1] - self._points[-2]
        return float((self._points[-1] - position) @ direction / np.linalg.norm(direction))

    def _target(self) -> Points:
        """Return the point to steer at, past the end on the path's last direction."""
        index = self._index + round(LOOKAHEAD_M / SPACING_M)
        beyond = index - (len(self._points) - 1)
        if beyond <= 0:
            return np.asarray(self._points[index])
        return np.asarray(self._points[-1] + beyond * (self._points[-1] - self._points[-2]))

    def _steer(self, speed_m_s: float) -> Motion:
        position, yaw_rad = self._place()
        x, y = self._target() - position
        bearing = math.remainder(math.atan2(y, x) - yaw_rad, 2 * math.pi)
        if abs(bearing) > TURN_IN_PLACE_RAD:
            return Motion(0.0, 0.0, math.copysign(TURN_RAD_S, bearing))
        slow = max(SLOWEST_M_S, BRAKE_PER_S * self._left_m())
        speed = min(speed_m_s, slow)
        curvature = 2 * math.sin(bearing) / math.hypot(x, y)
        return Motion(speed, 0.0, TURN_GAIN * speed * curvature)
