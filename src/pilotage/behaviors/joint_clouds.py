# SPDX-License-Identifier: Apache-2.0
"""The sparse clouds of several stereo pairs in one world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pilotage.evaluation.several import joint_from_own
from pilotage.pose_files import PoseRecord

if TYPE_CHECKING:
    from pilotage.behaviors.pair_track import PairTrack


def joint_cloud(
    tracks: Sequence[PairTrack],
    joint: Sequence[PoseRecord],
    alone: Mapping[str, Sequence[PoseRecord]],
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return (N, 3) points in the joint world, metres, and their (N,) greys.

    Each pair's cloud is laid into it where the two trajectories first meet; what they differ by
    later is not taken out of the points.
    """
    points, greys = [np.zeros((0, 3), np.float32)], [np.zeros(0, np.uint8)]
    for track in tracks:
        placed = joint_from_own(joint, alone[track.source.name])
        if placed is None:
            continue
        own = track.odometry.points()
        points.append((own @ placed[:3, :3].T + placed[:3, 3]).astype(np.float32))
        greys.append(track.odometry.point_greys())
    return np.concatenate(points), np.concatenate(greys)
