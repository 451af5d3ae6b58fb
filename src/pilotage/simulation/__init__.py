# SPDX-License-Identifier: Apache-2.0
"""Simulated worlds, the bodies that move in them, faults, and drives for tests."""

from pilotage.simulation.body import Body, Motion, Pose2
from pilotage.simulation.clearance import FreeFloor
from pilotage.simulation.drives import Drive
from pilotage.simulation.encoders import Encoders
from pilotage.simulation.faults import Fault, read_faults
from pilotage.simulation.models import ROBOTS, RobotModel, robot_model
from pilotage.simulation.paths import DrivePath, parse_path
from pilotage.simulation.physics import Simulation
from pilotage.simulation.sensor import Sensor, read_sensor
from pilotage.simulation.world import World
from pilotage.simulation.worlds import load_world

__all__ = [
    "ROBOTS",
    "Body",
    "Drive",
    "DrivePath",
    "Encoders",
    "Fault",
    "FreeFloor",
    "Motion",
    "Pose2",
    "RobotModel",
    "Sensor",
    "Simulation",
    "World",
    "load_world",
    "parse_path",
    "read_faults",
    "read_sensor",
    "robot_model",
]
