# SPDX-License-Identifier: Apache-2.0
"""Run `pilotage localize` on every stereo recording of a data folder and tabulate the results.

    python benchmarks/every_recording.py [FOLDER] [--markdown table.md]

FOLDER defaults to $PILOTAGE_DATA. Folders that hold no stereo recording are named with the reason;
a stereo pair that is known with its true disparity is checked for depth. Exit 1 when a recording
does not run to its end.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from decoded import DATA_FOLDER, open_for_benchmark, stand_in_calibration
from judge import judge, truth_at
from one_pair import middlebury_figures
from tables import markdown_table, number

from pilotage.evaluation.truth import poses_of
from pilotage.pose_files import PoseRecord, read_pose_table
from pilotage.results import POSES, POSES_LIVE, SUMMARY

SINGLE_CAMERA = "a single camera: reconstruction, not stereo odometry"
NOT_STEREO = {
    "lund_door": SINGLE_CAMERA,
    "nao_marks": "two cameras that do not overlap: marks, not stereo odometry",
    "nao_walk": SINGLE_CAMERA,
    "strecha_fountain": SINGLE_CAMERA,
    "strecha_herzjesu": SINGLE_CAMERA,
    "textures": "photographs of surfaces: material for the simulator",
}
ONE_PAIR = "middlebury_motorcycle"
TITLES = {
    "recording": "recording",
    "exit": "exit",
    "pairs": "pairs",
    "lost": "lost",
    "degraded": "degraded",
    "segment_percent": "segments %",
    "ate_m": "ATE m",
    "scale": "scale",
    "steps_solved": "steps solved",
    "step_median_m": "median step error m",
    "cpu_ms_per_pair": "CPU-ms/pair",
    "adjustment_cpu_ms": "final CPU-ms",
    "peak_rss_mb": "peak MB",
    "verdict": "calibration",
}


def localize_command(recording: Path, out: Path, settings: Sequence[str] = ()) -> list[str]:
    """Return the command that localizes a recording, with our calibration if it has none."""
    command = [sys.executable, "-m", "pilotage.cli.main", "localize", str(recording)]
    command += ["-o", str(out), "--no-report"]
    stand_in = stand_in_calibration(recording)
    if stand_in is not None:
        command += ["--calibration", str(stand_in)]
    for setting in settings:
        command += ["--set", setting]
    return command


def run_one(recording: Path, out: Path, settings: Sequence[str]) -> tuple[dict[str, Any], str]:
    """Return the figures of one recording and what `pilotage localize` said last."""
    done = subprocess.run(
        localize_command(recording, out, settings), capture_output=True, text=True, check=False
    )
    said = (done.stdout + done.stderr).strip().splitlines()
    row: dict[str, Any] = {"recording": recording.name, "exit": float(done.returncode)}
    if (out / SUMMARY).is_file() and (out / POSES).is_file():
        summary = json.loads((out / SUMMARY).read_text())
        costs = ("pairs", "degraded", "cpu_ms_per_pair", "adjustment_cpu_ms", "peak_rss_mb")
        row |= {key: float(summary[key]) for key in costs}
        row["verdict"] = summary["calibration_check"]["verdict"]
        row |= figures_of_results(recording, out)
    return row, said[-1] if said else "said nothing"


def figures_of_results(recording: Path, out: Path) -> dict[str, float]:
    """Judge a results folder by the recording's truth."""
    live, final = read_pose_table(out / POSES_LIVE), read_pose_table(out / POSES)
    opened = open_for_benchmark(recording)
    truth = truth_at(opened, np.array([record.timestamp_ns for record in final]))
    # The verdict on the calibration stands in the summary already.
    run = {**_columns("live", live), **_columns("final", final), "check": "{}"}
    return judge(recording.resolve().name, run, truth)


def _columns(prefix: str, records: Sequence[PoseRecord]) -> dict[str, Any]:
    unknown = np.full((6, 6), np.nan)
    return {
        f"{prefix}_poses": poses_of(records),
        f"{prefix}_status": np.array([record.status for record in records]),
        f"{prefix}_segment": np.array([record.segment for record in records]),
        f"{prefix}_covariances": np.array(
            [unknown if r.covariance is None else r.covariance for r in records]
        ),
    }


def run_all(folder: Path, settings: Sequence[str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return a row per stereo recording, and a line per folder that is none."""
    rows, others = [], []
    for path in sorted(p for p in folder.iterdir() if p.is_dir()):
        if path.name in NOT_STEREO:
            others.append(f"- `{path.name}`: not run, {NOT_STEREO[path.name]}.")
        elif path.name == ONE_PAIR:
            others.append(f"- `{path.name}`: {middlebury_figures(path)}.")
        else:
            with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
                row, said = run_one(path, Path(scratch) / "out", settings)
            rows.append(row)
            print(f"{path.name}: exit {row['exit']:.0f}: {said}", flush=True)
    for line in others:
        print(line.removeprefix("- "))
    return rows, others


def main() -> int:
    """Run all, print, and write the table."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=DATA_FOLDER, metavar="FOLDER")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    parser.add_argument("--markdown", type=Path, help="write the table to this file")
    arguments = parser.parse_args()
    if not arguments.folder.is_dir():
        print(f"{arguments.folder}: no such folder; set PILOTAGE_DATA", file=sys.stderr)
        return 2
    rows, others = run_all(arguments.folder, arguments.settings)
    cells = [[_cell(row.get(key)) for key in TITLES] for row in rows]
    table = markdown_table(list(TITLES.values()), cells)
    text = "\n".join([table, "", *others])
    print("\n" + text)
    if arguments.markdown:
        arguments.markdown.write_text(text + "\n")
    return int(any(row["exit"] != 0 for row in rows))


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else number(value)


if __name__ == "__main__":
    sys.exit(main())
