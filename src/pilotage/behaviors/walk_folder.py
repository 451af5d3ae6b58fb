# SPDX-License-Identifier: Apache-2.0
"""A recording of a walk with stops in, a folder with its model and its stops out."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import LengthSource, StopFate
from pilotage.atomic_files import write_atomically, write_each
from pilotage.behaviors.model_files import MODEL_FILES, length_summary, model_summary, model_writes
from pilotage.behaviors.square_marks import MarkSize, no_mark
from pilotage.behaviors.walk import PlacedWalk, place_walk, walk_config, what_became
from pilotage.behaviors.walk_account import RecordedWalk, read_walk
from pilotage.config import load_reconstruction_config
from pilotage.evaluation.metrics import evaluate_trajectory
from pilotage.pose_files import PoseRecord, tum_line
from pilotage.recordings import open_pictures
from pilotage.recordings.motion import nearest
from pilotage.results import (
    STOPS,
    SUMMARY,
    TUM_TORSO,
    WALK_PICTURES,
    check_free,
    claim_folder,
    write_json,
)
from pilotage.stop_files import stops_text

if TYPE_CHECKING:
    from pilotage import ReconstructionConfig, Transform

TUM_OF_CAMERAS = "trajectory_*_tum.txt"
WALK_FILES = (
    *MODEL_FILES,
    STOPS,
    TUM_TORSO,
    TUM_OF_CAMERAS,
    f"{WALK_PICTURES}/stop*.png",
    f"{WALK_PICTURES}/",
)
# Truth is told often while a robot stands.
TRUTH_WITHIN_NS = 100_000_000


def reconstruct_recording(  # noqa: PLR0913, all by name
    *,
    recording: Path,
    out: Path,
    config: Path | None = None,
    settings: Sequence[str] = (),
    marks: MarkSize | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Place the stops of a recorded walk, write the folder `out`, and return its summary.

    `marks` are squares of a known side in its pictures.

    InputError where the recording holds no pictures of a robot that stands, or `out` is not free;
    RunError where a file cannot be written: what can be is.
    """
    chosen = load_reconstruction_config(config, settings, base=walk_config())
    walk = read_walk(open_pictures(recording))
    check_free(out, overwrite=overwrite)
    claim_folder(out, WALK_FILES)
    start, start_cpu = time.perf_counter(), time.process_time()
    placed = place_walk(walk, chosen, marks)
    cost = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - start_cpu}
    summary = _summary(recording, placed) | cost
    if marks is not None and not any(
        one.source is LengthSource.marks for one in placed.result.lengths
    ):
        summary["length_fault"] = f"{no_mark(marks)}: lengths are by joints, steps and floor alone"
    errors = write_each(_writes(out, placed, chosen, summary))
    if errors:
        raise errors[0]
    return summary


def _summary(recording: Path, placed: PlacedWalk) -> dict[str, Any]:
    walk, stops = placed.walk, placed.stops
    told = model_summary(
        source=recording, verdict="; ".join(what_became(stops)) or "whole", names=walk.names,
        model=placed.model, result=placed.result.model, fates=placed.result.model.fates, unit="m",
        ordered=True,
    )  # fmt: skip
    return told | {
        "moving_pictures": walk.moving, "unreadable": list(walk.bad),
        "stops": len(stops),
        "stops_placed": sum(stop.world_from_stop is not None for stop in stops),
        "stops_carried": [i for i, stop in enumerate(stops) if stop.fate == StopFate.carried],
        "stops_found": [i for i, stop in enumerate(stops) if stop.fate == StopFate.found],
        "stops_lost": [i for i, stop in enumerate(stops) if stop.fate == StopFate.lost],
        "set_aside": [stop.set_aside for stop in stops],
        "lengths": length_summary(
            placed.result.lengths, placed.result.length_factor, placed.result.length_sigma
        ),
        "truth": against_truth(placed),
    }  # fmt: skip


def true_stops(walk: RecordedWalk) -> NDArray[np.float64] | None:
    """Return (S, 4, 4) true poses of the robot at the stops, NaN where none is told near in time.

    None where the recording holds no truth.
    """
    truth = walk.recording.truth("robot")
    if truth is None:
        return None
    poses = np.full((len(walk.firsts), 4, 4), np.nan)
    for i, first in enumerate(walk.firsts):
        at = nearest(truth.timestamps_ns, first.timestamp_ns, within_ns=TRUTH_WITHIN_NS)
        if at is not None:
            poses[i] = truth.poses[at]
    return poses


def against_truth(placed: PlacedWalk) -> dict[str, float] | None:
    """Return the stops' errors where the recording holds the robot's truth, else None.

    They begin at the first stop, as the world does; `home_m` and `home_deg` are of the last.
    """
    true = true_stops(placed.walk)
    if true is None:
        return None
    estimate = placed.world_from_stop
    known = np.flatnonzero(~np.isnan(estimate[:, 0, 0]) & ~np.isnan(true[:, 0, 0]))
    if len(known) < 2:
        return None
    covariances = np.array([stop.covariance for stop in placed.stops])
    metrics = evaluate_trajectory(estimate=estimate, truth=true, covariances=covariances)
    first, last = known[0], known[-1]
    wanted = np.linalg.inv(true[first]) @ true[last]
    left = np.linalg.inv(wanted) @ np.linalg.inv(estimate[first]) @ estimate[last]
    cosine = (np.trace(left[:3, :3]) - 1) / 2
    return {
        "ate_rmse_m": metrics.ate_rmse_m,
        "largest_m": metrics.origin_error_max_m,
        "home_m": float(np.linalg.norm(left[:3, 3])),
        "home_deg": math.degrees(math.acos(min(1.0, max(-1.0, float(cosine))))),
        "scale": metrics.scale,
    }


def _writes(
    out: Path, placed: PlacedWalk, config: ReconstructionConfig, summary: dict[str, Any]
) -> list[Callable[[], object]]:
    walk, model = placed.walk, placed.model
    times_ns = [first.timestamp_ns for first in walk.firsts]
    of_name = {n: p.timestamp_ns for n, p in zip(walk.names, walk.pictures, strict=True)}
    writes = model_writes(out, model, of_name, config, walk.camera_names)
    writes += [
        functools.partial(write_atomically, out / STOPS, stops_text(placed.stops, times_ns)),
        functools.partial(write_pictures, out / WALK_PICTURES, walk),
    ]
    if model.names:
        torso = _tum(times_ns, placed.world_from_torso)
        writes.append(functools.partial(write_atomically, out / TUM_TORSO, torso))
    # Last: a summary that says "done" vouches for the rest.
    return [*writes, functools.partial(write_json, out / SUMMARY, summary)]


def write_pictures(folder: Path, walk: RecordedWalk) -> None:
    """Write the pictures that the model's names mean."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, picture in zip(walk.names, walk.pictures, strict=True):
        encoded = cv2.imencode(".png", picture.picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
        write_atomically(folder / name, encoded.tobytes())


def _tum(times_ns: Sequence[int], poses: Sequence[Transform | None]) -> str:
    lines = []
    for i, (time_ns, pose) in enumerate(zip(times_ns, poses, strict=True)):
        if pose is None:
            continue
        x, y, z = (float(v) for v in pose.translation_m)
        w, *vector = (float(v) for v in pose.quaternion_wxyz)
        lines.append(
            tum_line(
                PoseRecord(
                    index=i,
                    timestamp_ns=time_ns,
                    status="tracking",
                    position_m=(x, y, z),
                    quaternion_wxyz=(w, vector[0], vector[1], vector[2]),
                )
            )
        )
    return "".join(lines)
