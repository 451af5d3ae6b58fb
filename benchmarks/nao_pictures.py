# SPDX-License-Identifier: Apache-2.0
"""Pictures of real Naos without a calibration: what becomes a model, stretch by stretch.

    python benchmarks/nao_pictures.py [--sets nao_walk nao_marks] [--first 0] [--count 400]

`nao_walk`: a Nao wanders through a canteen, a picture in 2.5 s; beside each the robot's own
odometry, which drifts and slips, so that it tells plausibility and no accuracy. `nao_marks`: five
standpoints on a football field with the places of a motion capture. Both lie in $PILOTAGE_DATA.

The focal length begins at the nominal field of view and is looked for. What is left of a set after
a model is reconstructed again, until nothing comes. A stretch is a run of consecutive pictures in
one model; its places are laid onto the odometry by a similarity. Where no model is, the row says
why, and what the odometry says of the way.
"""

from __future__ import annotations

import argparse
import ast
import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from decoded import DATA_FOLDER
from scipy.spatial.transform import Rotation
from tables import markdown_table, number

from pilotage import Camera, PictureFate, ReconstructionConfig
from pilotage.behaviors.reconstruct import (
    NOMINAL_FOCAL_SIGMA,
    Reconstructed,
    focal_fault,
    solve,
)
from pilotage.calibration.one_camera import camera_of_view
from pilotage.evaluation.camera_poses import pose_errors
from pilotage.recordings.pictures import read_grey

Array = npt.NDArray[Any]
# Horizontal field of view of the upper camera by its maker: Nao V4 (2013), V6 (2024).
FOV_DEG = {"nao_walk": 60.9, "nao_marks": 56.3}
# A model of fewer pictures is not counted: two or three views of a room fit many motions.
FEWEST = 4
# Shorter stretches have no error left once a similarity has laid them onto something.
FEWEST_COMPARED = 4
TURN_DEG, STEP_M = 10.0, 0.05  # a step that turns more and moves less is a turn on the spot


@dataclass(frozen=True)
class Walk:
    """Pictures in the order they were taken, and what else is known of the robot there."""

    name: str
    files: tuple[Path, ...]
    world_from_robot: Array  # (N, 4, 4), metres
    is_ordered: bool


@dataclass(frozen=True)
class Found:
    """A model of some of the pictures, by their places in the walk."""

    pictures: tuple[int, ...]  # all that were given to it
    result: Reconstructed

    def posed(self) -> list[int]:
        """Return the pictures with a pose."""
        by_name = {str(i): i for i in self.pictures}
        return sorted(by_name[name] for name in self.result.model.names)

    def poses(self, count: int) -> Array:
        """Return (count, 4, 4) `world_from_camera`, NaN where there is none."""
        poses = np.full((count, 4, 4), np.nan)
        found = self.result.model.world_from_camera()
        for name, pose in zip(self.result.model.names, found, strict=True):
            poses[int(name)] = pose
        return poses

    def focal_px(self) -> tuple[float, float]:
        """Return focal length and standard error, pixels."""
        return self.result.result.focal_px, self.result.result.focal_sigma_px


def read_walk(folder: Path) -> Walk:
    """Return the wandering Nao with its odometry; files are numbered, their numbers not padded."""
    files = sorted(folder.glob("*.jpg"), key=lambda file: int(file.stem.split("-")[-1]))
    poses = np.tile(np.eye(4), (len(files), 1, 1))
    for pose, file in zip(poses, files, strict=True):
        # A JSON list with one string, which is a Python dictionary.
        position = ast.literal_eval(json.loads(_plain(file))[0])["position"]
        pose[:3, 3] = position[:3]
        pose[:3, :3] = Rotation.from_euler("xyz", position[3:]).as_matrix()
    return Walk(folder.name, tuple(files), poses, is_ordered=True)


def _plain(picture: Path) -> str:
    text = picture.with_suffix(".json").read_text(encoding="utf-8")
    # Some are written with the quotes of Python.
    return json.dumps(ast.literal_eval(text))


def read_marks(folder: Path) -> Walk:
    """Return the upper camera's pictures at the standpoints, and where motion capture saw each."""
    files = tuple(sorted(folder.glob("point*/imagetop.jpg")))
    poses = np.tile(np.eye(4), (len(files), 1, 1))
    for pose, file in zip(poses, files, strict=True):
        rows = np.genfromtxt(
            file.with_name("optitrack.csv"), delimiter=",", skip_header=7, usecols=(5, 6, 7)
        )
        pose[:3, 3] = np.nanmedian(rows, axis=0)
        pose[:3, :3] = np.nan  # axes of the rigid body: whatever they were
    return Walk(folder.name, files, poses, is_ordered=False)


READERS = {"nao_walk": read_walk, "nao_marks": read_marks}


def reconstruct_all(walk: Walk, chosen: Sequence[int], fov_deg: float) -> list[Found]:
    """Return models of the chosen pictures, each of what the one before left; last what failed."""
    config = ReconstructionConfig.from_dict({"focal_sigma": NOMINAL_FOCAL_SIGMA})
    greys = {i: read_grey(walk.files[i]) for i in chosen}
    left, found = list(chosen), []
    while True:
        first = greys[left[0]]
        camera: Camera = camera_of_view((first.shape[1], first.shape[0]), fov_deg)
        start = time.perf_counter()
        names = [str(i) for i in left]
        result = solve(
            [greys[i] for i in left], names, camera=camera, ordered=walk.is_ordered, config=config
        )
        found.append(Found(tuple(left), result))
        posed = set(found[-1].posed())
        print(
            f"{len(posed)} of {len(left)} pictures in a model, {time.perf_counter() - start:.1f} s",
            flush=True,
        )
        left = [i for i in left if i not in posed]
        if len(posed) < FEWEST or len(left) < FEWEST:
            return found


