# SPDX-License-Identifier: Apache-2.0
"""What a head's encoders tell of its angles: steps, noise, and the play of the gears."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pilotage.calibration.nao_head import HeadAngles
from pilotage.simulation.options import check_options, ranged

SALT = 53  # keeps these draws apart from those of worlds, cameras and the walk


@dataclass(frozen=True)
class Encoders:
    """How the angles that are told differ from the true ones; the defaults are a Nao's.

    The encoder sits where the gears are driven: while the head is moved it is half the play behind
    what is told, and it stays there until it is moved the other way. InputError when a value lies
    out of its range.
    """

    resolution_rad: float = ranged(2 * math.pi / 4096, 0, 0.1)  # the maker's: 12 bits a turn
    # The maker publishes neither: a third of a step, and 0.2 degrees.
    noise_rad: float = ranged(0.0005, 0, 0.1)  # standard deviation of each reading
    play_rad: float = ranged(0.0035, 0, 0.1)

    def __post_init__(self) -> None:
        check_options(self, "encoders")

    def scaled(self, factor: float) -> Encoders:
        """Return encoders that err so many times as much; 0 makes them exact."""
        return Encoders(*(factor * value for value in dataclasses.astuple(self)))

    def read(self, head: HeadAngles, way: NDArray[np.float64], *, seed: list[int]) -> HeadAngles:
        """Return what is told of the true angles; the same seed gives the same noise.

        `way` (2,) is where yaw and pitch were moved last: 1 or -1, 0 before they first were.
        """
        noise = np.random.default_rng([SALT, *seed]).standard_normal(2)
        told = np.array(head) + 0.5 * self.play_rad * way + self.noise_rad * noise
        if self.resolution_rad > 0:
            told = self.resolution_rad * np.round(told / self.resolution_rad)
        return HeadAngles(*told.tolist())
