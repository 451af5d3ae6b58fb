# SPDX-License-Identifier: Apache-2.0
"""The odometry on pictures whose rows were exposed one after another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pilotage import StereoOdometry, StereoRig
from pilotage.evaluation.metrics import evaluate_trajectory
from pilotage.simulation import Drive, Sensor, Simulation, load_world, robot_model
from pilotage.simulation.camera_group import CameraGroup

READOUT_S, RATE_HZ, WIDTH_PX = 0.016, 5, 240
PATH = "straight-4m"


@pytest.fixture(scope="module", params=["front", "down"])
def drive(request: pytest.FixtureRequest) -> tuple[StereoRig, list, np.ndarray]:
    """Return the rig, (left, right, timestamp_ns) of each pair, and the true poses (N, 4, 4)."""
    world = load_world("yard", seed=5, options={"ground": "gravel", "path": PATH})
    simulation, robot = Simulation(world, "rover", seed=5), robot_model("rover")
    rig = robot.stereo_rig(simulation, request.param, WIDTH_PX, READOUT_S)
    cameras = dict(zip(robot.pairs[request.param], (rig.left, rig.right), strict=True))
    sensor = replace(Sensor(), readout_s=READOUT_S, exposure_s=0.001)
    group = CameraGroup(simulation, cameras, sensor, seed=5)
    pairs, truth = [], []
    for now_ns in Drive(simulation, PATH, speed_m_s=0.6):
        if now_ns < len(pairs) * 1_000_000_000 // RATE_HZ:
            continue
        shot = group.take()
        if shot is not None:
            pairs.append((*shot.pictures.values(), shot.timestamp_ns))
            truth.append(simulation.robot_pose(shot.taken_ns).matrix())
    return rig, pairs, np.array(truth)


def ate_percent(rig: StereoRig, pairs: list, truth: np.ndarray) -> float:
    odometry = StereoOdometry(rig=rig)
    for left, right, timestamp_ns in pairs:
        odometry.track(left, right, timestamp_ns)
    results = odometry.finish()
    poses = np.array([result.world_from_left.matrix() for result in results])
    covariances = np.array([result.covariance for result in results])
    metrics = evaluate_trajectory(estimate=poses, truth=truth, covariances=covariances)
    return metrics.ate_percent_of_length


def test_a_readout_that_is_known_does_no_harm(drive: tuple[StereoRig, list, np.ndarray]) -> None:
    rig, pairs, truth = drive
    as_global = StereoRig(
        left=rig.left,
        right=rig.right,
        right_from_left=rig.right_from_left,
        robot_from_left=rig.robot_from_left,
    )
    error = ate_percent(rig, pairs, truth)
    assert error < 0.06
    assert error < 0.5 * ate_percent(as_global, pairs, truth)
