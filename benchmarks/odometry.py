# SPDX-License-Identifier: Apache-2.0
"""Compare Pilotage with a plain OpenCV pipeline on the same pictures in one run.

    python benchmarks/odometry.py [RECORDING...] [--every N] [--front-end patch|paper|both]

Without RECORDING: every one in $PILOTAGE_DATA that has a goal, and each third pair where that has.
Prints error, cost and memory of each system, their ratio, and which goals are reached. Times are
the least of `--repeats` interleaved runs, each in a process of its own: what else runs on the
machine only ever adds.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from decoded import DATA_FOLDER, DecodedPairs, decode, open_for_benchmark
from judge import GOALS, judge, truth_at
from tables import markdown_table, number

from pilotage.errors import InputError
from pilotage.results import write_json

COLUMNS = {
    "recording": "recording",
    "system": "system",
    "segment_percent": "segments %",
    "ate_m": "ATE m",
    "ate_live_m": "live ATE m",
    "scale": "scale",
    "lost": "lost",
    "cpu_ms": "CPU-ms/pair",
    "finish_cpu_ms": "final CPU-ms",
    "wall_ms": "wall-ms/pair",
    "peak_mb": "peak MB",
    "cpu_ratio": "OpenCV/this",
}
MORE_COLUMNS = {
    "recording": "recording",
    "system": "system",
    "steps_solved": "steps solved",
    "steps_wrong": "wrong",
    "step_median_m": "median step error m",
    "step_max_m": "largest m",
    "rest_m": "off first pose, at most m",
    "nees_mean": "NEES (6)",
    "nees_share": "within 99 %",
    "confidently_wrong": "confidently wrong",
    "alarm": "calibration alarm",
    "lost_reasons": "lost because",
}


def measure(
    path: Path, systems: Sequence[str], *, every: int, repeats: int, limit: int | None
) -> list[dict[str, Any]]:
    """Return a row of figures per system for one recording."""
    recording = open_for_benchmark(path)
    name = path.resolve().name
    with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
        pairs = decode(recording, Path(scratch) / "pairs.raw", every, limit)
        runs: dict[str, list[dict[str, Any]]] = {system: [] for system in systems}
        for _ in range(repeats):
            for system in systems:
                runs[system].append(run_in_child(path, system, pairs, Path(scratch)))
    truth = truth_at(recording, pairs.timestamps_ns)
    label = name if every == 1 else f"{name} /{every}"
    rows = [
        {
            "recording": label,
            "name": name,
            "every": every,
            "system": system,
            "pairs": len(pairs),
            "lost_reasons": lost_reasons(repeated[0]),
            **judge(name, repeated[0], truth),
            **costs(repeated),
        }
        for system, repeated in runs.items()
    ]
    return with_ratio(rows)


def run_in_child(path: Path, system: str, pairs: DecodedPairs, scratch: Path) -> dict[str, Any]:
    """Run one system in a process of its own and return what it saved."""
    out = scratch / "run.npz"
    script = Path(__file__).with_name("run_system.py")
    command = [sys.executable, str(script), str(path), "--system", system]
    # Threads of numpy's algebra spin for a while after their start, in either system's account.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    arguments = ["--pairs", str(pairs.path), "-o", str(out)]
    subprocess.run([*command, *arguments], check=True, env=environment)
    with np.load(out) as saved:
        return dict(saved)


def costs(runs: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the least time and the largest memory of the repeats, ms a pair."""
    return {
        "cpu_ms": min(float(run["costs_ms"][:, 0].mean()) for run in runs),
        "wall_ms": min(float(run["costs_ms"][:, 1].mean()) for run in runs),
        "slowest_pair_ms": min(float(run["costs_ms"][:, 1].max()) for run in runs),
        "finish_cpu_ms": min(float(run["finish_cpu_ms"]) for run in runs),
        "peak_mb": max(float(run["peak_mb"]) for run in runs),
    }


def lost_reasons(run: dict[str, Any]) -> str:
    """Return the reasons given for lost pairs with their numbers, the most frequent first."""
    reasons = Counter(run["live_reason"][run["live_status"] == "lost"].tolist())
    return ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())


def with_ratio(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add how many times more CPU the OpenCV pipeline took than each other system."""
    opencv = next((row["cpu_ms"] for row in rows if row["system"] == "opencv"), math.nan)
    return [
        row if row["system"] == "opencv" else {**row, "cpu_ratio": opencv / row["cpu_ms"]}
        for row in rows
    ]


def goal_rows(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return a line per goal and Pilotage system: figure, goal, PASS or MISS."""
    lines = []
    for row in rows:
        if row["system"] == "opencv":
            continue
        for goal in GOALS:
            if goal.recording != row["name"] or goal.every != row["every"]:
                continue
            met = goal.is_met(row)
            verdict = "not measured" if met is None else "PASS" if met else "MISS"
            value = number(row.get(goal.key, math.nan))
            wanted = f"{goal.sense} {goal.limit:g}"
            lines.append([row["recording"], row["system"], goal.key, value, wanted, verdict])
    return lines


def print_tables(rows: Sequence[dict[str, Any]]) -> None:
    """Print figures, the finer figures, and the goals."""
    for columns in (COLUMNS, MORE_COLUMNS):
        cells = [[_cell(row, key) for key in columns] for row in rows]
        print("\n" + markdown_table(list(columns.values()), cells))
    goals = goal_rows(rows)
    if goals:
        titles = ["recording", "system", "figure", "measured", "goal", "verdict"]
        print("\n" + markdown_table(titles, goals))


def _cell(row: dict[str, Any], key: str) -> str:
    value = row.get(key, math.nan)
    return value if isinstance(value, str) else number(value)


def chosen_systems(front_end: str) -> list[str]:
    """Return the systems to run, in the order in which they take turns."""
    front_ends = ["patch", "paper"] if front_end == "both" else [front_end]
    return [*(f"pilotage-{name}" for name in front_ends), "opencv"]


def parse_arguments() -> argparse.Namespace:
    """Return the command line's choices."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", type=Path, nargs="*", metavar="RECORDING")
    parser.add_argument("--every", type=int, default=1, help="take each n-th pair only")
    parser.add_argument("--front-end", choices=["patch", "paper", "both"], default="patch")
    parser.add_argument("--repeats", type=int, default=3, help="interleaved runs (default 3)")
    parser.add_argument("--limit", type=int, help="take at most so many pairs")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    return parser.parse_args()


def jobs(recordings: Sequence[Path], every: int) -> list[tuple[Path, int]]:
    """Return which recordings to run, each with the n of every n-th pair."""
    if recordings:
        return [(path, every) for path in recordings]
    return list(dict.fromkeys((DATA_FOLDER / goal.recording, goal.every) for goal in GOALS))


def main() -> int:
    """Measure, print, and save; misses are told, not an error."""
    arguments = parse_arguments()
    rows: list[dict[str, Any]] = []
    try:
        for path, every in jobs(arguments.recordings, arguments.every):
            print(f"{path.name} /{every}: running", file=sys.stderr, flush=True)
            rows += measure(
                path,
                chosen_systems(arguments.front_end),
                every=every,
                repeats=arguments.repeats,
                limit=arguments.limit,
            )
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print_tables(rows)
    if arguments.json:
        write_json(arguments.json, {"runs": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
