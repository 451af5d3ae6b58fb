# SPDX-License-Identifier: Apache-2.0
"""What benchmarks that drive through simulated worlds share: pictures on the way, and going on.

Drives are independent jobs. Each gives one record, a JSON line of a file; an error is a record too.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pilotage import Transform
from pilotage.simulation import Drive, Simulation
from pilotage.simulation.camera_group import CameraGroup
from pilotage.simulation.models import RobotModel

NS = 1_000_000_000


@dataclass(frozen=True)
class PairShot:
    """Both pictures of a stereo pair, (H, W) uint8, and where the robot really was then."""

    pair: str
    left: np.ndarray[Any, Any]
    right: np.ndarray[Any, Any]
    stamp_ns: int
    world_from_robot: Transform


def shots_of(  # noqa: PLR0913, what a drive is made of
    way: Drive,
    simulation: Simulation,
    robot: RobotModel,
    groups: dict[str, CameraGroup],
    *,
    rate_hz: float,
    since_s: float = 0.0,
) -> Iterator[PairShot]:
    """Drive the way; yield what comes of each pair in `groups`, which fire `rate_hz` a second."""
    tries = math.ceil(since_s * rate_hz)
    for now_ns in way:
        while (shot_ns := round(tries * NS / rate_hz)) <= now_ns:
            tries += 1
            for pair, group in groups.items():
                shot, names = group.take(shot_ns), robot.pairs[pair]
                if shot is None or len(shot.pictures) < len(names):
                    continue
                left, right = (shot.pictures[name] for name in names)
                pose = simulation.robot_pose(shot.taken_ns)
                yield PairShot(pair, left, right, shot.stamps_ns[names[0]], pose)


def read_done(out: Path, settings: dict[str, Any]) -> dict[int, dict[str, Any]]:
    """Return what is in the file by number; a line that an interrupt cut off is left out."""
    done: dict[int, dict[str, Any]] = {}
    if not out.exists():
        return done
    text = out.read_text()
    if text and not text.endswith("\n"):
        out.write_text(text + "\n")  # what follows begins a line of its own
    for line in text.splitlines():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if record.get("settings") != settings:
            sys.exit(f"{out}: driven with {record.get('settings')}, not {settings}; give another")
        if "error" not in record:
            done[record["number"]] = record
    return done


def append_done(out: Path, record: dict[str, Any], settings: dict[str, Any]) -> None:
    """Add a record with what it was driven with."""
    with out.open("a") as file:
        file.write(json.dumps({**record, "settings": settings}) + "\n")


def run(
    drive: Callable[..., dict[str, Any]], plans: list[Any], settings: dict[str, Any], workers: int
) -> Iterator[dict[str, Any]]:
    """Yield `drive(plan, **settings)` of all plans as they end; each in a process where workers."""
    one = partial(_drive_safely, drive, settings)
    if workers == 1:
        yield from map(one, plans)
        return
    with multiprocessing.get_context("spawn").Pool(workers, maxtasksperchild=10) as pool:
        yield from pool.imap_unordered(one, plans)


def _drive_safely(
    drive: Callable[..., dict[str, Any]], settings: dict[str, Any], plan: Any
) -> dict[str, Any]:
    """Drive; an error becomes the result, so that the other drives go on."""
    try:
        return drive(plan, **settings)
    except Exception as error:
        return {**asdict(plan), "error": f"{type(error).__name__}: {error}"}
