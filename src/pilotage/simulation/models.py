# SPDX-License-Identifier: Apache-2.0
"""The robots there are to simulate: body, cameras with their lens, and what floor they need."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from pilotage import Camera, StereoRig
from pilotage.calibration.nao_head import FIELD_OF_VIEW_DEG
from pilotage.errors import InputError
from pilotage.simulation.body import Body
from pilotage.simulation.options import unknown

if TYPE_CHECKING:
    from pilotage.simulation.physics import Simulation

NARROWEST_PX = 160
SMALL_PATHS = (
    *("closed-6m", "closed-5m", "closed-4m"),
    *("straight-6m", "straight-4m", "straight-2m", "straight-1m"),
)


@dataclass(frozen=True)
class Lens:
    """A camera at its full width (4:3); smaller pictures see the same. `distortion` is Brown's.

    Real cameras are not centred: `off_centre_px` is how far at the full width, another for each.
    """

    width_px: int
    focal_px: float
    distortion: tuple[float, ...]
    off_centre_px: tuple[float, ...]

    def camera(self, width_px: int, number: int) -> Camera:
        """Return the robot's camera of that number; InputError when the width is none of 4:3."""
        if not NARROWEST_PX <= width_px <= self.width_px or width_px % 16:
            raise InputError(
                f"width {width_px} px: must be a multiple of 16 from {NARROWEST_PX} to "
                f"{self.width_px}"
            )
        share, height_px = width_px / self.width_px, width_px * 3 // 4
        shift_px = self.off_centre_px[number % len(self.off_centre_px)] * share
        return Camera(
            width_px=width_px,
            height_px=height_px,
            fx_px=self.focal_px * share,
            fy_px=self.focal_px * share,
            cx_px=(width_px - 1) / 2 + shift_px,
            cy_px=(height_px - 1) / 2 - shift_px,
            distortion="brown",
            coefficients=list(self.distortion),
        )


@dataclass(frozen=True)
class RobotModel:
    """A robot by `name`. `pairs` are its stereo pairs (left, right), `singles` its other cameras.

    It needs `radius_m` of free floor around its path. Where no path is named, it takes the first
    of `paths` that fits into the world. `body` is `module:Class`.
    """

    name: str
    body: str
    lens: Lens
    radius_m: float
    speed_m_s: float
    paths: tuple[str, ...]
    pairs: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    singles: tuple[str, ...] = ()

    def make_body(self, **settings: Any) -> Body:
        """Return a new body; `settings` are its class's own, `encoders` say."""
        module, _, kind = self.body.partition(":")
        return cast(Body, getattr(importlib.import_module(module), kind)(**settings))

    def stereo_rig(
        self, simulation: Simulation, pair: str, width_px: int, readout_s: float = 0.0
    ) -> StereoRig:
        """Return the pair of that name at that width, placed as on the simulation's body.

        `readout_s` is that of its sensors.
        """
        left, right = self.pairs[pair]
        robot_from_world = simulation.robot_pose().inverse()
        world_from_left = simulation.camera_pose(left)
        return StereoRig(
            left=self.lens.camera(width_px, 0),
            right=self.lens.camera(width_px, 1),
            right_from_left=simulation.camera_pose(right).inverse() @ world_from_left,
            robot_from_left=robot_from_world @ world_from_left,
            readout_s=readout_s,
        )

    def stereo_rigs(
        self,
        simulation: Simulation,
        width_px: int,
        pairs: Sequence[str] | None = None,
        readout_s: float = 0.0,
    ) -> dict[str, StereoRig]:
        """Return the rigs of `pairs` by name, by default of all; see `stereo_rig`."""
        names = self.pairs if pairs is None else pairs
        return {name: self.stereo_rig(simulation, name, width_px, readout_s) for name in names}

    def pair_lenses(self, rigs: Mapping[str, StereoRig]) -> dict[str, dict[str, Camera]]:
        """Return the cameras of each pair of `rigs`, which fire together, by name."""
        return {
            pair: dict(zip(self.pairs[pair], (rig.left, rig.right), strict=True))
            for pair, rig in rigs.items()
        }

    def single_lenses(self, width_px: int) -> dict[str, dict[str, Camera]]:
        """Return each single camera, which fires by itself, by name."""
        return {
            name: {name: self.lens.camera(width_px, number)}
            for number, name in enumerate(self.singles)
        }

    def chosen_pairs(self, names: str | None) -> tuple[str, ...]:
        """Return the pairs of a list such as `front,down`, all without one; InputError else."""
        if names is None:
            return tuple(self.pairs)
        chosen = tuple(dict.fromkeys(word for word in names.replace(",", " ").split()))
        for name in chosen or ("",):
            if name not in self.pairs:
                raise InputError(f"pair {name!r} {unknown(name, self.pairs)}")
        return chosen


_MODELS = (
    RobotModel(
        name="rover",
        body="pilotage.simulation.rover:Rover",
        # The rover paper's camera.
        lens=Lens(1280, 855.0, (-0.12, 0.03, 0.0003, -0.0002, 0.0), (3.0, -4.0)),
        pairs={
            "front": ("front_left", "front_right"),
            "down": ("down_left", "down_right"),
        },
        radius_m=0.4,
        speed_m_s=0.4,
        paths=("closed-10m", *SMALL_PATHS),
    ),
    RobotModel(
        name="nao",
        body="pilotage.simulation.nao:Nao",
        lens=Lens(
            1280,
            640 / math.tan(math.radians(FIELD_OF_VIEW_DEG[0]) / 2),
            (-0.03, 0.05, 0.0003, -0.0002, 0.0),
            (5.0, -4.0),
        ),
        singles=("top", "bottom"),
        radius_m=0.25,
        speed_m_s=0.095,
        paths=SMALL_PATHS,
    ),
)
ROBOTS = {model.name: model for model in _MODELS}


def robot_model(name: str) -> RobotModel:
    """Return the robot of that name; InputError lists those there are."""
    if name not in ROBOTS:
        raise InputError(f"robot {name!r} {unknown(name, ROBOTS)}")
    return ROBOTS[name]
