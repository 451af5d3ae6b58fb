# SPDX-License-Identifier: Apache-2.0
"""How right are the depths that a Nao measures standing and crouching, and what do they cost?

    python benchmarks/depth.py --rooms 20

A simulated Nao stands in offices and in rooms with things 1 to 3 m away, looks ahead and to both
sides with both cameras, crouches by 11 cm and looks again. Each two pictures of one camera and one
look are measured and compared with the true depth of the same pixels.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sweep_pictures import SweepingNao, TrueView, sweep_goals, things_at, true_depths
from tables import markdown_table, number

from pilotage.behaviors.depth import Depth, measure_depth
from pilotage.calibration.nao_head import CAMERAS
from pilotage.simulation import load_world
from pilotage.simulation.nao import TORSO_M

Array = npt.NDArray[Any]
BASELINE_M = TORSO_M["stand"] - TORSO_M["crouch"]
BANDS_M = ((0.5, 1.5), (1.5, 2.5), (2.5, 4.0))
AT_TWO_METRES = BANDS_M[1]
FEWEST = 10  # points in a band, for its median to count
GOAL_ERROR, GOAL_S = 0.02, 0.3


@dataclass(frozen=True, eq=False)
class Run:
    """A pair of pictures, what was measured, and the true depth of the points without an edge."""

    room: str
    camera: str
    depth: Depth
    true_m: Array
    is_known: Array
    wall_s: float
    cpu_s: float

    def errors(self) -> Array:
        """Return relative errors of the known points (N,)."""
        return (self.depth.depth_m - self.true_m)[self.is_known] / self.true_m[self.is_known]

    def in_band(self, band_m: tuple[float, float]) -> Array:
        """Tell which of the known points (N,) are truly so far away."""
        true_m = self.true_m[self.is_known]
        return (true_m >= band_m[0]) & (true_m < band_m[1])


def main() -> int:
    """Print the tables; exit 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=20, help="half offices, half with things")
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--seed", type=int, default=0, help="of the first room")
    arguments = parser.parse_args()
    runs = []
    for room in range(arguments.rooms):
        runs += list(measured(arguments.seed + room, arguments.width))
        print(f"[{room + 1}/{arguments.rooms}]", file=sys.stderr, flush=True)
    print(table(runs))
    return 0 if all([report_goal(runs, camera) for camera in CAMERAS]) else 1


def measured(seed: int, width_px: int) -> Iterator[Run]:
    """Measure what both cameras see at each look in one room."""
    is_office = seed % 2 == 0
    world = load_world("office", seed=seed) if is_office else things_at((1.0, 2.0, 3.0), seed)
    nao = SweepingNao(world, width_px=width_px, seed=seed)
    goals = sweep_goals(from_left=True)
    standing = nao.look_at(goals)
    nao.crouch()
    for first, second in zip(standing, nao.look_at(goals), strict=True):
        yield run_of("office" if is_office else "things", first, second)


def run_of(room: str, first: TrueView, second: TrueView) -> Run:
    """Measure one pair twice, for the time the second time, when all is loaded."""
    pair = {"camera": first.view.lens, "baseline_m": BASELINE_M}
    for _ in range(2):
        wall, cpu = time.perf_counter(), time.process_time()
        depth = measure_depth(first.view.grey, second.view.grey, **pair)
        wall_s, cpu_s = time.perf_counter() - wall, time.process_time() - cpu
    true_m, is_known = true_depths(first, depth.pixels)
    return Run(room, first.view.camera, depth, true_m, is_known, wall_s, cpu_s)


def medians(runs: list[Run], band_m: tuple[float, float]) -> list[float]:
    """Return each pair's median error among its points in a band, as parts of the depth."""
    chosen = [run.errors()[run.in_band(band_m)] for run in runs if run.depth.is_good]
    return [float(np.median(np.abs(errors))) for errors in chosen if len(errors) >= FEWEST]


def table(runs: list[Run]) -> str:
    """Return a row for each kind of room and camera."""
    titles = ["room", "camera", "pairs", "refused"]
    for low_m, high_m in BANDS_M:
        titles += [f"{low_m:g} to {high_m:g} m: pairs", "median error, %", "worst pair, %"]
    titles += ["points", "NEES, median (0.455)", "within 2 sigma, %", "wall s", "CPU s"]
    rows = []
    for room in dict.fromkeys(run.room for run in runs):
        for camera in CAMERAS:
            rows.append(row_of([r for r in runs if (r.room, r.camera) == (room, camera)]))
    return markdown_table(titles, rows)


def row_of(runs: list[Run]) -> list[str]:
    """Return the cells of some runs of one kind."""
    good = [run for run in runs if run.depth.is_good]
    cells = [runs[0].room, runs[0].camera, str(len(runs)), str(len(runs) - len(good))]
    for band_m in BANDS_M:
        of_pairs = [100 * value for value in medians(runs, band_m)]
        cells += [str(len(of_pairs))]
        cells += (
            [number(statistics.median(of_pairs)), number(max(of_pairs))] if of_pairs else ["", ""]
        )
    squares = np.concatenate([squared_errors(run) for run in good]) if good else np.empty(0)
    points = [len(run.depth.pixels) for run in good] or [0]
    return [
        *cells,
        number(statistics.median(points)),
        number(float(np.median(squares))) if len(squares) else "",
        number(100 * float(np.mean(squares < 4))) if len(squares) else "",
        f"{statistics.median(run.wall_s for run in runs):.2f}",
        f"{statistics.median(run.cpu_s for run in runs):.2f}",
    ]


def squared_errors(run: Run) -> Array:
    """Return squared errors of the known points in units of their variances (N,)."""
    error_m = (run.depth.depth_m - run.true_m)[run.is_known]
    return np.asarray((error_m / run.depth.depth_sigma_m[run.is_known]) ** 2)


def report_goal(runs: list[Run], camera: str) -> bool:
    """Print what one camera's pairs make of the goals; return whether they are met.

    A camera that sees nothing at 2 m is judged by what it sees nearer.
    """
    chosen = [run for run in runs if run.camera == camera]
    bands_m = [band_m for band_m in (AT_TWO_METRES, BANDS_M[0]) if len(medians(chosen, band_m)) > 1]
    of_pairs = medians(chosen, bands_m[0]) if bands_m else [math.nan]
    low_m, high_m = bands_m[0] if bands_m else AT_TWO_METRES
    median, wall_s = statistics.median(of_pairs), statistics.median(run.wall_s for run in chosen)
    met = median <= GOAL_ERROR and wall_s <= GOAL_S
    print(
        f"{camera}: {100 * median:.2f} % at {low_m:g} to {high_m:g} m (median of "
        f"{len(of_pairs)} pairs' medians, {np.mean(np.array(of_pairs) <= GOAL_ERROR):.0%} of them "
        f"within the goal), goal {100 * GOAL_ERROR:g} %; {wall_s:.2f} s, goal {GOAL_S:g} s: "
        f"{'PASS' if met else 'MISS'}"
    )
    return met


if __name__ == "__main__":
    sys.exit(main())
