# SPDX-License-Identifier: Apache-2.0
"""How far off is the trajectory after simulated drives, over many worlds?

    python benchmarks/drives.py --drives 200 --out drives.jsonl
    python benchmarks/drives.py --drives 20 --width 240 --rate-hz 5 --longest-m 15    # as in CI

Each drive has a yard of its own (five grounds in turn, flat or with relief), a closed or open path
of 5 to 50 m, a speed, and a camera that does wrong what real ones do. Drives do not depend on each
other or on how many there are; those that --out holds already are not driven again, so that an
interrupted run goes on where it was. --from and --drives drive a piece of the whole.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotage import StereoOdometry
from pilotage.evaluation.metrics import evaluate_trajectory
from pilotage.simulation import Drive, Simulation, load_world, robot_model
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.grounds import GROUNDS
from pilotage.simulation.sensor import read_sensor
from pilotage.simulation.yard import YardOptions, side_for_m

ROBOT, PAIR = "rover", "front"
SHAPES = ("closed", "open", "square", "straight", "eight")
SHORTEST_M, LONGEST_M = 5.0, 50.0
NS = 1_000_000_000


@dataclass(frozen=True)
class DrivePlan:
    """One drive; all of it follows from its number."""

    number: int
    seed: int
    ground: str
    path: str
    relief_m: float
    speed_m_s: float


def plan_of(number: int, longest_m: float) -> DrivePlan:
    random = np.random.default_rng([20261122, number])
    length_m = round(float(np.exp(random.uniform(np.log(SHORTEST_M), np.log(longest_m)))), 1)
    return DrivePlan(
        number=number,
        seed=1000 + number,
        ground=list(GROUNDS)[number % len(GROUNDS)],
        path=f"{SHAPES[number // len(GROUNDS) % len(SHAPES)]}-{length_m:g}m",
        relief_m=round(float(random.choice([0.0, random.uniform(0.02, 0.10)])), 3),
        speed_m_s=round(float(random.uniform(0.25, 0.6)), 2),
    )


def simulation_of(plan: DrivePlan) -> Simulation:
    options = {
        "ground": plan.ground,
        "path": plan.path,
        "relief_m": plan.relief_m,
        "size_m": max(YardOptions.size_m, side_for_m(plan.path)),
    }
    return Simulation(load_world("yard", seed=plan.seed, options=options), ROBOT, seed=plan.seed)


@dataclass
class Tracked:
    """What the odometry made of a drive, and the robot's true poses (N, 4, 4) at its pairs."""

    results: list[Any]
    truth: np.ndarray[Any, Any]
    tracking_s: float
    has_arrived: bool


def track(plan: DrivePlan, *, width: int, rate_hz: float, camera: str) -> Tracked:
    """Drive and track every pair that comes."""
    simulation, robot = simulation_of(plan), robot_model(ROBOT)
    rig = robot.stereo_rig(simulation, PAIR, width)
    left, right = robot.pairs[PAIR]
    group = camera_groups(
        simulation, robot, read_sensor(camera), width_px=width, seed=plan.seed, pairs=[PAIR]
    )[PAIR]
    odometry, truth, tracking_s, tries = StereoOdometry(rig=rig), [], 0.0, 0
    way = Drive(simulation, plan.path, speed_m_s=plan.speed_m_s)
    for now_ns in way:
        while (shot_ns := round(tries * NS / rate_hz)) <= now_ns:
            tries += 1
            shot = group.take(shot_ns)
            if shot is None or len(shot.pictures) < 2:
                continue
            began = time.process_time()
            odometry.track(shot.pictures[left], shot.pictures[right], shot.stamps_ns[left])
            tracking_s += time.process_time() - began
            truth.append(simulation.robot_pose(shot.taken_ns).matrix())
    return Tracked(odometry.finish(), np.array(truth), tracking_s, way.has_arrived)


def drive(plan: DrivePlan, *, width: int, rate_hz: float, camera: str) -> dict[str, Any]:
    """Return the figures of one drive's adjusted trajectory."""
    start = time.process_time()
    tracked = track(plan, width=width, rate_hz=rate_hz, camera=camera)
    unknown = np.full((4, 4), np.nan)
    poses = [result.world_from_left for result in tracked.results]
    metrics = evaluate_trajectory(
        estimate=np.array([unknown if pose is None else pose.matrix() for pose in poses]),
        truth=tracked.truth,
        covariances=covariances_of(tracked.results),
    )
    return {
        **asdict(plan),
        "arrived": tracked.has_arrived,
        "pairs": metrics.pairs,
        "lost": metrics.lost,
        "length_m": metrics.truth_length_m,
        "end_m": metrics.end_error_m,
        "end_percent": metrics.end_error_percent,
        "ate_percent": metrics.ate_percent_of_length,
        "scale": metrics.scale,
        "nees": metrics.consistency.mean_nees if metrics.consistency else None,
        "tracking_ms": 1e3 * tracked.tracking_s / max(1, metrics.pairs),
        "cpu_s": time.process_time() - start,
    }


