# SPDX-License-Identifier: Apache-2.0
"""Adding up motion in the plane."""

from __future__ import annotations

import math

from pilotage.simulation.body import Motion, Pose2


def advanced(pose: Pose2, motion: Motion, duration_s: float) -> Pose2:
    """Return where steady `motion` leads from `pose`; steps are short, so taken at mid-turn."""
    middle = pose.yaw_rad + motion.angular_rad_s * duration_s / 2
    c, s = math.cos(middle), math.sin(middle)
    forward, left = motion.linear_m_s * duration_s, motion.lateral_m_s * duration_s
    return Pose2(
        pose.x_m + c * forward - s * left,
        pose.y_m + s * forward + c * left,
        pose.yaw_rad + motion.angular_rad_s * duration_s,
    )
