# SPDX-License-Identifier: Apache-2.0
"""Models in COLMAP's folders, so that its viewer and what reads its models open ours, and back.

Each of the three files is whole whatever happens; after a kill some may be of an older model.
Rigs and frames, which newer versions write as well, are neither written nor read: each picture
has a pose of its own. Lenses: those of docs/conventions.md; see `colmap_tables.CAMERA_MODELS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pilotage.atomic_files import write_atomically
from pilotage.errors import InputError, RunError
from pilotage.models import colmap_binary, colmap_text
from pilotage.models.colmap_tables import Tables, model_of, tables_of
from pilotage.models.model import Model


def write_colmap_text(folder: Path, model: Model) -> None:
    """Write cameras.txt, images.txt and points3D.txt into `folder`, which is made.

    InputError for what COLMAP cannot hold, RunError when a file cannot be written.
    """
    _write(folder, colmap_text.contents(tables_of(model)))


def write_colmap_binary(folder: Path, model: Model) -> None:
    """Write cameras.bin, images.bin and points3D.bin into `folder`, which is made; errors alike."""
    _write(folder, colmap_binary.contents(tables_of(model)))


def read_colmap_text(folder: Path) -> Model:
    """Read what COLMAP or `write_colmap_text` wrote; InputError names the file and what fails."""
    return _model(folder, colmap_text.read(folder))


def read_colmap_binary(folder: Path) -> Model:
    """Read what COLMAP or `write_colmap_binary` wrote; InputError names the file."""
    return _model(folder, colmap_binary.read(folder))


def _model(folder: Path, tables: Tables) -> Model:
    try:
        return model_of(tables)
    except (InputError, ValueError) as error:
        raise InputError(f"{folder}: {error}") from error


def _write(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"cannot make {folder}: {error.strerror or error}") from error
    for name, content in contents.items():
        write_atomically(folder / name, content)