def covariances_of(results: list[Any]) -> np.ndarray[Any, Any]:
    unknown = np.full((6, 6), np.nan)
    return np.array([unknown if r.covariance is None else r.covariance for r in results])


def drive_safely(job: tuple[DrivePlan, dict[str, Any]]) -> dict[str, Any]:
    """Drive; an error becomes the result, so that the other drives go on."""
    plan, settings = job
    try:
        return drive(plan, **settings)
    except Exception as error:
        return {**asdict(plan), "error": f"{type(error).__name__}: {error}"}


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


def run(jobs: list[Any], workers: int) -> Iterator[dict[str, Any]]:
    if workers == 1:
        yield from map(drive_safely, jobs)
        return
    with multiprocessing.get_context("spawn").Pool(workers, maxtasksperchild=10) as pool:
        yield from pool.imap_unordered(drive_safely, jobs)


def say(record: dict[str, Any], count: int, total: int) -> None:
    if "error" in record:
        text = record["error"]
    else:
        text = (
            f"end {record['end_percent']:.3f} %, ATE {record['ate_percent']:.3f} %, "
            f"{record['lost']} of {record['pairs']} lost, {record['cpu_s']:.0f} CPU-s"
        )
    what = f"{record['number']:3d} {record['ground']} {record['path']}"
    print(f"[{count}/{total}] {what}: {text}", file=sys.stderr, flush=True)


def row(name: str, records: list[dict[str, Any]]) -> str:
    def quantiles(key: str) -> str:
        values = np.array([record[key] for record in records])
        return " | ".join(f"{np.quantile(values, q):.3f}" for q in (0.5, 0.95, 1.0))

    lost = sum(record["lost"] for record in records)
    pairs = sum(record["pairs"] for record in records)
    nees = np.median([record["nees"] for record in records])
    return (
        f"| {name} | {len(records)} | {quantiles('end_percent')} | {quantiles('ate_percent')} | "
        f"{np.median([record['scale'] for record in records]):.4f} | {lost} of {pairs} | "
        f"{nees:.1f} | {np.median([r['tracking_ms'] for r in records]):.1f} |"
    )


def report(records: list[dict[str, Any]]) -> None:
    print(
        "| ground | drives | closing error, %: median | 95th | largest | ATE, %: median | 95th | "
        "largest | scale | lost | NEES, median | CPU-ms a pair |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|"
    )
    for ground in GROUNDS:
        of_ground = [record for record in records if record["ground"] == ground]
        if of_ground:
            print(row(ground, of_ground))
    print(row("all", records))
    flat = [record for record in records if record["relief_m"] == 0]
    rough = [record for record in records if record["relief_m"] > 0]
    for name, some in (("flat", flat), ("with relief", rough)):
        if some:
            print(row(name, some))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--from", dest="first", type=int, default=0, help="number of the first")
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--rate-hz", type=float, default=10.0)
    parser.add_argument("--longest-m", type=float, default=LONGEST_M)
    parser.add_argument("--camera", default="realistic", help="good, ideal, realistic or a YAML")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file to add results to, one JSON line each")
    arguments = parser.parse_args()
    settings = {
        "width": arguments.width, "rate_hz": arguments.rate_hz, "camera": arguments.camera,
    }  # fmt: skip
    marked = {**settings, "longest_m": arguments.longest_m}
    done = read_done(arguments.out, marked) if arguments.out else {}
    numbers = range(arguments.first, arguments.first + arguments.drives)
    plans = [plan_of(number, arguments.longest_m) for number in numbers if number not in done]
    records = [done[number] for number in numbers if number in done]
    failures = []
    for record in run([(plan, settings) for plan in plans], arguments.workers):
        (failures if "error" in record else records).append(record)
        say(record, len(records) + len(failures), len(numbers))
        if arguments.out:
            with arguments.out.open("a") as file:
                file.write(json.dumps({**record, "settings": marked}) + "\n")
    if records:
        report(records)
    astray = [record["number"] for record in records if not record["arrived"]]
    if astray:
        print(f"did not arrive, and were judged by what they drove: {astray}")
    for record in failures:
        print(f"failed: {record['number']}: {record['error']}")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
