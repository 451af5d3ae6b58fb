# SPDX-License-Identifier: Apache-2.0
"""The rendered picture set: a simulated Nao walks through an office towards a seated person.

Made once, in a minute or two, and kept: pictures of its top camera, taken as it walks and sways,
and their exact poses. The same numbers below give the same bytes.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from pilotage import Camera
from pilotage.atomic_files import write_atomically
from pilotage.behaviors.stop_and_go import AHEAD, StopPlan, record_stops
from pilotage.errors import RunError
from pilotage.recordings import SinglePicture, open_pictures
from pilotage.simulation import (
    Drive,
    FreeFloor,
    Simulation,
    load_world,
    read_sensor,
    robot_model,
)

Array = npt.NDArray[Any]
NAME = "office_walk"
FILE = "walk.json"  # written last: a folder that has it is whole
CAMERA = "top"


@dataclass(frozen=True)
class WalkPlan:
    """All the set follows from."""

    pictures: int = 39
    seed: int = 14
    person: str = "sit"
    path: str = "straight-2.5m"
    walking_hz: float = 1.5
    width_px: int = 640
    sensor: str = "good"


def made_once(cache: Path, plan: WalkPlan | None = None) -> tuple[tuple[Path, ...], Camera, Array]:
    """Return pictures, camera and `world_from_camera` (N, 4, 4); renders where there are none."""
    plan = plan or WalkPlan()
    folder = cache / NAME
    kept = _read(folder)
    if kept is None or kept["plan"] != asdict(plan):
        print(f"rendering {plan.pictures} pictures into {folder}", file=sys.stderr, flush=True)
        _make(folder, plan)
        kept = _read(folder)
    if kept is None:
        raise RunError(f"{folder}: nothing was rendered")
    pictures = tuple(folder / name for name in kept["pictures"])
    return pictures, Camera(**kept["camera"]), np.array(kept["world_from_camera"])


def _read(folder: Path) -> dict[str, Any] | None:
    file = folder / FILE
    if not file.is_file():
        return None
    kept: dict[str, Any] = json.loads(file.read_text())
    return kept


def _make(folder: Path, plan: WalkPlan) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="pilotage-walk-") as scratch:
        recording = Path(scratch) / "walk.mcap"
        _record(recording, plan)
        kept = _export(recording, folder, plan)
    write_atomically(folder / FILE, json.dumps(kept))


def _record(out: Path, plan: WalkPlan) -> None:
    model = robot_model("nao")
    world = load_world("office", seed=plan.seed, options={"person": plan.person})
    FreeFloor(world, model.radius_m).check(plan.path)
    simulation = Simulation(world, "nao", seed=plan.seed)
    record_stops(
        simulation=simulation,
        robot=model,
        drive=Drive(simulation, plan.path, speed_m_s=model.speed_m_s),
        out=out,
        width_px=plan.width_px,
        # No stop on the way.
        plan=StopPlan(steps=10_000, looks=(AHEAD,), walking_hz=plan.walking_hz),
        sensor=read_sensor(plan.sensor),
        on_moment=lambda _: None,
    )


def _export(recording: Path, folder: Path, plan: WalkPlan) -> dict[str, Any]:
    walk = open_pictures(recording)
    truth = walk.truth(CAMERA)
    if truth is None:
        raise RunError(f"{recording}: holds no truth")
    true_ns = dict(zip(truth.timestamps_ns.tolist(), truth.poses, strict=True))
    names, poses = [], []
    for seen in walk.pictures():
        if not isinstance(seen, SinglePicture) or seen.camera != CAMERA:
            continue
        if len(names) == plan.pictures:
            break
        names.append(f"{len(names):03d}.png")
        poses.append(true_ns[seen.timestamp_ns].tolist())
        write_atomically(folder / names[-1], cv2.imencode(".png", seen.picture)[1].tobytes())
    if len(names) < plan.pictures:
        raise RunError(f"only {len(names)} of {plan.pictures} pictures were taken on the way")
    return {
        "plan": asdict(plan),
        "pictures": names,
        "camera": _camera(walk.cameras[CAMERA]),
        "world_from_camera": poses,
    }


def _camera(camera: Camera) -> dict[str, Any]:
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "fx_px": camera.fx_px,
        "fy_px": camera.fy_px,
        "cx_px": camera.cx_px,
        "cy_px": camera.cy_px,
        "distortion": camera.distortion,
        "coefficients": list(camera.coefficients),
    }
