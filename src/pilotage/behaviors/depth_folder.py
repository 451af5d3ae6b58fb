# SPDX-License-Identifier: Apache-2.0
"""Two pictures in, a folder with their depths out: what `pilotage depth` does."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotage import __version__
from pilotage.atomic_files import write_atomically, write_each
from pilotage.behaviors.depth import Depth, check_baseline, measure_depth
from pilotage.behaviors.depth_picture import depth_picture
from pilotage.behaviors.model_folder import camera_of, read_first
from pilotage.behaviors.obstacles import Obstacle, distance_at, find_ground, find_obstacles
from pilotage.behaviors.reconstruct import read_greys
from pilotage.errors import InputError
from pilotage.provenance import program_commit
from pilotage.results import CLOUD, SUMMARY, check_free, claim_folder, ply_bytes, write_json

if TYPE_CHECKING:
    from pilotage import ReconstructionConfig
    from pilotage.recordings.frames import Grey

TABLE, PICTURE = "depth.csv", "depth.png"
COLUMNS = "x_px,y_px,depth_m,depth_sigma_m,distance_m,distance_sigma_m"
OBSTACLES_SHOWN = 20
HIGHEST_M = 100.0


def depth_folder(  # noqa: PLR0913, all by name
    *,
    first: Path,
    second: Path,
    out: Path,
    baseline_m: float,
    baseline_sigma_m: float,
    camera_height_m: float | None,
    calibration: Path | None,
    fov_deg: float | None,
    at: Sequence[tuple[float, float]],
    config: ReconstructionConfig,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Measure the depths of two pictures, write the folder `out`, and return its summary.

    The camera is that of `calibration`, of a file beside the first picture, or a pinhole of
    `fov_deg`. InputError for what cannot be a call, RunError where a file cannot be written.
    """
    check_baseline(baseline_m, baseline_sigma_m)
    if camera_height_m is not None and not 0 < camera_height_m <= HIGHEST_M:
        raise InputError(
            f"height of the camera {camera_height_m:g} m: must be over 0, to {HIGHEST_M:g}"
        )
    grey = read_first(first)
    camera = camera_of(grey, first.parent, calibration, fov_deg)
    for x, y in at:
        if not (0 <= x <= camera.width_px - 1 and 0 <= y <= camera.height_px - 1):
            raise InputError(
                f"--at {x:g},{y:g}: outside the picture, {camera.width_px}x{camera.height_px}"
            )
    check_free(out, overwrite=overwrite)
    start, start_cpu = time.perf_counter(), time.process_time()
    depth = measure_depth(
        *read_greys([first, second], camera, first=grey), camera=camera, baseline_m=baseline_m,
        baseline_sigma_m=baseline_sigma_m, config=config,
    )  # fmt: skip
    cost = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - start_cpu}
    summary = _summary(depth, first, second, at) | _ground(depth, camera_height_m) | cost
    claim_folder(out, (CLOUD, TABLE, PICTURE))
    errors = write_each(_writes(out, depth, grey, summary))
    if errors:
        raise errors[0]
    return summary


def _summary(
    depth: Depth, first: Path, second: Path, at: Sequence[tuple[float, float]]
) -> dict[str, Any]:
    motion = depth.second_from_first
    return {
        "program": "pilotage", "version": __version__, "commit": program_commit(),
        "state": "done", "first": str(first), "second": str(second),
        "status": "measured" if depth.is_good else "refused",
        "reason": depth.reason, "remedy": depth.remedy, "warning": depth.warning,
        "points": len(depth.depth_m), "sigma_px": depth.sigma_px,
        "median_depth_m": _median(depth.depth_m),
        "median_relative_sigma": _median(depth.depth_sigma_m / depth.depth_m),
        "second_from_first": None if motion is None else {
            "translation_m": motion.translation_m, "quaternion_wxyz": motion.quaternion_wxyz,
        },
        "at": [{"x_px": x, "y_px": y, **asdict(distance_at(depth, (x, y)))} for x, y in at],
    }  # fmt: skip


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if len(values) else None


def _ground(depth: Depth, camera_height_m: float | None) -> dict[str, Any]:
    ground = find_ground(depth, camera_height_m=camera_height_m) if depth.is_good else None
    if ground is None:
        return {"ground": None, "obstacles": []}
    found = find_obstacles(depth, ground)[:OBSTACLES_SHOWN]
    return {
        "ground": {"up_in_camera": ground.up, "camera_height_m": ground.height_m},
        "obstacles": [_obstacle(obstacle) for obstacle in found],
    }


def _obstacle(obstacle: Obstacle) -> dict[str, Any]:
    values = asdict(obstacle)
    return values | {"bearing_deg": math.degrees(values.pop("bearing_rad"))}


def _writes(
    out: Path, depth: Depth, grey: Grey, summary: dict[str, Any]
) -> list[Callable[[], object]]:
    writes: list[Callable[[], object]] = []
    if depth.is_good:
        x, y = np.rint(depth.pixels).astype(int).T
        cloud = ply_bytes(depth.points_m, grey[y, x])
        writes += [
            functools.partial(write_atomically, out / TABLE, _table(depth)),
            functools.partial(write_atomically, out / CLOUD, cloud),
            functools.partial(write_atomically, out / PICTURE, depth_picture(depth, grey)),
        ]
    # Last: a summary that says "done" vouches for the rest.
    return [*writes, functools.partial(write_json, out / SUMMARY, summary)]


def _table(depth: Depth) -> str:
    columns = (depth.depth_m, depth.depth_sigma_m, depth.distance_m, depth.distance_sigma_m)
    rows = np.column_stack([depth.pixels, *columns])
    lines = [",".join(f"{value:.5g}" for value in row) for row in rows]
    return "\n".join([COLUMNS, *lines]) + "\n"
