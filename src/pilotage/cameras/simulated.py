# SPDX-License-Identifier: Apache-2.0
"""The cameras of the simulator, on its clock."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import NamedTuple, Self

from pilotage import Camera as LensModel
from pilotage.cameras.camera import Frame
from pilotage.errors import DeviceError, InputError
from pilotage.simulation.camera_group import CameraGroup, Shot
from pilotage.simulation.physics import Simulation
from pilotage.simulation.pictures import Pictures
from pilotage.simulation.sensor import Sensor

SLOWEST_HZ, FASTEST_HZ = 5.0, 60.0
NS = 1_000_000_000


class _Arrival(NamedTuple):
    """A frame, and when it is there."""

    at_ns: int
    frame: Frame


class SimulatedCamera:
    """Cameras of a simulation that fire together at `rate_hz`, as a `Camera`.

    `cameras` maps the simulation's cameras to their lens models. Waiting for a frame lets the
    simulation's time pass; who advances it otherwise misses the frames in between, as with any
    camera. Pictures come with the errors of `sensor` and of the simulation's faults. Several may
    share one `pictures`, the drawn scene, which takes a while to build.
    """

    def __init__(  # noqa: PLR0913, what a camera is made of
        self,
        simulation: Simulation,
        cameras: Mapping[str, LensModel],
        *,
        name: str = "simulated-camera",
        sensor: Sensor | None = None,
        rate_hz: float = 10.0,
        pictures: Pictures | None = None,
    ) -> None:
        if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
            raise InputError(f"rate_hz = {rate_hz!r}: must lie from {SLOWEST_HZ} to {FASTEST_HZ}")
        self.name = name
        self.frames = tuple(cameras)
        self._simulation = simulation
        self._cameras = dict(cameras)
        self._sensor = sensor if sensor is not None else Sensor()
        self._period_ns = round(NS / rate_hz)
        self._pictures = pictures
        self._group: CameraGroup | None = None

    def __enter__(self) -> Self:
        simulation = self._simulation
        self._group = CameraGroup(
            simulation,
            self._cameras,
            self._sensor,
            seed=simulation.world.seed,
            pictures=self._pictures,
        )
        # Which frame was taken last, and those on their way: switched on, it gives nothing older.
        self._taken = self._due(simulation.time_ns)
        self._coming: list[_Arrival] = []
        self._newest: Frame | None = None
        self._is_given = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._group = None

    def read(self, *, timeout_s: float) -> Frame | None:
        """Let the simulation's time pass until there is a new frame, see `Camera.read`."""
        simulation = self._simulation
        until_ns = simulation.time_ns + round(timeout_s * NS)
        self._look()
        while self._is_given and simulation.time_ns < until_ns:
            simulation.advance(min(until_ns, self._next_event_ns()))
            self._look()
        if self._is_given:
            return None
        self._is_given = True
        return self._newest

    def latest(self, *, max_age_s: float) -> Frame | None:
        """Return the newest frame at the simulation's time, see `Camera.latest`."""
        self._look()
        newest = self._newest
        if newest is None or self._simulation.time_ns - newest.timestamp_ns > max_age_s * NS:
            return None
        return newest

    def _look(self) -> None:
        """Take the frame that is due, and receive those that have arrived."""
        if self._group is None:
            raise DeviceError(f"{self.name}: the camera is not open; use it inside `with`")
        due = self._due(self._simulation.time_ns)
        if due > self._taken:
            self._taken = due
            ended_ns = due * self._period_ns
            shot = self._group.take(ended_ns)
            if shot is not None and len(shot.pictures) == len(self.frames):
                arrival_ns = ended_ns + round(shot.delay_s * NS)
                self._coming.append(_Arrival(arrival_ns, _frame(shot)))
        while self._coming and self._coming[0].at_ns <= self._simulation.time_ns:
            self._newest = self._coming.pop(0).frame
            self._is_given = False

    def _due(self, time_ns: int) -> int:
        return time_ns // self._period_ns

    def _next_event_ns(self) -> int:
        """Return when the next frame is due or arrives."""
        events = [(self._taken + 1) * self._period_ns]
        return min(events + [arrival.at_ns for arrival in self._coming[:1]])


def _frame(shot: Shot) -> Frame:
    return Frame(
        timestamp_ns=shot.timestamp_ns,
        pictures=shot.pictures,
        exposure_s=shot.exposure_s,
    )
