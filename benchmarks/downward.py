# SPDX-License-Identifier: Apache-2.0
"""How far off is the path that the downward pair alone makes, on flat ground and over relief?

    python benchmarks/downward.py --drives 20 --out downward.jsonl
    python benchmarks/downward.py --drives 2 --width 320 --rate-hz 5 --longest-m 8    # a small one

Each path of 8 to 15 m is driven twice, on flat ground and over relief, which tilts the rover; the
five grounds take turns. Beside our stereo odometry, live and adjusted at the end, stands what one
of its two cameras makes of it when the ground is taken to be flat (`flat_ground.py`). That one is
judged in the plane only, by x, y and yaw: height, pitch and roll it cannot know. Drives that --out
holds already are not driven again, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from drives import ROBOT, SHAPES, figures
from flat_ground import FlatGroundOdometry
from simulated_drives import append_done, read_done, run, shots_of

from pilotage import OdometryConfig, StereoOdometry
from pilotage.config import DOWNWARD
from pilotage.evaluation.metrics import evaluate_trajectory
from pilotage.simulation import Drive, Simulation, load_world, robot_model
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.grounds import GROUNDS
from pilotage.simulation.sensor import read_sensor
from pilotage.simulation.yard import side_for_m

PAIR = "down"
# The relief is level around the start: shorter circles would hardly leave that.
SHORTEST_M, LONGEST_M, YARD_M = 8.0, 15.0, 20.0
# Of the whole yard. On its way through it the rover stays within 5 cm and tilts by up to 5 degrees.
RELIEF_M, RELIEF_WAVE_M = 0.08, 2.0
KINDS = ("flat", "relief")
LIVE, FINAL, ONE_CAMERA = "stereo, live", "stereo, final", "one camera, flat ground"
IN_PLANE = "stereo, final, in the plane"
SOURCES = (LIVE, FINAL, IN_PLANE, ONE_CAMERA)
# Kind, whose, sense and limit of the median error at the end in percent.
GOALS = (
    ("flat", FINAL, "<=", 0.05),
    ("relief", FINAL, "<=", 0.3),
    ("relief", ONE_CAMERA, ">", 3.0),
)


@dataclass(frozen=True)
class DownwardPlan:
    """One drive; all of it follows from its number. Odd numbers repeat the path over relief."""

    number: int
    seed: int
    kind: str
    ground: str
    path: str
    speed_m_s: float


def plan_of(number: int, longest_m: float) -> DownwardPlan:
    turn = number // len(KINDS)
    random = np.random.default_rng([20261123, turn])
    length_m = round(float(random.uniform(SHORTEST_M, longest_m)), 1)
    return DownwardPlan(
        number=number,
        seed=3000 + turn,
        kind=KINDS[number % len(KINDS)],
        ground=list(GROUNDS)[turn % len(GROUNDS)],
        path=f"{SHAPES[(turn + turn // len(GROUNDS)) % len(SHAPES)]}-{length_m:g}m",
        speed_m_s=round(float(random.uniform(0.25, 0.6)), 2),
    )


def simulation_of(plan: DownwardPlan) -> Simulation:
    options: dict[str, Any] = {"ground": plan.ground, "path": plan.path}
    options["size_m"] = max(YARD_M, side_for_m(plan.path))
    if plan.kind == "relief":
        options |= {"relief_m": RELIEF_M, "relief_wave_m": RELIEF_WAVE_M}
    return Simulation(load_world("yard", seed=plan.seed, options=options), ROBOT, seed=plan.seed)


def drive(
    plan: DownwardPlan, *, width: int, rate_hz: float, camera: str, points: int
) -> dict[str, Any]:
    """Return the figures of one drive: stereo live and final, and one camera over flat ground."""
    start = time.process_time()
    simulation, robot, sensor = simulation_of(plan), robot_model(ROBOT), read_sensor(camera)
    rigs = robot.stereo_rigs(simulation, width, (PAIR,), sensor.readout_s)
    groups = camera_groups(simulation, robot.pair_lenses(rigs), sensor, seed=plan.seed)
    rig = rigs[PAIR]
    config = OdometryConfig.from_dict({"points": points, **DOWNWARD})
    stereo, one_camera = StereoOdometry(rig=rig, config=config), FlatGroundOdometry(rig)
    live, planar, truth = [], [], []
    way = Drive(simulation, plan.path, speed_m_s=plan.speed_m_s)
    for shot in shots_of(way, simulation, robot, groups, rate_hz=rate_hz):
        live.append(stereo.track(shot.left, shot.right, shot.stamp_ns))
        planar.append(one_camera.track(shot.left, shot.stamp_ns))
        truth.append(shot.world_from_robot.matrix())
    poses, final = np.array(truth), stereo.finish()
    in_space = [None if r.world_from_left is None else r.world_from_left.matrix() for r in final]
    return {
        **asdict(plan),
        "arrived": way.has_arrived,
        LIVE: figures(live, poses),
        FINAL: figures(final, poses),
        IN_PLANE: planar_figures(in_space, poses),
        ONE_CAMERA: planar_figures(planar, poses),
        "driven": attitude(poses),
        "cpu_s": time.process_time() - start,
    }


def planar_figures(poses: list[Any], truth: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return the figures of (4, 4) poses, None where lost, by x, y and yaw alone."""
    unknown = np.full((4, 4), np.nan)
    estimate = np.array([unknown if pose is None else pose for pose in poses])
    metrics = evaluate_trajectory(estimate=in_plane(estimate), truth=in_plane(truth))
    return {
        "pairs": metrics.pairs,
        "lost": metrics.lost,
        "end_percent": metrics.end_error_percent,
        "ate_percent": metrics.ate_percent_of_length,
        "segment_percent": metrics.translation_percent,
        "scale": metrics.scale,
    }


