# SPDX-License-Identifier: Apache-2.0
"""A world: MJCF that holds all there is to it, and the notes in it that are ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco

from pilotage.errors import InputError
from pilotage.simulation.scene import START

# What MuJoCo says of a file that the MJCF names -> what to do about it.
REMEDIES = {
    "opening file": "correct the name, or put the file beside the MJCF or into the folder that its "
    "<compiler> names (texturedir, meshdir)",
    "decoding PNG": "give a whole PNG file",
    "unsupported content type": "give a file of a kind it reads, textures as PNG",
}


@dataclass(frozen=True)
class World:
    """A world of ours or of a file; `assets` are files its MJCF names, `path` is that file."""

    name: str
    seed: int
    mjcf: str
    options: Mapping[str, object] = field(default_factory=dict)
    assets: Mapping[str, bytes] = field(default_factory=dict)
    path: Path | None = None

    def spec(self) -> Any:
        """Return a new `mujoco.MjSpec`; InputError passes on what MuJoCo has to say."""
        try:
            if self.path is not None:
                return mujoco.MjSpec.from_file(str(self.path))
            return mujoco.MjSpec.from_string(self.mjcf, assets=dict(self.assets))
        except ValueError as error:
            raise self.fault(error) from error

    def fault(self, error: Exception) -> InputError:
        """Return the error that names this world, MuJoCo's reason and what helps."""
        reason = " ".join(str(error).split())
        remedy = next((help_ for part, help_ in REMEDIES.items() if part in reason), "correct it")
        return InputError(f"{self.path or self.name}: no valid MJCF ({reason}); {remedy}")


def start_of(spec: Any, name: str) -> tuple[float, float, float]:
    """Return x, y (m) and yaw (rad) of the start: the world's note, or the origin."""
    notes = [list(numeric.data) for numeric in spec.numerics if numeric.name == START]
    x_m, y_m, yaw_rad = notes[0] if notes and len(notes[0]) == 3 else (0.0, 0.0, 0.0)
    if notes and len(notes[0]) != 3:
        raise InputError(f"{name}: numeric 'start' must be x, y (m) and yaw (rad)")
    return float(x_m), float(y_m), float(yaw_rad)
