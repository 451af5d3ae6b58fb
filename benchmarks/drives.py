# SPDX-License-Identifier: Apache-2.0
# Long: plan, drive, judgement and table of one benchmark, which nothing else uses.
"""How far off are the trajectories after simulated drives, over many worlds?

    python benchmarks/drives.py --drives 200 --out drives.jsonl
    python benchmarks/drives.py --drives 20 --width 240 --rate-hz 5 --longest-m 15    # as in CI

Each drive has a yard of its own (five grounds in turn, flat or with relief), a closed or open path
of 5 to 50 m, a speed, and cameras that do wrong what real ones do: one pair looks ahead, one down.
In every fifth drive one of the pairs is blinded, smeared, out of step or tilted from half-way on.
Printed is what each pair gives alone, and both joined. Drives do not depend on each other or on how
many there are; those that --out holds already are not driven again, so that an interrupted run goes
on where it was. --from and --drives drive a piece of the whole.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from chance import largest_by_chance, mean_beside_luckier
from simulated_drives import append_done, read_done, run, shots_of

from pilotage import Status, StereoOdometry, _core
from pilotage.behaviors.pair_track import Tracked, in_order
from pilotage.calibration.rig_calibration import looks_down
from pilotage.config import UserConfig
from pilotage.evaluation.metrics import evaluate_trajectory, nees
from pilotage.simulation import Drive, Fault, Simulation, load_world, robot_model
from pilotage.simulation.camera_faults import written_rig
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.grounds import GROUNDS
from pilotage.simulation.sensor import read_sensor
from pilotage.simulation.yard import YardOptions, side_for_m

ROBOT, PAIRS = "rover", ("front", "down")
SHAPES = ("closed", "open", "square", "straight", "eight")
SHORTEST_M, LONGEST_M = 5.0, 50.0
SPOILT_EVERY = 5
# Name and size of what happens to one pair half-way; a size of its own for each unit.
SPOILS = (("blind", 1.0), ("dirt", 0.7), ("out_of_step_ms", 40.0), ("tilt_right", 4.0))
JOINT = "joint"


@dataclass(frozen=True)
class DrivePlan:
    """One drive; all of it follows from its number."""

    number: int
    seed: int
    ground: str
    path: str
    relief_m: float
    speed_m_s: float
    spoilt: str = ""  # fault and pair
    spoil_size: float = 0.0
    spoil_onset_s: float = 0.0


def plan_of(number: int, longest_m: float) -> DrivePlan:
    random = np.random.default_rng([20261122, number])
    length_m = round(float(np.exp(random.uniform(np.log(SHORTEST_M), np.log(longest_m)))), 1)
    plan = DrivePlan(
        number=number,
        seed=1000 + number,
        ground=list(GROUNDS)[number % len(GROUNDS)],
        path=f"{SHAPES[number // len(GROUNDS) % len(SHAPES)]}-{length_m:g}m",
        relief_m=round(float(random.choice([0.0, random.uniform(0.02, 0.10)])), 3),
        speed_m_s=round(float(random.uniform(0.25, 0.6)), 2),
    )
    # The fourth of each five, and not always on the same ground.
    turn = number // SPOILT_EVERY
    if (number + turn) % SPOILT_EVERY != SPOILT_EVERY - 1:
        return plan
    (fault, size), pair = SPOILS[turn % len(SPOILS)], PAIRS[turn // len(SPOILS) % len(PAIRS)]
    onset_s = round(0.5 * length_m / plan.speed_m_s, 1)
    return replace(plan, spoilt=f"{fault} {pair}", spoil_size=size, spoil_onset_s=onset_s)


def simulation_of(plan: DrivePlan) -> Simulation:
    options = {
        "ground": plan.ground,
        "path": plan.path,
        "relief_m": plan.relief_m,
        "size_m": max(YardOptions.size_m, side_for_m(plan.path)),
    }
    faults = []
    if plan.spoilt:
        name, pair = plan.spoilt.split()
        faults = [Fault(name, onset_s=plan.spoil_onset_s, size=plan.spoil_size, camera=pair)]
    world = load_world("yard", seed=plan.seed, options=options)
    return Simulation(world, ROBOT, seed=plan.seed, faults=faults)


@dataclass
class Track:
    """What came of a drive: times, results or joint results, and the robot's true poses then."""

    live: list[Any]
    final: list[Any]
    truth: np.ndarray[Any, Any]
    cpu_s: float = 0.0


