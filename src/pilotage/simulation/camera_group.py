# SPDX-License-Identifier: Apache-2.0
"""Cameras that fire together, with all that sensors and faults do to their pictures and stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from pilotage import Camera
from pilotage.simulation.camera_faults import (
    CameraActing,
    acting_on_camera,
    acting_on_pair,
    pairs_of,
)
from pilotage.simulation.exposure import Exposer, Imager, Picture, Radiance
from pilotage.simulation.faults import Fault
from pilotage.simulation.lens import Lens
from pilotage.simulation.options import check_seed
from pilotage.simulation.parallel import in_parallel
from pilotage.simulation.physics import Simulation
from pilotage.simulation.pictures import Pictures
from pilotage.simulation.sensor import Sensor
from pilotage.simulation.views import View

SALT = 77  # keeps these draws apart from those of worlds and bodies
INDOOR_LIGHT = 0.05  # some 500 lx over some 10 klx
LARGEST_LAG = 10  # frames


@dataclass(frozen=True, kw_only=True)
class Shot:
    """What cameras that fire together gave at once.

    `taken_ns` is the true middle of the exposure of the middle row, `stamps_ns` what the device
    says of it for each camera. `pictures` holds those that come: (H, W) grey or (H, W, 3)
    blue-green-red; they come `delay_s` late.
    """

    taken_ns: int
    exposure_s: float
    delay_s: float
    stamps_ns: Mapping[str, int]
    pictures: Mapping[str, Picture]

    @property
    def timestamp_ns(self) -> int:
        """Return the stamp of all together: of those stamped on arrival the last one's."""
        return max(self.stamps_ns.values())


@dataclass
class _Eye:
    """One camera of the group; `kept` are its newest pictures, for a partner out of step."""

    name: str
    view: View
    lens: Lens
    imager: Imager
    kept: deque[Picture]
    newest_stamp_ns: int = -1


