# SPDX-License-Identifier: Apache-2.0
"""The table of worlds, and `load_world`."""

from __future__ import annotations

import dataclasses
import importlib
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pilotage.errors import InputError
from pilotage.simulation.options import check_seed, read_options, unknown
from pilotage.simulation.scene import Scene
from pilotage.simulation.world import World

# name -> module, its builder, its options
WORLDS = {
    "yard": ("pilotage.simulation.yard", "build_yard", "YardOptions"),
    "corridor": ("pilotage.simulation.corridor", "build_corridor", "CorridorOptions"),
    "office": ("pilotage.simulation.office", "build_office", "OfficeOptions"),
}


def load_world(
    name: str | Path, *, seed: int = 0, options: Mapping[str, object] | None = None
) -> World:
    """Return the world called `name`, or the one in the MJCF file at that path.

    The same seed and options give the same bytes. Raises InputError naming an unknown world, an
    unknown option, a value out of range, or what MuJoCo finds wrong with the file.
    """
    seed = check_seed(seed)
    if str(name) in WORLDS:
        return _generate(str(name), seed, options or {})
    path = Path(name)
    if path.suffix.lower() not in {".xml", ".mjcf"} and os.sep not in str(name):
        raise InputError(f"world {str(name)!r} {unknown(str(name), WORLDS)}, or give an .xml file")
    if options:
        raise InputError(f"{path}: option {next(iter(options))!r}: an MJCF file takes none")
    return _read(path, seed)


def _generate(name: str, seed: int, options: Mapping[str, object]) -> World:
    module_name, build, options_class = WORLDS[name]
    module = importlib.import_module(module_name)
    used = read_options(getattr(module, options_class), options, name)
    # The world's place in the table sets its draws apart from those of the others.
    scene = Scene(name, np.random.default_rng([list(WORLDS).index(name), seed]))
    getattr(module, build)(scene, used)
    return World(name, seed, scene.text(), options=dataclasses.asdict(used))


def _read(path: Path, seed: int) -> World:
    try:
        mjcf = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{str(path)!r}: cannot be read ({error}); check the path") from error
    world = World(path.stem, seed, mjcf, path=path)
    try:
        world.spec().compile()
    except ValueError as error:
        raise world.fault(error) from error
    return world
