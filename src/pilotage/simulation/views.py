# SPDX-License-Identifier: Apache-2.0
"""What reaches one camera over an exposure: it moves, and its rows are read one after another."""

from __future__ import annotations

import math

import numpy as np

from pilotage import Camera, Transform
from pilotage.simulation.exposure import Radiance
from pilotage.simulation.physics import Simulation
from pilotage.simulation.pictures import Pictures, camera_rays
from pilotage.simulation.sight import free_m

STILL_PX = 0.3  # a view that moves less within an exposure is rendered once
# The lens's blur hides what sub-exposures a pixel apart leave out of the true streak.
STEP_PX = 1.0
MOST_SUB_EXPOSURES = 16
FAR_M = 100.0


class View:
    """The view of the simulation's camera `name` through the lens model `camera`."""

    def __init__(
        self, simulation: Simulation, pictures: Pictures, name: str, camera: Camera
    ) -> None:
        self._simulation = simulation
        self._pictures = pictures
        self._name = name
        self._camera = camera
        self._rays = camera_rays(camera)
        right, bottom = camera.width_px - 1.0, camera.height_px - 1.0
        pixels = [(right / 2, bottom / 2), (0, 0), (right, 0), (0, bottom), (right, bottom)]
        directions = camera.unproject(np.array(pixels))
        self._directions = directions[np.isfinite(directions).all(axis=1)]

    def seen(
        self,
        *,
        middle_ns: int,
        exposure_s: float,
        readout_s: float,
        channels: int,
        built_from_camera: Transform,
    ) -> Radiance:
        """Return (H, W) or (H, W, 3) radiance, the mean over the exposure.

        `middle_ns` is the middle of the exposure of the middle row.
        """
        count = self._sub_exposures(middle_ns, exposure_s, built_from_camera)
        half_ns = readout_s * 1e9 / 2
        total: Radiance | None = None
        for number in range(count):
            at_ns = middle_ns + ((number + 0.5) / count - 0.5) * exposure_s * 1e9
            radiance = self._pictures.radiance(
                self._name,
                self._rays,
                first_ns=self._known(at_ns - half_ns),
                last_ns=self._known(at_ns + half_ns),
                channels=channels,
                built_from_camera=built_from_camera,
            )
            total = radiance if total is None else total + radiance
        assert total is not None
        return np.asarray(total / count, np.float32)

    def _sub_exposures(self, middle_ns: int, exposure_s: float, mount: Transform) -> int:
        half_ns = exposure_s * 1e9 / 2
        times_ns = [self._known(middle_ns - half_ns), self._known(middle_ns + half_ns)]
        first, last = (pose @ mount for pose in self._simulation.camera_poses(self._name, times_ns))
        moved_px = self._moved_px(first, last)
        if moved_px < STILL_PX:
            return 1
        return min(MOST_SUB_EXPOSURES, max(2, math.ceil(moved_px / STEP_PX)))

    def _known(self, time_ns: float) -> int:
        """Return a time between the simulation's start, where all stood still, and now."""
        return min(max(0, round(time_ns)), self._simulation.time_ns)

    def _moved_px(self, first: Transform, last: Transform) -> float:
        """Return how far the picture's middle and corners move from one pose to the other."""
        last_from_first = last.inverse() @ first
        if not np.any(last_from_first.log()):
            return 0.0
        turn = first.matrix()[:3, :3]
        model, data, here = self._simulation.model, self._simulation.data, first.translation_m
        points = np.array(
            [
                direction * (free_m(model, data, here, turn @ direction) or FAR_M)
                for direction in self._directions
            ]
        )
        moved = points @ last_from_first.matrix()[:3, :3].T + last_from_first.translation_m
        shift_px = self._camera.project(moved) - self._camera.project(points)
        # A point that leaves the view moves far, but says nothing of the others.
        return float(np.nanmax(np.linalg.norm(shift_px, axis=1), initial=0.0))
