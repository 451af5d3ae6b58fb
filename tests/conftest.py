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
