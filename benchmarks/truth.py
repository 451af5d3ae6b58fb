# SPDX-License-Identifier: Apache-2.0
"""Is it the truth that is off? Two systems that share no code, each held against it and the other.

    python benchmarks/truth.py RECORDING... [--every N] [--apart K]

Prints the median error of the motion between pairs K apart, with the truth read at other times than
the pictures were taken, and how far along the path the systems are from the truth and from each
other, seen from the first pose. Nothing of it enters a figure of `odometry.py`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from decoded import decode, open_for_benchmark
from judge import truth_at
from odometry import run_in_child
from tables import markdown_table, number

from pilotage.evaluation.metrics import has_pose, relative_errors
from pilotage.evaluation.poses import inverse

Array = npt.NDArray[Any]
SYSTEMS = ("pilotage-patch", "opencv")
DELAYS_MS = (-10, -5, 0, 5, 10, 15, 20)
STATIONS = 10  # places along the path at which positions are compared


def trajectories(path: Path, every: int) -> tuple[dict[str, dict[str, Array]], Array, Any]:
    """Return what each system saved, the pairs' times (N,) in ns, and the recording."""
    recording = open_for_benchmark(path)
    with tempfile.TemporaryDirectory(prefix="pilotage-truth-") as scratch:
        pairs = decode(recording, Path(scratch) / "pairs.raw", every)
        runs = {system: run_in_child(path, system, pairs, Path(scratch)) for system in SYSTEMS}
    return runs, pairs.timestamps_ns, recording


def motion_errors(run: dict[str, Array], truth: Array, apart: int) -> Array:
    """Return the median errors, mm and degrees, of the motions between pairs `apart` of each other.

    Only motions within one segment of the trajectory count, and those that are no gross error.
    """
    poses, segment = run["final_poses"], run["final_segment"]
    known = has_pose(poses) & has_pose(truth)
    tied = known[:-apart] & known[apart:] & (segment[:-apart] == segment[apart:])
    start = np.flatnonzero(tied)
    errors = relative_errors(poses, truth, start, start + apart)
    errors = errors[errors[:, 0] < 0.05 * apart]
    return np.median(errors, axis=0) * (1e3, 180 / np.pi) if len(errors) else np.full(2, np.nan)


def clock_table(
    runs: dict[str, dict[str, Array]], times_ns: Array, recording: Any, apart: int
) -> str:
    """Return the errors of each system with the truth read later by each of `DELAYS_MS`."""
    rows = []
    for delay_ms in DELAYS_MS:
        truth = truth_at(recording, times_ns + delay_ms * 1_000_000)
        assert truth is not None
        errors = [motion_errors(runs[system], truth, apart) for system in SYSTEMS]
        rows.append([str(delay_ms), *(number(value) for pair in errors for value in pair)])
    titles = [f"{system} {unit}" for system in SYSTEMS for unit in ("mm", "degrees")]
    return markdown_table(["truth read later by ms", *titles], rows)


def positions(poses: Array) -> Array:
    """Return (N, 3) positions seen from the first pose."""
    return np.asarray((inverse(poses[0]) @ poses)[:, :3, 3])


def place_table(runs: dict[str, dict[str, Array]], truth: Array) -> str:
    """Return the differences of positions, metres, x right, y down, z ahead of the first pose."""
    true = positions(truth)
    ours, opencv = (positions(runs[system]["final_poses"]) for system in SYSTEMS)
    way_m = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(true, axis=0), axis=1))])
    rows = []
    for i in np.searchsorted(way_m, np.linspace(0, way_m[-1], STATIONS + 1)[1:-1]):
        differences = (ours[i] - true[i], opencv[i] - true[i], ours[i] - opencv[i])
        rows.append([number(way_m[i]), *(" ".join(f"{v:+.3f}" for v in d) for d in differences)])
    titles = [f"{SYSTEMS[0]} - truth", f"{SYSTEMS[1]} - truth", f"{SYSTEMS[0]} - {SYSTEMS[1]}"]
    return markdown_table(["way m", *titles], rows)


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING")
    parser.add_argument("--every", type=int, default=1, help="take each n-th pair only")
    parser.add_argument("--apart", type=int, default=1, help="pairs between which motion is judged")
    arguments = parser.parse_args()
    for path in arguments.recordings:
        runs, times_ns, recording = trajectories(path, arguments.every)
        truth = truth_at(recording, times_ns)
        if truth is None:
            print(f"{path.name}: no truth")
            continue
        print(f"\n{path.name}, motions between pairs {arguments.apart} apart")
        print(clock_table(runs, times_ns, recording, arguments.apart))
        if all(has_pose(run["final_poses"]).all() for run in runs.values()):
            print(f"\n{path.name}, positions seen from the first pose, m: x right, y down, z ahead")
            print(place_table(runs, truth))


if __name__ == "__main__":
    main()
