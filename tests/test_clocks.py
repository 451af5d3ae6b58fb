# SPDX-License-Identifier: Apache-2.0
"""Clocks of two trajectories: an offset and a drift found by how the robot moved."""

from __future__ import annotations

import numpy as np
import pytest

from pilotage.evaluation.clocks import Track, check_clocks
from pilotage.evaluation.poses import Array, pose_matrices

PERIOD_S = 0.2


def poses_at(times_s: Array, noise_m: float, seed: int) -> Array:
    """Return a robot that starts, stops and turns now left, now right."""
    fine_s = np.linspace(-1, times_s[-1] + 2, 20001)
    speed_m_s = 0.3 + 0.2 * np.sin(1.3 * fine_s) + 0.1 * np.sin(3.1 * fine_s)
    turn_rad = np.cumsum(0.5 * np.sin(0.9 * fine_s) + 0.3 * np.sin(2.3 * fine_s)) * (
        fine_s[1] - fine_s[0]
    )
    steps = speed_m_s * (fine_s[1] - fine_s[0])
    x_m, y_m = np.cumsum(steps * np.cos(turn_rad)), np.cumsum(steps * np.sin(turn_rad))
    generator = np.random.default_rng(seed)
    places = np.column_stack([np.interp(times_s, fine_s, column) for column in (x_m, y_m)])
    places += generator.normal(0, noise_m, places.shape)
    half = 0.5 * np.interp(times_s, fine_s, turn_rad)
    zeros = np.zeros(len(times_s))
    quaternions = np.column_stack([np.cos(half), zeros, zeros, np.sin(half)])
    return pose_matrices(np.column_stack([places, zeros]), quaternions)


def tracks(
    offset_s: float, drift: float, *, duration_s: float = 60.0, noise_m: float = 0.001
) -> tuple[Track, Track]:
    """Return two trajectories; the second one's clock is late and runs too fast."""
    first_s = np.arange(0, duration_s, PERIOD_S)
    second_s = first_s + 0.07  # shutters need not coincide
    stamped_s = second_s + offset_s + drift * (second_s - duration_s / 2)

    def track(times_s: Array, stamps_s: Array, seed: int) -> Track:
        return Track(
            (1e18 + stamps_s * 1e9).astype(np.int64),
            poses_at(times_s, noise_m, seed),
            np.zeros(len(times_s), np.int64),
        )

    return track(first_s, first_s, 1), track(second_s, stamped_s, 2)


@pytest.mark.parametrize("offset_s", [0.0, 0.04, -0.15, 0.4])
def test_a_constant_offset(offset_s: float):
    check = check_clocks(*tracks(offset_s, 0.0))
    assert check is not None
    assert check.offset_s == pytest.approx(offset_s, abs=0.012)
    assert check.is_offset == (abs(offset_s) > 0.1)
    assert not check.drifts


def test_a_drift():
    check = check_clocks(*tracks(0.0, 0.01))
    assert check is not None
    assert check.drift_s_min == pytest.approx(0.6, rel=0.1)
    assert check.drifts
    assert not check.is_offset


def test_a_drift_that_does_not_matter_is_none():
    check = check_clocks(*tracks(0.0, 0.0005))
    assert check is not None
    assert not check.drifts


def test_motion_that_does_not_tell():
    first, second = tracks(0.3, 0.0)
    still = Track(first.timestamps_ns, np.tile(np.eye(4), (len(first.poses), 1, 1)), first.segments)
    assert check_clocks(still, still) is None
    short = Track(second.timestamps_ns[:10], second.poses[:10], second.segments[:10])
    assert check_clocks(first, short) is None
    later = Track(second.timestamps_ns + 10**12, second.poses, second.segments)
    assert check_clocks(first, later) is None


def test_gaps_and_new_segments_do_not_mislead():
    first, second = tracks(-0.2, 0.0)
    keep = np.ones(len(second.poses), dtype=bool)
    keep[60:100] = False
    jump = np.eye(4)
    jump[:3, 3] = (5.0, -3.0, 1.0)
    poses = second.poses.copy()
    poses[150:] = jump @ poses[150:]
    segments = (np.arange(len(poses)) >= 150).astype(np.int64)
    check = check_clocks(first, Track(second.timestamps_ns[keep], poses[keep], segments[keep]))
    assert check is not None
    assert check.offset_s == pytest.approx(-0.2, abs=0.012)
    assert check.is_offset