def track(
    plan: DrivePlan, *, width: int, rate_hz: float, camera: str, points: int
) -> tuple[dict[str, Track], bool]:
    """Drive and track every pair that comes; return what each pair saw and if the drive arrived."""
    simulation, robot = simulation_of(plan), robot_model(ROBOT)
    sensor = read_sensor(camera)
    rigs = robot.stereo_rigs(simulation, width, PAIRS, sensor.readout_s)
    groups = camera_groups(simulation, robot.pair_lenses(rigs), sensor, seed=plan.seed)
    config = UserConfig(shared={"points": points})
    odometries = {
        pair: StereoOdometry(
            rig=written_rig(rigs[pair], simulation.faults, pair),
            config=config.odometry(pair, is_downward=looks_down(pair, rigs[pair])),
        )
        for pair in PAIRS
    }
    poses: dict[str, list[Any]] = {pair: [] for pair in PAIRS}
    tracks = {pair: Track([], [], np.empty((0, 4, 4))) for pair in PAIRS}
    way = Drive(simulation, plan.path, speed_m_s=plan.speed_m_s)
    for shot in shots_of(way, simulation, robot, groups, rate_hz=rate_hz):
        began = time.process_time()
        result = odometries[shot.pair].track(shot.left, shot.right, shot.stamp_ns)
        tracks[shot.pair].cpu_s += time.process_time() - began
        tracks[shot.pair].live.append(result)
        poses[shot.pair].append(shot.world_from_robot.matrix())
    for pair, odometry in odometries.items():
        tracks[pair].final = odometry.finish()
        tracks[pair].truth = np.array(poses[pair])
    return tracks, way.has_arrived


def join(tracks: dict[str, Track], keys: list[str], judge: _core.Judge) -> list[Any]:
    """Return what a judge makes of the results of all pairs: of each `live` or `final`."""
    joint = [said for one in merged(tracks, keys) for said in judge.add(one.pair, one.result)]
    return joint + judge.finish()


def merged(tracks: dict[str, Track], keys: list[str]) -> list[Tracked]:
    """Return the results of all pairs, of each `live` or `final`, in order of time."""
    chosen = [getattr(of_pair, key) for of_pair, key in zip(tracks.values(), keys, strict=True)]
    return list(
        in_order(
            [
                [Tracked(pair, index, result) for index, result in enumerate(results)]
                for pair, results in enumerate(chosen)
            ]
        )
    )


def truth_at(times_ns: list[int], tracks: dict[str, Track]) -> np.ndarray[Any, Any]:
    """Return the true poses (N, 4, 4) of the pictures nearest in time."""
    known = merged(tracks, ["live"] * len(tracks))
    truths = [track.truth for track in tracks.values()]
    stamps = np.array([one.result.timestamp_ns for one in known])
    after = np.clip(np.searchsorted(stamps, times_ns), 1, len(stamps) - 1)
    is_before = np.abs(stamps[after - 1] - times_ns) < np.abs(stamps[after] - times_ns)
    places = np.where(is_before, after - 1, after)
    return np.array([truths[known[p].pair][known[p].index] for p in places])


