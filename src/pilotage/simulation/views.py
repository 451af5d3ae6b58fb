# SPDX-License-Identifier: Apache-2.0
"""What reaches one camera over an exposure: it moves, as other things do, and reads row by row."""

from __future__ import annotations

from collections.abc import Callable

from pilotage import Camera, Transform, _core
from pilotage.simulation.exposure import Radiance
from pilotage.simulation.physics import Simulation
from pilotage.simulation.pictures import Pictures, camera_rays


class View:
    """The view of the simulation's camera `name` through the lens model `camera`."""

    def __init__(
        self, simulation: Simulation, pictures: Pictures, name: str, camera: Camera
    ) -> None:
        self._simulation = simulation
        self._pictures = pictures
        self._name = name
        self._rays = camera_rays(camera)

    def look(
        self,
        *,
        middle_ns: int,
        exposure_s: float,
        readout_s: float,
        channels: int,
        built_from_camera: Transform,
    ) -> Callable[[int], Radiance]:
        """Return what renders (H, W) or (H, W, 3) radiance, the mean over the exposure.

        `middle_ns` is the middle of the exposure of the middle row. What is returned takes a number
        of threads; any thread may call it.
        """
        half_ns, half_row_ns = readout_s * 1e9 / 2, exposure_s * 1e9 / 2
        times_ns = [
            self._known(middle_ns + row_ns + within_ns)
            for row_ns in (-half_ns, half_ns)
            for within_ns in (-half_row_ns, 0, half_row_ns)
        ]
        poses = self._simulation.camera_poses(self._name, times_ns)
        begin, middle, end, *last = (pose @ built_from_camera for pose in poses)
        open_s = exposure_s + readout_s
        shutter = _core.ShutterPoses(
            first=_core.RowExposure(begin=begin, middle=middle, end=end),
            last=_core.RowExposure(begin=last[0], middle=last[1], end=last[2]),
            exposed_share=exposure_s / open_s if open_s > 0 else 1.0,
            moving=self._pictures.motions(times_ns[0], times_ns[-1]),
        )

        def render(threads: int) -> Radiance:
            return self._pictures.radiance(self._rays, shutter, channels=channels, threads=threads)

        return render

    def _known(self, time_ns: float) -> int:
        """Return a time between the simulation's start, where all stood still, and now."""
        return min(max(0, round(time_ns)), self._simulation.time_ns)