def way(walk: Walk, first: int, last: int) -> tuple[float, int, int]:
    """Return length of the robot's own way, metres, its steps, and those that are turns alone."""
    poses = walk.world_from_robot[first : last + 1]
    steps_m = np.linalg.norm(np.diff(poses[:, :2, 3], axis=0), axis=1)
    turns = np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3]
    turns_deg = np.degrees(np.linalg.norm(Rotation.from_matrix(turns).as_rotvec(), axis=1))
    on_the_spot = (turns_deg > TURN_DEG) & (steps_m < STEP_M)
    return float(steps_m.sum()), len(steps_m), int(on_the_spot.sum())


def compared(walk: Walk, found: Found, pictures: Sequence[int]) -> dict[str, str]:
    """Return the columns that hold a model's places against the robot's, for some pictures."""
    known = walk.world_from_robot.copy()
    known[:, :3, :3] = np.eye(3)  # places alone; the head is not where the body is
    chosen = list(pictures)
    errors = None
    if len(chosen) >= FEWEST_COMPARED:
        estimate = found.poses(len(walk.files))[chosen]
        errors = pose_errors(estimate=estimate, truth=known[chosen])
    if errors is None:
        return {"ATE m": "", "ATE %": ""}
    return {"ATE m": number(errors.ate_rmse_m), "ATE %": number(errors.ate_percent_of_length)}


def model_rows(walk: Walk, found: Sequence[Found]) -> list[dict[str, str]]:
    """Return a row for each model."""
    rows = []
    for k, one in enumerate(found):
        posed = one.posed()
        if len(posed) < FEWEST:
            continue
        focal, sigma = one.focal_px()
        model = one.result.model
        width = one.result.camera.width_px
        rows.append({
            "model": chr(ord("A") + k), "pictures": str(len(posed)),
            "first..last": f"{posed[0]}..{posed[-1]}", "points": str(len(model.points_in_world)),
            "rms px": number(one.result.result.rms_px),
            "focal px": f"{focal:.0f} ± {sigma:.0f}",
            "field of view deg": f"{np.degrees(2 * np.arctan(0.5 * width / focal)):.1f}",
            **compared(walk, one, posed),
            "focal length believed": "no" if focal_fault(one.result) else "yes",
        })  # fmt: skip
    return rows


def stretch_rows(walk: Walk, found: Sequence[Found], chosen: Sequence[int]) -> list[dict[str, str]]:
    """Return a row for each stretch of the walk, with its model or the reason for none."""
    of_picture = {i: k for k, one in enumerate(found) for i in one.posed() if _counts(one)}
    last = found[-1]
    fates = dict(zip(last.pictures, last.result.result.fates_if_unposed, strict=True))
    labels = {i: of_picture.get(i, -1) for i in chosen}
    rows, begin = [], 0
    for end in range(1, len(chosen) + 1):
        if end < len(chosen) and labels[chosen[end]] == labels[chosen[begin]]:
            continue
        run = chosen[begin:end]
        rows.append(_stretch_row(walk, found, run, labels[run[0]], fates))
        begin = end
    return rows


def _counts(found: Found) -> bool:
    return len(found.posed()) >= FEWEST


def _stretch_row(
    walk: Walk,
    found: Sequence[Found],
    run: Sequence[int],
    label: int,
    fates: dict[int, PictureFate],
) -> dict[str, str]:
    row = {
        "stretch": f"{run[0]}..{run[-1]}", "pictures": str(len(run)),
        "model": "" if label < 0 else chr(ord("A") + label),
    }  # fmt: skip
    if walk.is_ordered:
        length_m, steps, turns = way(walk, run[0], run[-1])
        row["odometry m"] = f"{length_m:.2f}"
        row["turns on the spot"] = f"{turns} of {steps}"
    if label >= 0:
        return row | compared(walk, found[label], run) | {"reason": ""}
    counts = Counter(fates[i].name for i in run)
    reason = ", ".join(f"{name} {count}" for name, count in counts.most_common())
    return row | {"ATE m": "", "ATE %": "", "reason": reason}


def show(rows: list[dict[str, str]]) -> None:
    """Print rows as a table."""
    if not rows:
        print("none\n")
        return
    print(markdown_table(list(rows[0]), [list(row.values()) for row in rows]) + "\n")


def main() -> int:
    """Read the command line, run the sets that are there, print both tables of each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--sets", nargs="+", choices=list(READERS), default=list(READERS))
    parser.add_argument("--data", type=Path, default=DATA_FOLDER)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    arguments = parser.parse_args()
    for name in arguments.sets:
        folder = arguments.data / name
        if not folder.is_dir():
            print(f"{name}: skipped, not in {arguments.data}; set PILOTAGE_DATA")
            continue
        walk = READERS[name](folder)
        chosen = range(len(walk.files))[arguments.first : arguments.first + arguments.count]
        print(f"{name}: pictures {chosen[0]} to {chosen[-1]}")
        found = reconstruct_all(walk, chosen, FOV_DEG[name])
        print("\nModels")
        show(model_rows(walk, found))
        print("Stretches")
        show(stretch_rows(walk, found, chosen))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
