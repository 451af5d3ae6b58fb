# SPDX-License-Identifier: Apache-2.0
"""Robots: one protocol, one file a robot."""

from pilotage.robots.robot import Robot, RobotState, Velocity

__all__ = ["Robot", "RobotState", "Velocity"]
