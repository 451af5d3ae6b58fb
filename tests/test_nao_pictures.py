# SPDX-License-Identifier: Apache-2.0
"""The benchmark of real Naos' pictures, on rendered ones laid out like them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from rendering import room
from test_benchmarks import BENCHMARKS, run_benchmark
from test_other_cameras import photograph
from test_reconstruct import pose

sys.path.insert(0, str(BENCHMARKS))

from nao_pictures import read_walk, way


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk past things, then a white wall, numbered without zeros before."""
    folder = tmp_path_factory.mktemp("data") / "nao_walk"
    folder.mkdir()
    steps = np.linspace(-1, 1, 10)
    poses = np.array([pose(0.5 * t * t, -1.2 * t, 25 * t) for t in steps])
    pictures = photograph(room(3.0, np.random.default_rng(3)), poses)
    pictures += [np.full_like(pictures[0], 200)] * 2
    places = [*poses[:, :3, 3].tolist(), [0.5, 1.2, 0.0], [0.5, 1.2, 0.0]]
    for i, (picture, place) in enumerate(zip(pictures, places, strict=True)):
        cv2.imwrite(str(folder / f"day-{i}.jpg"), picture)
        turn = [0.0, 0.0, 0.5 if i == len(places) - 1 else 0.0]
        told = json.dumps({"timestamp": "1", "position": [*place, *turn]})
        (folder / f"day-{i}.json").write_text(repr([told]))
    return folder.parent


def test_numbers_without_zeros_are_in_order_and_odometry_is_read(data: Path):
    walk = read_walk(data / "nao_walk")
    assert [int(file.stem.split("-")[1]) for file in walk.files] == list(range(12))
    length_m, steps, turns = way(walk, 10, 11)
    assert (round(length_m, 3), steps, turns) == (0.0, 1, 1)


def test_stretches_have_a_model_or_a_reason(data: Path):
    done = run_benchmark("nao_pictures.py", "--data", data, "--sets", "nao_walk", "nao_marks")
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    model = next(row for row in cells if row[0] == "A")
    assert model[1] == "10"
    assert float(model[model.index("0..9") + 5]) < 90  # degrees
    stretch = next(row for row in cells if row[0] == "0..9")
    assert stretch[2] == "A"
    wall = next(row for row in cells if row[0] == "10..11")
    assert "few_features 2" in wall
    assert "nao_marks: skipped" in done.stdout