def figures(results: list[Any], truth: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return the figures of one trajectory."""
    unknown = np.full((4, 4), np.nan)
    poses = [
        getattr(r, "world_from_robot", None) or getattr(r, "world_from_left", None) for r in results
    ]
    estimate = np.array([unknown if pose is None else pose.matrix() for pose in poses])
    covariances = covariances_of(results)
    metrics = evaluate_trajectory(estimate=estimate, truth=truth, covariances=covariances)
    says_tracking = np.array([r.status == Status.tracking for r in results])
    squares = nees(estimate, truth, covariances)
    limit = largest_by_chance(len(squares))
    return {
        "pairs": metrics.pairs,
        "lost": metrics.lost,
        "length_m": metrics.truth_length_m,
        "end_m": metrics.end_error_m,
        "end_percent": metrics.end_error_percent,
        "ate_percent": metrics.ate_percent_of_length,
        "segment_percent": metrics.translation_percent,
        "scale": metrics.scale,
        "nees": metrics.consistency.mean_nees if metrics.consistency else None,
        "confidently_wrong": int(np.sum(says_tracking & (squares > limit))),
    }


def drive(plan: DrivePlan, **settings: Any) -> dict[str, Any]:
    """Return the figures of one drive: each pair's adjusted trajectory, joint live and adjusted."""
    start = time.process_time()
    tracks, has_arrived = track(plan, **settings)
    record = {**asdict(plan), "arrived": has_arrived}
    for pair, one in tracks.items():
        record[pair] = figures(one.final, one.truth)
        record[pair]["cpu_ms"] = 1e3 * one.cpu_s / max(1, len(one.live))
    judge, aside = _core.Judge(pairs=len(tracks)), [False] * len(tracks)
    for name, keys in ((f"{JOINT} live", ("live", "live")), (JOINT, ("final", "live"))):
        joint = join(tracks, [keys[is_aside] for is_aside in aside], judge)
        judge, aside = judge.again(), judge.set_aside()
        record[name] = figures(joint, truth_at([r.timestamp_ns for r in joint], tracks))
        record[name]["disputed"] = sum(
            any(verdict.belief == _core.Belief.disagrees for verdict in r.pairs) for r in joint
        )
    record["cpu_s"] = time.process_time() - start
    return record


def covariances_of(results: list[Any]) -> np.ndarray[Any, Any]:
    unknown = np.full((6, 6), np.nan)
    return np.array([unknown if r.covariance is None else r.covariance for r in results])


def say(record: dict[str, Any], count: int, total: int) -> None:
    if "error" in record:
        text = record["error"]
    else:
        ends = ", ".join(f"{name} {record[name]['end_percent']:.3f}" for name in (*PAIRS, JOINT))
        text = f"end {ends} %, {record[JOINT]['lost']} lost, {record['cpu_s']:.0f} CPU-s"
    what = " ".join((record["ground"], record["path"], record["spoilt"])).strip()
    print(f"[{count}/{total}] {record['number']:3d} {what}: {text}", file=sys.stderr, flush=True)


def row(name: str, records: list[dict[str, Any]], source: str) -> str:
    """Return the line of the table for what one pair, or both, made of these drives."""

    def of(key: str) -> np.ndarray[Any, Any]:
        values = [record[source][key] for record in records]
        return np.array([np.nan if value is None else value for value in values], float)

    def quantiles(key: str) -> str:
        values = of(key)[np.isfinite(of(key))]
        return " | ".join(f"{np.quantile(values, q):.3f}" for q in (0.5, 0.95, 1.0))

    return (
        f"| {name} | {source} | {len(records)} | {quantiles('end_percent')} | "
        f"{quantiles('ate_percent')} | {np.nanmedian(of('scale')):.4f} | "
        f"{of('lost').sum():.0f} of {of('pairs').sum():.0f} | {np.nanmedian(of('nees')):.1f} | "
        f"{of('confidently_wrong').sum():.0f} |"
    )


def report(records: list[dict[str, Any]]) -> None:
    print(
        "| drives | trajectory | number | error at the end, %: median | 95th | largest | "
        "ATE, %: median | 95th | largest | scale | lost | NEES, median | confidently wrong |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|"
    )
    sound = [record for record in records if not record["spoilt"]]
    kinds = {"all": records}
    kinds |= {ground: [r for r in sound if r["ground"] == ground] for ground in GROUNDS}
    kinds["flat"] = [record for record in sound if record["relief_m"] == 0]
    kinds["with relief"] = [record for record in sound if record["relief_m"] > 0]
    kinds["sound"] = sound
    kinds["spoilt half-way"] = [record for record in records if record["spoilt"]]
    for name, some in kinds.items():
        for source in (*PAIRS, JOINT, f"{JOINT} live") if some else ():
            print(row(name, some, source))
    report_better(sound)


def report_better(records: list[dict[str, Any]]) -> None:
    """Print how the joint trajectory stands to the better of those alone, drive by drive."""
    if not records:
        return
    for key in ("end_percent", "ate_percent"):
        ratios = np.array(
            [r[JOINT][key] / min(r[pair][key] for pair in PAIRS) for r in records], float
        )
        medians = [np.median([r[pair][key] for r in records]) for pair in PAIRS]
        joint = np.median([r[JOINT][key] for r in records])
        print(
            f"{key}: joint over the better of the two in each sound drive: median "
            f"{np.median(ratios):.2f}, above 1.10 in {np.sum(ratios > 1.1)} of {len(ratios)}; "
            f"median of all over the better median {joint / min(medians):.2f}"
        )
        if key == "end_percent":
            by_chance = mean_beside_luckier(max(medians) / min(medians), 1.1)
            print(
                "  with independent normal errors and covariances known exactly their mean would "
                f"be above 1.10 in {by_chance * len(ratios):.0f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--from", dest="first", type=int, default=0, help="number of the first")
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--rate-hz", type=float, default=10.0)
    parser.add_argument("--longest-m", type=float, default=LONGEST_M)
    parser.add_argument("--points", type=int, default=400, help="of each pair")
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
    astray = [record["number"] for record in records if not record["arrived"]]
    if astray:
        print(f"did not arrive, and were judged by what they drove: {astray}")
    for record in failures:
        print(f"failed: {record['number']}: {record['error']}")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