def in_plane(poses: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return (N, 4, 4) poses without height, pitch and roll; NaN stays NaN."""
    yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0])
    flat = np.tile(np.eye(4), (len(poses), 1, 1))
    flat[:, 0, 0], flat[:, 0, 1], flat[:, 0, 3] = np.cos(yaw), -np.sin(yaw), poses[:, 0, 3]
    flat[:, 1, 0], flat[:, 1, 1], flat[:, 1, 3] = np.sin(yaw), np.cos(yaw), poses[:, 1, 3]
    return flat


def attitude(truth: np.ndarray[Any, Any]) -> dict[str, float]:
    """Return how the robot really pitched and rolled, at most, and its lowest and highest place."""
    pitch = np.degrees(np.arcsin(-truth[:, 2, 0]))
    roll = np.degrees(np.arctan2(truth[:, 2, 1], truth[:, 2, 2]))
    return {
        "pitch_deg": float(np.abs(pitch).max()),
        "roll_deg": float(np.abs(roll).max()),
        "lowest_m": float(truth[:, 2, 3].min()),
        "highest_m": float(truth[:, 2, 3].max()),
    }


def say(record: dict[str, Any], count: int, total: int) -> None:
    if "error" in record:
        text = record["error"]
    else:
        ends = ", ".join(
            f"{name} {record[name]['end_percent']:.3f} %" for name in (FINAL, ONE_CAMERA)
        )
        text = f"{ends}; {record[FINAL]['lost']} lost, {record['cpu_s']:.0f} CPU-s"
    what = " ".join((record["kind"], record["ground"], record["path"]))
    print(f"[{count}/{total}] {record['number']:3d} {what}: {text}", file=sys.stderr, flush=True)


def row(kind: str, records: list[dict[str, Any]], source: str) -> str:
    """Return the line of the table for what one method made of these drives."""

    def of(key: str) -> np.ndarray[Any, Any]:
        return np.array([record[source][key] for record in records], float)

    def quantiles(key: str) -> str:
        return " | ".join(f"{np.nanquantile(of(key), q):.3f}" for q in (0.5, 0.95, 1.0))

    return (
        f"| {kind} | {source} | {len(records)} | {quantiles('end_percent')} | "
        f"{quantiles('ate_percent')} | {np.nanmedian(of('segment_percent')):.3f} | "
        f"{np.nanmedian(of('scale')):.4f} | {of('lost').sum():.0f} of {of('pairs').sum():.0f} |"
    )


def report(records: list[dict[str, Any]]) -> None:
    print(
        "| drives | trajectory | number | error at the end, %: median | 95th | largest | "
        "ATE, %: median | 95th | largest | over segments, %: median | scale | lost |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|"
    )
    by_kind = {kind: [r for r in records if r["kind"] == kind] for kind in KINDS}
    for kind, some in by_kind.items():
        for source in SOURCES if some else ():
            print(row(kind, some, source))
    for kind, some in by_kind.items():
        if some:
            print(f"{kind}: {driven(some)}")
    for kind, source, sense, limit in GOALS:
        if by_kind[kind]:
            median = np.median([record[source]["end_percent"] for record in by_kind[kind]])
            is_met = median <= limit if sense == "<=" else median > limit
            verdict = "PASS" if is_met else "MISS"
            print(f"{kind}, {source}: {median:.3f} %, goal {sense} {limit:g} %: {verdict}")


def driven(records: list[dict[str, Any]]) -> str:
    """Tell how the robot tilted and rose, from its true poses."""
    of = {key: np.array([r["driven"][key] for r in records]) for key in records[0]["driven"]}
    return (
        f"pitch up to {of['pitch_deg'].max():.1f} degrees (median of the drives' largest "
        f"{np.median(of['pitch_deg']):.1f}), roll up to {of['roll_deg'].max():.1f} "
        f"({np.median(of['roll_deg']):.1f}), height from {100 * of['lowest_m'].min():+.1f} to "
        f"{100 * of['highest_m'].max():+.1f} cm"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--from", dest="first", type=int, default=0, help="number of the first")
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--rate-hz", type=float, default=10.0)
    parser.add_argument("--longest-m", type=float, default=LONGEST_M)
    parser.add_argument("--points", type=int, default=400)
    parser.add_argument("--camera", default="realistic", help="good, ideal, realistic or a YAML")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file to add results to, one JSON line each")
    arguments = parser.parse_args()
    settings = {
        "width": arguments.width, "rate_hz": arguments.rate_hz, "camera": arguments.camera,
        "points": arguments.points,
    }  # fmt: skip
    marked = {**settings, "longest_m": arguments.longest_m}
    done = read_done(arguments.out, marked) if arguments.out else {}
    numbers = range(arguments.first, arguments.first + arguments.drives)
    plans = [plan_of(number, arguments.longest_m) for number in numbers if number not in done]
    records = [done[number] for number in numbers if number in done]
    failures = []
    for record in run(drive, plans, settings, arguments.workers):
        (failures if "error" in record else records).append(record)
        say(record, len(records) + len(failures), len(numbers))
        if arguments.out:
            append_done(arguments.out, record, marked)
    if records:
        report(records)
    astray = sorted(record["number"] for record in records if not record["arrived"])
    if astray:
        print(f"did not arrive, and were judged by what they drove: {astray}")
    for record in failures:
        print(f"failed: {record['number']}: {record['error']}")
    sys.exit(0 if records else 1)


if __name__ == "__main__":
    main()
