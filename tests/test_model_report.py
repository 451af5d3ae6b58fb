# SPDX-License-Identifier: Apache-2.0
"""A model's folder and its report: what is drawn, where it is looked at from, what is told."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_models import a_model, bare
from typer.testing import CliRunner

from pilotage import PictureFate, Transform
from pilotage.behaviors import model_folder
from pilotage.behaviors.model_folder import picture_times, verdict
from pilotage.behaviors.reconstruct import Reconstructed
from pilotage.cli.drawing import draw_report as draw_alone
from pilotage.cli.main import app
from pilotage.errors import InputError
from pilotage.evaluation.level import level_from_world, limits_of
from pilotage.evaluation.model_report import draw_report
from pilotage.evaluation.track_pictures import spread
from pilotage.evaluation.verdict import missing_lines
from pilotage.models import Model, write_colmap_binary
from pilotage.results import COLMAP_BINARY, write_json


def write_pictures(folder: Path, names: tuple[str, ...]) -> Path:
    random = np.random.default_rng(2)
    folder.mkdir()
    for name in names:
        small = random.integers(0, 256, (48, 64, 3), np.uint8)
        cv2.imwrite(str(folder / name), cv2.resize(small, (640, 480)))
    return folder


def summary_of(model: Model, source: Path, **known: Any) -> dict[str, Any]:
    return {
        "program": "pilotage", "version": "1", "commit": None, "state": "done",
        "source": str(source), "verdict": "whole", "pictures": len(model.names),
        "posed": len(model.names), "without_pose": {}, "points": len(model.points_in_world),
        "observations": len(model.picture), "rms_px": 0.3, "features": 900, "matched_pairs": 10,
        "tracks": 61, "unit": "unknown", "ordered": True, "wall_s": 1.5, "cpu_s": 2.5, **known,
    }  # fmt: skip


def write_folder(out: Path, model: Model, summary: dict[str, Any]) -> str:
    out.mkdir()
    if model.names:
        write_colmap_binary(out / COLMAP_BINARY, model)
    write_json(out / "summary.json", summary)
    draw_report(out)
    return (out / "report.html").read_text()


def test_report_shows_the_model_and_its_pictures(tmp_path: Path) -> None:
    model = a_model()
    source = write_pictures(tmp_path / "walk", model.names)
    page = write_folder(tmp_path / "out", model, summary_of(model, source))
    assert "5 of 5 pictures placed, 60 points, residuals 0.30 px rms, 1.5 s" in page
    assert page.count("<figcaption") == 5
    dots = sum(len(re.findall(r"h0", path)) for path in re.findall(r"<path d='(M[^']*h0)'", page))
    assert dots == 2 * len(model.picture)  # each on its rim
    assert re.search(r"<path d='M[\d.]+ [\d.]+L[\d.]+ [\d.]+", page)
    assert re.search(r"0\.jpg: \d+ points, lines to [23]\.jpg", page)  # of the same camera
    assert "Pictures without a pose" not in page
    # Nothing is fetched: what is linked lies in the page itself.
    links = re.findall(r"(?:href|src)=['\"]([^'\"]*)", page)
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)


def test_report_names_what_is_missing_and_why(tmp_path: Path) -> None:
    model = a_model()
    source = write_pictures(tmp_path / "walk", model.names)
    missing = {"7.jpg": "shows <nothing>", "9.jpg": "shows <nothing>", "8.jpg": "is dark"}
    known = summary_of(
        model, source, pictures=8, without_pose=missing, verdict="partial: 5 of 8 pictures"
    )
    page = write_folder(tmp_path / "out", model, known)
    assert "5 of 8 pictures placed" in page
    assert "<li>7.jpg, 9.jpg: shows &lt;nothing&gt;</li><li>8.jpg: is dark</li>" in page
    assert "verdict bad" in page
    many = missing_lines({f"{i}.jpg": "is dark" for i in range(20)})
    assert many == [", ".join(f"{i}.jpg" for i in range(12)) + " and 8 more: is dark"]


def test_report_says_why_a_model_is_not_to_be_believed(tmp_path: Path) -> None:
    model = a_model()
    source = write_pictures(tmp_path / "pictures", model.names)
    verdict_ = "unsure: the focal length comes out +40 % off the nominal one"
    known = {"verdict": verdict_, "lens_fault": "the pictures are bent", "length_fault": "no mark"}
    page = write_folder(tmp_path / "out", model, summary_of(model, source, **known))
    assert "The pictures are bent." in page
    assert "No mark." in page
    assert "Unsure: the focal length comes out +40 % off the nominal one." in page


def test_report_is_drawn_without_pictures_points_or_poses(tmp_path: Path) -> None:
    model = a_model()
    page = write_folder(tmp_path / "gone", model, summary_of(model, tmp_path / "nowhere"))
    assert "The pictures are no longer in" in page
    page = write_folder(tmp_path / "bare", bare(model), summary_of(bare(model), tmp_path))
    assert "Points and cameras" in page
    known = summary_of(model, tmp_path, posed=0, points=0, observations=0, rms_px=None)
    known |= {"verdict": "is dark", "without_pose": dict.fromkeys(model.names, "is dark")}
    none = replace(bare(model), names=(), camera_index=np.zeros(0, int), camera_from_world=())
    page = write_folder(tmp_path / "none", none, known)
    assert "No model: is dark" in page


def test_folder_without_a_finished_model_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a results folder"):
        draw_report(tmp_path)
    write_json(tmp_path / "summary.json", {"program": "pilotage", "state": "running"})
    with pytest.raises(InputError, match="no finished model"):
        draw_report(tmp_path)
    said = draw_alone("pilotage.evaluation.model_report", tmp_path)
    assert said is not None
    assert "no finished model" in said


def walk(looks_across: bool, count: int = 20) -> np.ndarray:
    """Return poses of a level walk along x, z up, looking ahead or to its left, head nodding."""
    random = np.random.default_rng(4)
    ahead = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    turn = Rotation.from_euler("z", 90 if looks_across else 0, degrees=True)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i in range(count):
        nod = Rotation.from_rotvec(random.normal(0, 0.03, 3))
        poses[i, :3, :3] = (turn * ahead * nod).as_matrix()
        poses[i, :3, 3] = (0.2 * i, 0.02 * np.sin(i), 0.01 * np.cos(i))
    return poses


@pytest.mark.parametrize("looks_across", [False, True])
def test_model_is_set_upright(looks_across: bool) -> None:
    poses = walk(looks_across)
    random = np.random.default_rng(8)
    for _ in range(5):
        turned = np.eye(4)
        turned[:3, :3] = Rotation.random(random_state=int(random.integers(1000))).as_matrix()
        level = level_from_world(turned @ poses)
        np.testing.assert_allclose(level @ level.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(level) == pytest.approx(1)
        # x along the walk, z up, whatever the world of the model is.
        np.testing.assert_allclose(level @ turned[:3, :3], np.eye(3), atol=0.04)
        backward = level_from_world((turned @ poses)[::-1])
        sign = 1 if looks_across else -1  # across: as the pictures show it; else as it was walked
        np.testing.assert_allclose(backward[0], sign * level[0], atol=1e-9)


def test_cameras_in_one_place_are_looked_at_along_their_view() -> None:
    poses = walk(looks_across=True)
    poses[:, :3, 3] = 3.0
    np.testing.assert_allclose(level_from_world(poses)[0], (0, 1, 0), atol=0.04)
    down = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (3, 1, 1))
    assert np.isfinite(level_from_world(down)).all()
    assert np.isfinite(level_from_world(poses[:1])).all()


def test_limits_hold_all_cameras_and_leave_out_what_is_far() -> None:
    points = np.random.default_rng(1).uniform(-1, 1, (1000, 3))
    points[:20] = 500
    low, high = limits_of(points, np.array([[0.0, -4.0, 0.0], [0.0, 0.0, 0.0]]))
    assert (high < 2.2).all()
    assert (high > 1).all()
    assert low[1] < -4
    assert np.isfinite(limits_of(points[:0], np.zeros((1, 3)))).all()


def test_pictures_are_spread_over_the_walk() -> None:
    counts = np.ones(39)
    assert spread(list(range(39)), counts) == [0, 7, 14, 21, 27, 33]
    counts[[3, 20, 38]] = 9  # of each stretch the picture that shows most
    assert spread(list(range(39)), counts) == [3, 7, 20, 21, 27, 38]
    assert spread([3, 5], counts) == [3, 5]
    assert spread([], counts) == []


def test_times_are_those_of_names_or_places() -> None:
    def times(*names: str) -> list[int]:
        return list(picture_times([Path(name) for name in names]).values())

    second = 1_000_000_000
    assert times("a.png", "b.png", "c.png") == [0, second, 2 * second]
    assert times("1403636579.5.png", "1403636580.25.png")[0] == 1403636579_500000000
    assert times("1403636579763555584.png") == [1403636579763555584]
    assert times("1403636579.5.png", "b.png") == [0, second]
    assert times("1403636579.5.png", "1403636579.50.png") == [0, second]


def reconstructed(
    model: Model, *, missing: Sequence[str] = ("9.jpg",), bent: Sequence[int] = ()
) -> Reconstructed:
    """Return what a reconstruction gives that placed all pictures but the `missing` ones."""
    fates = [PictureFate.posed] * len(model.names) + [PictureFate.few_features] * len(missing)
    result: Any = SimpleNamespace(
        rms_px=0.3,
        feature_count=9,
        pair_count=8,
        track_count=61,
        focal_px=400.0,
        focal_sigma_px=0.0,
        bent_pictures=list(bent),
        fates=fates,
    )
    names = (*model.names, *missing)
    return Reconstructed(
        model=model,
        names=names,
        fates=tuple(fates),
        result=result,
        given_focal_px=400.0,
        focal_sigma=0.0,
    )


def test_a_model_whose_shape_pictures_contradict_is_never_whole() -> None:
    model = a_model()
    assert verdict(reconstructed(model, missing=())) == "whole"
    found = reconstructed(model, missing=(), bent=[0, 1, 2])
    assert not found.is_whole
    said = verdict(found)
    assert said.startswith(f"unsure: 3 of {len(model.names)} pictures ({model.names[0]} to")
    assert "shape is wrong" in said


def test_verb_leaves_a_folder_that_a_report_can_be_drawn_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = a_model()
    source = write_pictures(tmp_path / "walk", (*model.names, "9.jpg"))
    monkeypatch.setattr(model_folder, "solve", lambda *_, **__: reconstructed(model))
    said: list[str | None] = [None]
    monkeypatch.setattr("pilotage.cli.reconstruct.draw_report", lambda *_: said[0])
    out = tmp_path / "out"
    words = ["reconstruct", str(source), "--fov-deg", "60", "-o", str(out), "--overwrite"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "9.jpg: shows hardly any detail" in done.output
    lines = (out / "trajectory_tum.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines] == [f"{i}.000000000" for i in range(5)]
    assert json.loads((out / "summary.json").read_text())["ordered"] is True
    draw_report(out)
    assert "5 of 6 pictures placed" in (out / "report.html").read_text()
    said[0] = "no space"
    failed = CliRunner().invoke(app, words)
    assert failed.exit_code == 1
    assert "report not drawn: no space" in failed.output
    assert not (out / "report.html").exists()  # that of the earlier model is gone
    assert CliRunner().invoke(app, [*words, "--no-report"]).exit_code == 0


def test_colours_are_those_of_the_pixels_in_the_file(tmp_path: Path) -> None:
    model = a_model()
    colour = np.full((480, 640, 3), (10, 200, 90), np.uint8)
    cv2.imwrite(str(tmp_path / "0.png"), colour)
    one = replace(
        model, names=("0.png",), camera_index=np.zeros(1, int), point=np.array([4]),
        camera_from_world=(Transform(),), picture=np.array([0]), pixel_px=np.array([[3.0, 5.0]]),
    )  # fmt: skip
    painted = model_folder.coloured(one, {"0.png": tmp_path / "0.png"})
    assert painted.colors[4].tolist() == [90, 200, 10]
    np.testing.assert_array_equal(painted.colors[5:], model.colors[5:])
