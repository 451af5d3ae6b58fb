# SPDX-License-Identifier: Apache-2.0
"""The robots of the simulator, on its clock."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from pilotage.errors import DeviceError, InputError
from pilotage.robots.robot import HeadAngles, RobotState, Velocity
from pilotage.simulation.body import REST, Motion
from pilotage.simulation.nao import Nao
from pilotage.simulation.physics import Simulation


class SimulatedRobot:
    """The body of a simulation as a `Robot`; who advances the simulation moves it."""

    name = "simulated"

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._is_open = False

    def __enter__(self) -> Self:
        self._is_open = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()
        self._is_open = False

    def send(self, command: Velocity) -> Velocity:
        """Obey until the lifetime is over on the simulation's clock, see `Robot.send`."""
        simulation = self._opened()
        wanted = Motion(command.linear_m_s, command.lateral_m_s, command.angular_rad_s)
        until_ns = simulation.time_ns + round(command.lifetime_s * 1e9)
        obeyed = simulation.body.command(wanted, until_ns)
        return Velocity(
            linear_m_s=obeyed.linear_m_s,
            angular_rad_s=obeyed.angular_rad_s,
            lateral_m_s=obeyed.lateral_m_s,
            lifetime_s=command.lifetime_s,
        )

    def stop(self) -> None:
        """Forget the command; what moves still runs out within the actuators' lag."""
        simulation = self._opened()
        simulation.body.command(REST, simulation.time_ns)

    def state(self) -> RobotState:
        """Return the state at the simulation's time, see `RobotState`."""
        simulation = self._opened()
        body = simulation.body
        head, posture = (body.told_head, body.posture) if isinstance(body, Nao) else (None, None)
        return RobotState(
            timestamp_ns=simulation.time_ns,
            linear_m_s=body.motion.linear_m_s,
            angular_rad_s=body.motion.angular_rad_s,
            lateral_m_s=body.motion.lateral_m_s,
            is_moving=max(map(abs, body.motion)) > 1e-3,
            odometry_from_robot=body.odometry.at_height(),
            battery=max(0.0, 1 - body.energy_j / body.capacity_j),
            head=head,
            posture=posture,
        )

    def _opened(self) -> Simulation:
        if not self._is_open:
            raise DeviceError(f"{self.name}: the robot is not open; use it inside `with`")
        return self._simulation


class SimulatedRover(SimulatedRobot):
    """The simulated rover."""

    name = "simulated-rover"


class SimulatedNao(SimulatedRobot):
    """The simulated Nao, with head and postures; InputError when the simulation has no Nao."""

    name = "simulated-nao"

    def __init__(self, simulation: Simulation) -> None:
        super().__init__(simulation)
        if not isinstance(simulation.body, Nao):
            raise InputError("the simulation's body is no Nao; make it with body='nao'")
        self._nao = simulation.body

    def turn_head(self, head: HeadAngles) -> HeadAngles:
        """See `HasHead.turn_head`."""
        self._opened()
        return self._nao.turn_head(head.yaw_rad, head.pitch_rad)

    def take_posture(self, name: str) -> None:
        """See `HasPostures.take_posture`."""
        self._opened()
        self._nao.take_posture(name)
