# SPDX-License-Identifier: Apache-2.0
"""Robots: one contract for all, and what the Nao's head, postures and walk are like."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pilotage.calibration.nao_head import pitch_limits_rad
from pilotage.errors import DeviceError, InputError
from pilotage.robots import Robot, Velocity
from pilotage.robots.robot import HeadAngles
from pilotage.robots.simulated import SimulatedNao, SimulatedRobot, SimulatedRover
from pilotage.simulation import Fault, Simulation, load_world
from pilotage.simulation.nao import TORSO_M, Nao

SECOND_NS = 1_000_000_000


def simulation_of(body: str, *, seed: int = 0, faults: tuple[Fault, ...] = ()) -> Simulation:
    world = load_world("yard", seed=3, options={"ground": "asphalt", "objects": 3})
    return Simulation(world, body, seed=seed, faults=faults)


def wait(simulation: Simulation, seconds: float) -> None:
    simulation.advance(simulation.time_ns + round(seconds * SECOND_NS))


@pytest.fixture(params=["rover", "nao"])
def simulated(request: pytest.FixtureRequest) -> tuple[Simulation, SimulatedRobot]:
    simulation = simulation_of(request.param)
    kinds = {"rover": SimulatedRover, "nao": SimulatedNao}
    return simulation, kinds[request.param](simulation)


def test_commands_end_with_their_lifetime(simulated: tuple[Simulation, SimulatedRobot]):
    simulation = simulated[0]
    robot: Robot = simulated[1]
    with robot:
        robot.send(Velocity(linear_m_s=0.09, angular_rad_s=0.0, lifetime_s=1.0))
        wait(simulation, 1.0)
        assert robot.state().is_moving
        assert robot.state().timestamp_ns == simulation.time_ns
        wait(simulation, 1.5)
        state = robot.state()
        assert not state.is_moving
        odometry = state.odometry_from_robot
        assert odometry is not None
        assert odometry.translation_m[0] == pytest.approx(0.09, abs=0.02)
        assert 0.9 < (state.battery or 0) < 1
        here = simulation.robot_pose().translation_m
        wait(simulation, 1.0)
        assert simulation.robot_pose().translation_m == pytest.approx(here, abs=1e-4)


def test_a_newer_command_takes_the_place_of_the_one_before(
    simulated: tuple[Simulation, SimulatedRobot],
):
    simulation, robot = simulated
    with robot:
        robot.send(Velocity(linear_m_s=0.09, angular_rad_s=0.0, lifetime_s=5.0))
        robot.send(Velocity(linear_m_s=0.05, angular_rad_s=0.0, lifetime_s=0.2))
        wait(simulation, 2.0)
        assert not robot.state().is_moving


def test_leaving_stops_whatever_happens(simulated: tuple[Simulation, SimulatedRobot]):
    simulation, robot = simulated

    def fail_on_the_way() -> None:
        with robot:
            robot.send(Velocity(linear_m_s=0.09, angular_rad_s=0.0, lifetime_s=5.0))
            wait(simulation, 0.5)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_on_the_way()
    wait(simulation, 2.0)
    here = simulation.robot_pose().translation_m
    wait(simulation, 1.0)
    assert simulation.robot_pose().translation_m == pytest.approx(here, abs=1e-4)


def test_commands_are_cut_to_what_the_body_can(simulated: tuple[Simulation, SimulatedRobot]):
    _, robot = simulated
    with robot:
        obeyed = robot.send(
            Velocity(linear_m_s=9.0, angular_rad_s=-9.0, lateral_m_s=9.0, lifetime_s=0.5)
        )
    assert 0 < obeyed.linear_m_s < 1
    assert -2 < obeyed.angular_rad_s < 0
    assert obeyed.lateral_m_s < 0.1


def test_a_closed_robot_says_so(simulated: tuple[Simulation, SimulatedRobot]):
    _, robot = simulated
    for call in (robot.state, robot.stop):
        with pytest.raises(DeviceError, match="not open"):
            call()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lifetime_s": 0}, "lifetime_s = 0"),
        ({"lifetime_s": 60}, "at most 5"),
        ({"lifetime_s": math.nan}, "lifetime_s"),
        ({"linear_m_s": math.nan}, "linear_m_s"),
        ({"angular_rad_s": math.inf}, "angular_rad_s"),
    ],
)
def test_wrong_commands_are_refused(values: dict[str, float], words: str):
    right = {"linear_m_s": 0.1, "angular_rad_s": 0.0, "lifetime_s": 0.5}
    with pytest.raises(InputError, match=words):
        Velocity(**(right | values))


def about(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1]] if axis == "z" else [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    )


@pytest.mark.parametrize("head", [(0.0, 0.0), (0.585, -0.5236), (-1.0, 0.2), (2.0, -0.3)])
def test_nao_cameras_sit_at_the_published_offsets(head: tuple[float, float]):
    simulation = simulation_of("nao")
    with SimulatedNao(simulation) as robot:
        assert robot.turn_head(HeadAngles(*head)) == HeadAngles(*head)
        wait(simulation, 2)
        # By its encoders: half the play, a step, and noise.
        assert robot.state().head == pytest.approx(HeadAngles(*head), abs=0.005)
    # By hand from the maker's figures, the torso standing over the robot's origin.
    published = {"top": (0.05871, 0.06364, 0.0209), "bottom": (0.05071, 0.01774, 0.6929)}
    robot_from_world = simulation.robot_pose().inverse()
    for name, (x, z, pitch) in published.items():
        turn = about("z", head[0]) @ about("y", head[1])
        position = np.array([0, 0, TORSO_M["stand"] + 0.1265]) + turn @ [x, 0, z]
        looking = turn @ about("y", pitch)
        camera = (robot_from_world @ simulation.camera_pose(name)).matrix()
        assert camera[:3, 3] == pytest.approx(position, abs=1e-9)
        assert camera[:3, 2] == pytest.approx(looking[:, 0], abs=1e-9)
        assert camera[:3, 0] == pytest.approx(-looking[:, 1], abs=1e-9)
        assert camera[:3, 1] == pytest.approx(-looking[:, 2], abs=1e-9)


def test_the_shell_narrows_the_pitch():
    assert np.degrees(pitch_limits_rad(0)) == pytest.approx([-38.5, 29.5], abs=0.02)
    for yaw_deg, low, high in ((62.45, -24.6, 17.2), (87.49, -18.9, 11.5)):
        for side in (1, -1):
            limits = np.degrees(pitch_limits_rad(side * math.radians(yaw_deg)))
            assert limits == pytest.approx([low, high], abs=0.06)
    simulation = simulation_of("nao")
    body = simulation.body
    assert isinstance(body, Nao)
    with SimulatedNao(simulation) as robot:
        goal = robot.turn_head(HeadAngles(math.radians(87.49), 1.0))
        assert math.degrees(goal.pitch_rad) == pytest.approx(11.46)
        assert robot.turn_head(HeadAngles(-9.0, 0.0)).yaw_rad == -2.0857
        # Low at one side, then low at the other: on the way the shell never lets it down.
        for yaw_rad in (-1.5, 1.5):
            robot.turn_head(HeadAngles(yaw_rad, 0.5))
            for _ in range(20):
                wait(simulation, 0.1)
                head = body.head
                assert head.pitch_rad <= pitch_limits_rad(head.yaw_rad)[1] + 1e-12


def test_a_crouching_nao_sees_from_11_cm_lower_and_does_not_walk():
    simulation = simulation_of("nao")
    with SimulatedNao(simulation) as robot:
        standing = simulation.camera_pose("top")
        robot.take_posture("crouch")
        assert robot.state().posture is None
        wait(simulation, 2)
        assert robot.state().posture == "crouch"
        standing_from_crouching = standing.inverse() @ simulation.camera_pose("top")
        assert np.linalg.norm(standing_from_crouching.translation_m) == pytest.approx(0.11)
        obeyed = robot.send(Velocity(linear_m_s=0.1, angular_rad_s=0.0, lifetime_s=1.0))
        assert obeyed.linear_m_s == 0
        robot.take_posture("stand")
        wait(simulation, 2)
        assert simulation.camera_pose("top").matrix() == pytest.approx(standing.matrix())
        with pytest.raises(InputError, match="did you mean 'crouch'"):
            robot.take_posture("crouched")
    with pytest.raises(InputError, match="body='nao'"):
        SimulatedNao(simulation_of("rover"))


def test_nao_shakes_while_it_walks_and_errs_as_its_seed_says():
    ends = []
    for seed in (1, 1, 2):
        simulation = simulation_of("nao", seed=seed)
        tilts = []
        with SimulatedNao(simulation) as robot:
            robot.send(Velocity(linear_m_s=0.09, angular_rad_s=0.0, lifetime_s=4.0))
            for _ in range(40):
                wait(simulation, 0.1)
                robot_from_top = simulation.robot_pose().inverse() @ simulation.camera_pose("top")
                tilts.append(robot_from_top.matrix()[2, 0])
            wait(simulation, 3)
            state = robot.state()
        assert math.radians(1) < max(np.abs(tilts)) < math.radians(5)
        robot_from_top = simulation.robot_pose().inverse() @ simulation.camera_pose("top")
        assert robot_from_top.matrix()[2, 0] == pytest.approx(0, abs=1e-12)
        assert state.odometry_from_robot is not None
        assert state.odometry_from_robot.translation_m[0] == pytest.approx(0.36, abs=0.01)
        ends.append(simulation.robot_pose().translation_m)
    assert (ends[0] == ends[1]).all()
    assert np.linalg.norm(ends[0] - ends[2]) > 1e-3
    assert np.linalg.norm(ends[0] - [0.36, 0, 0]) > 1e-3


def test_nao_halts_before_a_wall_and_its_odometry_does_not_notice():
    simulation = Simulation(
        load_world("corridor", seed=1, options={"objects": 0, "width_m": 1.6}), "nao"
    )
    with SimulatedNao(simulation) as robot:
        for _ in range(4):
            robot.send(
                Velocity(linear_m_s=0.0, angular_rad_s=0.0, lateral_m_s=0.05, lifetime_s=5.0)
            )
            wait(simulation, 5)
        state = robot.state()
    assert state.odometry_from_robot is not None
    assert state.odometry_from_robot.translation_m[1] > 0.9
    assert 0.5 < simulation.robot_pose().translation_m[1] < 0.72


def test_a_push_and_lost_grip_leave_the_nao_elsewhere_than_it_thinks():
    faults = (Fault("push_left", 0.5, 2.0), Fault("slip", 2.0, 0.5))
    simulation = simulation_of("nao", faults=faults)
    with SimulatedNao(simulation) as robot:
        wait(simulation, 2)
        pushed = simulation.robot_pose().translation_m[1]
        assert 0.05 < pushed < 0.15
        robot.send(Velocity(linear_m_s=0.09, angular_rad_s=0.0, lifetime_s=3.0))
        wait(simulation, 4)
        state = robot.state()
    assert state.odometry_from_robot is not None
    believed = state.odometry_from_robot.translation_m[0]
    assert simulation.robot_pose().translation_m[0] < 0.65 * believed