class CameraGroup:
    """Cameras of a simulation that fire together: `cameras` maps their names to lens models.

    The simulation's faults act on them. The same arguments and calls give the same bits; what is
    drawn for a frame does not depend on how often the others were asked for. Groups may share one
    `Pictures`. InputError when a camera does not exist.
    """

    def __init__(
        self,
        simulation: Simulation,
        cameras: Mapping[str, Camera],
        sensor: Sensor,
        *,
        seed: int,
        pictures: Pictures | None = None,
    ) -> None:
        self._simulation = simulation
        for name in cameras:
            simulation.camera_pose(name)  # InputError unless it exists
        self._sensor = sensor
        self._seed = [SALT, check_seed(seed), *map(ord, "".join(cameras))]
        self._exposer = Exposer(sensor, light=INDOOR_LIGHT if _is_indoors(simulation) else 1.0)
        self._pictures = pictures if pictures is not None else Pictures(simulation)
        self._eyes = [
            _Eye(
                name=name,
                view=View(simulation, self._pictures, name, camera),
                lens=Lens(sensor.blur_px, [*self._seed, number]),
                imager=Imager(sensor, np.random.default_rng([*self._seed, number])),
                kept=deque(maxlen=1 + max_lag(simulation.faults)),
            )
            for number, (name, camera) in enumerate(cameras.items())
        ]
        self._pairs = pairs_of(list(cameras))
        self._newest_ns = -1

    def take(self, ended_ns: int | None = None) -> Shot | None:
        """Return the shot whose last row was read out just now, or at a time of the last 0.2 s.

        Before the simulation began all stood still as at its start. None for a shot that is not
        newer than the last. InputError when a camera is inside something; it names world, camera
        and place.
        """
        ended_ns = self._simulation.time_ns if ended_ns is None else ended_ns
        if not self._exposer.is_metered:
            self._meter(ended_ns)
        exposure_s = self._exposer.exposure_s
        half_ns = round((exposure_s + self._sensor.readout_s) * 1e9 / 2)
        middle_ns = max(0, ended_ns - half_ns)
        if middle_ns <= self._newest_ns:
            return None
        self._newest_ns = middle_ns
        acting = self._acting(middle_ns)
        looks = self._looks(acting, middle_ns, exposure_s)
        drawn = [np.random.SeedSequence([*self._seed, ended_ns, n]) for n in range(len(looks))]
        taken = in_parallel(
            [
                partial(self._expose, eye, look, int(seed.generate_state(1, np.uint64)[0]))
                for eye, look, seed in zip(self._eyes, looks, drawn, strict=True)
            ]
        )
        for eye, (picture, _) in zip(self._eyes, taken, strict=True):
            eye.kept.append(picture)
        # The brightest decides: a covered camera must not make the other one blind as well.
        self._exposer.regulate(max(mean for _, mean in taken))
        pictures = {eye.name: eye.kept[-1] for eye in self._eyes}
        random = np.random.default_rng([*self._seed, ended_ns])
        for pair in self._pairs:
            self._mix_up(pair, middle_ns, pictures, random)
        coming = self._coming(acting, random)
        return Shot(
            taken_ns=middle_ns,
            exposure_s=exposure_s,
            delay_s=max(state.delay_s for state in acting.values()),
            stamps_ns=self._stamps(middle_ns, acting, random),
            pictures={name: pictures[name] for name in coming},
        )

    def _meter(self, at_ns: int) -> None:
        lights = in_parallel(self._looks(self._acting(at_ns), at_ns, 0.0))
        self._exposer.regulate(max(float(light.mean()) for light in lights))

    def _acting(self, time_ns: int) -> dict[str, CameraActing]:
        faults = self._simulation.faults
        return {eye.name: acting_on_camera(faults, eye.name, time_ns) for eye in self._eyes}

    def _looks(
        self, acting: Mapping[str, CameraActing], middle_ns: int, exposure_s: float
    ) -> list[Callable[[int], Radiance]]:
        """Return for each camera what renders the light on its sensor, with so many threads.

        All that depends on the simulation is done here: each may run in a thread of its own.
        """
        return [self._look(eye, acting[eye.name], middle_ns, exposure_s) for eye in self._eyes]

    def _look(
        self, eye: _Eye, acting: CameraActing, middle_ns: int, exposure_s: float
    ) -> Callable[[int], Radiance]:
        at_ns = max(0, middle_ns - self._lag_ns(eye.name, middle_ns))
        pose = self._simulation.camera_pose(eye.name, at_ns) @ acting.built_from_camera
        self._simulation.check_free(eye.name, pose.translation_m, at_ns)
        render = eye.view.look(
            middle_ns=at_ns,
            exposure_s=exposure_s,
            readout_s=self._sensor.readout_s if exposure_s else 0.0,
            channels=self._sensor.channels,
            built_from_camera=acting.built_from_camera,
        )
        return lambda threads: eye.lens.pass_on(render(threads), acting)

    def _expose(
        self, eye: _Eye, look: Callable[[int], Radiance], noise_seed: int, threads: int
    ) -> tuple[Picture, float]:
        """Return one camera's picture and its mean light."""
        light = look(threads)
        return eye.imager.expose(light, self._exposer, seed=noise_seed), float(light.mean())

    def _lag_ns(self, camera: str, time_ns: int) -> int:
        """Return how much older a camera's view is than its partner's."""
        for pair, (left, right) in self._pairs.items():
            if camera in {left, right}:
                lag_s = acting_on_pair(self._simulation.faults, pair, time_ns).lag_s
                return max(0, round(1e9 * (lag_s if camera == right else -lag_s)))
        return 0

    def _mix_up(
        self, pair: str, time_ns: int, pictures: dict[str, Picture], random: np.random.Generator
    ) -> None:
        """Let one side of a pair fall frames behind, and swap the two."""
        left, right = self._pairs[pair]
        acting = acting_on_pair(self._simulation.faults, pair, time_ns)
        behind = right if acting.lag_frames > 0 else left
        for eye in self._eyes:
            if eye.name == behind and acting.lag_frames:
                pictures[behind] = eye.kept[max(0, len(eye.kept) - 1 - abs(acting.lag_frames))]
        if random.uniform() < acting.swapped:
            pictures[left], pictures[right] = pictures[right], pictures[left]

    def _coming(self, acting: Mapping[str, CameraActing], random: np.random.Generator) -> list[str]:
        """Return the cameras whose pictures are not lost."""
        # Drawn whether they are needed or not: no fault then changes what follows.
        is_lost, *losses = random.uniform(size=1 + len(self._eyes)) < [
            self._sensor.drop_share,
            *(state.dropped for state in acting.values()),
        ]
        names = zip(acting, losses, strict=True)
        return [name for name, is_missing in names if not (is_lost or is_missing)]

    def _stamps(
        self, taken_ns: int, acting: Mapping[str, CameraActing], random: np.random.Generator
    ) -> dict[str, int]:
        jitter_s = self._sensor.stamp_jitter_s * float(random.standard_normal())
        for eye in self._eyes:
            late_s = self._sensor.stamp_offset_s + jitter_s + acting[eye.name].delay_s
            # No device stamps a frame before the one that came earlier.
            stamp_ns = max(eye.newest_stamp_ns + 1, taken_ns + round(1e9 * late_s))
            eye.newest_stamp_ns = stamp_ns
        return {eye.name: eye.newest_stamp_ns for eye in self._eyes}


def camera_groups(
    simulation: Simulation,
    cameras: Mapping[str, Mapping[str, Camera]],
    sensor: Sensor,
    *,
    seed: int,
    pictures: Pictures | None = None,
) -> dict[str, CameraGroup]:
    """Return the groups of `cameras` by name, each with one exposure; they share one `Pictures`.

    `RobotModel.pair_lenses` and `single_lenses` tell what a robot sees with.
    """
    shared = pictures if pictures is not None else Pictures(simulation)
    return {
        name: CameraGroup(simulation, group, sensor, seed=seed, pictures=shared)
        for name, group in cameras.items()
    }


def max_lag(faults: tuple[Fault, ...]) -> int:
    """Return the largest number of frames that one side of a pair may fall behind."""
    lags = sum(abs(round(f.size)) for f in faults if f.name == "out_of_step_frames")
    return min(lags, LARGEST_LAG)


def _is_indoors(simulation: Simulation) -> bool:
    """Tell whether no sun shines, only lamps."""
    model: Any = simulation.model
    directional = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    return model.nlight > 0 and not (model.light_type == directional).any()
