# SPDX-License-Identifier: Apache-2.0
"""What do the pair that looks ahead and the one that looks down cost together?

    python benchmarks/two_pairs.py --width 1280    # goal: 17.8 ms an instant, 30 CPU-ms
    python benchmarks/two_pairs.py --width 640     # goal: 8 CPU-ms

The rover drives through a yard; both pairs are rendered 56 times a second and kept in memory. Then
each pair is tracked alone, both at the same time in a thread each, and the OpenCV pipeline on the
pair ahead, all in turns. The least of --repeats counts: what else runs on the machine only adds,
and to the time by the clock most; what the busier of the two threads computes is what that comes to
where two processors are free.
--pictures keeps the rendered pictures in a file for the next run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from threading import Thread
from typing import Any

import cv2
import numpy as np
from opencv_odometry import OpencvOdometry
from simulated_drives import shots_of
from tables import markdown_table

from pilotage import OdometryConfig, StereoOdometry
from pilotage.config import DOWNWARD
from pilotage.simulation import Drive, Simulation, load_world, robot_model
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.sensor import read_sensor

ROBOT, PATH, SPEED_M_S, RATE_HZ, SEED = "rover", "closed-10m", 0.5, 56.0, 7
UNDER_WAY_S = 1.5
SETTINGS: dict[str, dict[str, Any]] = {"front": {}, "down": DOWNWARD}
# Most of both pairs together, ms an instant: by the clock (56 instants a second) and of processors.
WALL_GOALS_MS, CPU_GOALS_MS = {1280: 17.8}, {1280: 30.0, 640: 8.0}


@dataclass(frozen=True)
class Pictures:
    """Of one pair: `left`, `right` (N, H, W) uint8 and N stamps."""

    left: np.ndarray[Any, Any]
    right: np.ndarray[Any, Any]
    stamps_ns: np.ndarray[Any, Any]


def render(width: int, instants: int, camera: str) -> dict[str, Pictures]:
    """Return what both pairs see once the rover has got up to speed."""
    simulation, robot = make_simulation(), robot_model(ROBOT)
    sensor = read_sensor(camera)
    lenses = robot.pair_lenses(robot.stereo_rigs(simulation, width, (*SETTINGS,)))
    groups = camera_groups(simulation, lenses, sensor, seed=SEED)
    way = Drive(simulation, PATH, speed_m_s=SPEED_M_S)
    seen: dict[str, list[Any]] = {pair: [] for pair in SETTINGS}
    shots = shots_of(way, simulation, robot, groups, rate_hz=RATE_HZ, since_s=UNDER_WAY_S)
    for shot in islice(shots, len(SETTINGS) * instants):
        seen[shot.pair].append((shot.left, shot.right, shot.stamp_ns))
    return {pair: Pictures(*map(np.array, zip(*of, strict=True))) for pair, of in seen.items()}


def make_simulation() -> Simulation:
    world = load_world("yard", seed=SEED, options={"ground": "gravel", "path": PATH})
    return Simulation(world, ROBOT, seed=SEED)


def load_or_render(arguments: argparse.Namespace) -> dict[str, Pictures]:
    """Return the pictures of the file when there is one; else render and, if asked for, keep."""
    keys = Pictures.__dataclass_fields__
    wanted = np.array([arguments.width, arguments.instants])
    file = arguments.pictures
    if file is not None and file.exists():
        with np.load(file) as saved:
            if not np.array_equal(saved["wanted"], wanted) or str(saved["camera"]) != (
                arguments.camera
            ):
                sys.exit(f"{file}: of another width, camera or number of instants; give another")
            return {p: Pictures(*(saved[f"{p}_{key}"] for key in keys)) for p in SETTINGS}
    pictures = render(arguments.width, arguments.instants, arguments.camera)
    if file is not None:
        arrays = {f"{p}_{key}": getattr(of, key) for p, of in pictures.items() for key in keys}
        np.savez(file, wanted=wanted, camera=arguments.camera, **arrays)
    return pictures


def cost_ms(work: Callable[[], object]) -> tuple[float, float]:
    """Return the time of all processors, and of the clock."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()
    return 1e3 * (time.process_time() - cpu), 1e3 * (time.perf_counter() - wall)


