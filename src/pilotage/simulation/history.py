# SPDX-License-Identifier: Apache-2.0
"""Where things were a moment ago, between the steps of the physics as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.errors import InputError


class PoseHistory:
    """The last `capacity` poses of some bodies, `step_ns` apart: world_from_body."""

    def __init__(self, bodies: int, capacity: int, step_ns: int) -> None:
        self._poses = np.zeros((capacity, bodies, 7))
        self._step_ns = step_ns
        self._count = 0
        self._newest_ns = 0

    def add(
        self, time_ns: int, positions_m: NDArray[np.float64], quaternions: NDArray[np.float64]
    ) -> None:
        """Add the poses of one step: (bodies, 3) and (bodies, 4) wxyz."""
        entry = self._poses[(time_ns // self._step_ns) % len(self._poses)]
        entry[:, :3] = positions_m
        entry[:, 3:] = quaternions
        self._count = min(self._count + 1, len(self._poses))
        self._newest_ns = time_ns

    def pose(self, body: int, time_ns: int) -> Transform:
        """Return world_from_body at a time; InputError when it is not remembered."""
        oldest_ns = self._newest_ns - (self._count - 1) * self._step_ns
        if not oldest_ns <= time_ns <= self._newest_ns:
            raise InputError(
                f"time_ns = {time_ns}: poses are remembered from {oldest_ns} to {self._newest_ns}"
            )
        index, beyond_ns = divmod(int(time_ns), self._step_ns)
        before = self._poses[index % len(self._poses), body]
        if beyond_ns == 0:
            return Transform(translation_m=before[:3], quaternion_wxyz=before[3:])
        after = self._poses[(index + 1) % len(self._poses), body]
        share = beyond_ns / self._step_ns
        sign = 1.0 if before[3:] @ after[3:] >= 0 else -1.0
        # Over one step the straight way between quaternions is the arc to within 1e-9 rad.
        quaternion = (1 - share) * before[3:] + share * sign * after[3:]
        quaternion /= np.linalg.norm(quaternion)
        position = (1 - share) * before[:3] + share * after[:3]
        return Transform(translation_m=position, quaternion_wxyz=quaternion)
