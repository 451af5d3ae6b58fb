# SPDX-License-Identifier: Apache-2.0
"""Recordings that the tests make themselves, and the optional real ones."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from synthetic import SyntheticRecording, make_recording


@pytest.fixture(scope="session")
def synthetic_kitti(tmp_path_factory: pytest.TempPathFactory) -> SyntheticRecording:
    """20 rectified pairs along a street, 480x240, KITTI layout."""
    return make_recording(tmp_path_factory.mktemp("synthetic_kitti"), layout="kitti")


@pytest.fixture(scope="session")
def synthetic_euroc(tmp_path_factory: pytest.TempPathFactory) -> SyntheticRecording:
    """12 pairs of a rig with a lens and a turned right camera, EuRoC layout."""
    return make_recording(tmp_path_factory.mktemp("synthetic_euroc"), layout="euroc", frames=12)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real recordings: $PILOTAGE_DATA, or shared/data beside the repository."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("PILOTAGE_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set PILOTAGE_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def yard_pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive of 3 m round a yard, a pair that looks ahead and one that looks down."""
    out = tmp_path_factory.mktemp("pairs") / "yard"
    drive = ["--path", "closed-3m", "--width", "240", "--rate-hz", "5", "--seed", "3"]
    return _made(out, "simulate", "yard", "-o", str(out), "--ground", "grass", *drive)


@pytest.fixture(scope="session")
def joined_pairs(yard_pairs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of both pairs of that drive, set against truth, with a report."""
    out = tmp_path_factory.mktemp("joined") / "out"
    return _made(out, "localize", str(yard_pairs), "-o", str(out))


def _made(out: Path, *arguments: str) -> Path:
    from typer.testing import CliRunner

    from pilotage.cli.main import app

    done = CliRunner().invoke(app, list(arguments))
    assert done.exit_code == 0, done.output
    return out