class Works:
    """The works to be timed, each from a fresh start."""

    def __init__(self, pictures: dict[str, Pictures], points: int, camera: str) -> None:
        simulation, robot = make_simulation(), robot_model(ROBOT)
        width, readout_s = pictures["front"].left.shape[2], read_sensor(camera).readout_s
        self._rigs = robot.stereo_rigs(simulation, width, (*SETTINGS,), readout_s)
        self._pictures, self._points = pictures, points
        self.lost = 0
        self.busier_thread_ms: list[float] = []  # each time that both were tracked

    def alone(self, pair: str) -> Callable[[], None]:
        """Return the tracking of one pair, on one thread."""
        config = {"points": self._points, "threads": 1, **SETTINGS[pair]}
        odometry = StereoOdometry(rig=self._rigs[pair], config=OdometryConfig.from_dict(config))
        seen = self._pictures[pair]

        def work() -> None:
            for left, right, stamp_ns in zip(seen.left, seen.right, seen.stamps_ns, strict=True):
                result = odometry.track(left, right, int(stamp_ns))
                self.lost += result.world_from_left is None

        return work

    def both(self) -> Callable[[], None]:
        """Return the tracking of both pairs at the same time."""
        spent_ms: list[float] = []

        def timed(track: Callable[[], None]) -> None:
            start = time.thread_time()
            track()
            spent_ms.append(1e3 * (time.thread_time() - start))

        threads = [Thread(target=timed, args=(self.alone(pair),)) for pair in SETTINGS]

        def work() -> None:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            self.busier_thread_ms.append(max(spent_ms))

        return work

    def opencv(self) -> Callable[[], None]:
        """Return the OpenCV pipeline on the pair that looks ahead."""
        odometry, seen = OpencvOdometry(self._rigs["front"]), self._pictures["front"]

        def work() -> None:
            for left, right in zip(seen.left, seen.right, strict=True):
                odometry.track(left, right)

        return work


def measure(pictures: dict[str, Pictures], arguments: argparse.Namespace) -> list[str]:
    """Return a row of the table, and print on which goals it stands."""
    works = Works(pictures, arguments.points, arguments.camera)
    makers: dict[str, Callable[[], Callable[[], None]]] = {
        **{pair: (lambda pair=pair: works.alone(pair)) for pair in SETTINGS},
        "both": works.both,
        "opencv": works.opencv,
    }
    repeats = [
        [cost_ms(make()) for make in makers.values()] for _ in range(arguments.repeats)
    ]  # in turns
    instants = min(len(of.stamps_ns) for of in pictures.values())
    least = dict(zip(makers, np.min(repeats, axis=0) / instants, strict=True))
    height, width = pictures["front"].left.shape[1:]
    (cpu, wall), opencv = least["both"], least["opencv"][0]
    for name, value, goals in (("wall-ms", wall, WALL_GOALS_MS), ("CPU-ms", cpu, CPU_GOALS_MS)):
        if width in goals:
            verdict = "PASS" if value <= goals[width] else "MISS"
            print(f"both, {width}x{height}: {value:.2f} {name}, goal {goals[width]:g}: {verdict}")
    if works.lost:
        print(f"without a pose: {works.lost} of {2 * len(SETTINGS) * arguments.repeats * instants}")
    return [
        f"{width}x{height}", str(arguments.points), str(instants),
        *(f"{least[name][0]:.2f}" for name in SETTINGS), f"{cpu:.2f}",
        f"{min(works.busier_thread_ms) / instants:.2f}", f"{wall:.2f}",
        f"{1e3 / wall:.1f}", f"{opencv:.1f}", f"{opencv / least['front'][0]:.1f}",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--instants", type=int, default=100)
    parser.add_argument("--points", type=int, default=OdometryConfig().points, help="of each pair")
    parser.add_argument("--camera", default="realistic", help="good, ideal, realistic or a YAML")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--pictures", type=Path, metavar="NPZ", help="keep pictures in this file")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    pictures = load_or_render(arguments)
    row = measure(pictures, arguments)
    titles = [
        "pictures", "points", "instants", "ahead, CPU-ms", "down, CPU-ms", "both, CPU-ms",
        "busier thread",
        "both, wall-ms", "instants/s", "OpenCV ahead, CPU-ms", "OpenCV/ours, ahead",
    ]  # fmt: skip
    print("\n" + markdown_table(titles, [row]))


if __name__ == "__main__":
    main()
