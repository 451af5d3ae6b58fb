# SPDX-License-Identifier: Apache-2.0
"""What a run amounted to: counts, costs, warnings; the content of summary.json."""

from __future__ import annotations

import resource
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotage import __version__
from pilotage.evaluation.verdict import calibration_words
from pilotage.pose_files import PoseRecord
from pilotage.provenance import program_commit
from pilotage.reasons import reason_remedy, reason_words
from pilotage.recordings.recording import SIMULATION, metadata_of

if TYPE_CHECKING:
    from pilotage import CalibrationCheck, StereoOdometry
    from pilotage.recordings.recording import BadFrame, Recording

# More unreadable pairs than this are counted but not listed.
LISTED_PAIRS = 100


@dataclass(frozen=True)
class Cost:
    """Seconds spent so far: CPU of the process (all threads), CPU of decoding, wall clock."""

    cpu_s: float
    decode_cpu_s: float
    wall_s: float

    @staticmethod
    def now(recording: Recording) -> Cost:
        """Return what has been spent up to this moment."""
        return Cost.of_all([recording])

    @staticmethod
    def of_all(recordings: Sequence[Recording]) -> Cost:
        """Return what has been spent up to this moment, decoding that of all together."""
        decode_cpu_s = sum(recording.decode_cpu_s for recording in recordings)
        return Cost(time.process_time(), decode_cpu_s, time.perf_counter())

    def since(self, start: Cost) -> Cost:
        """Return what was spent after `start`."""
        return Cost(
            self.cpu_s - start.cpu_s,
            self.decode_cpu_s - start.decode_cpu_s,
            self.wall_s - start.wall_s,
        )

    def per_pair_ms(self, pairs: int) -> dict[str, float]:
        """Return the costs of one pair; CPU without decoding, wall clock with everything."""
        each = 1e3 / max(pairs, 1)
        return {
            "cpu_ms_per_pair": (self.cpu_s - self.decode_cpu_s) * each,
            "decode_cpu_ms_per_pair": self.decode_cpu_s * each,
            "wall_ms_per_pair": self.wall_s * each,
        }


def summarize(  # noqa: PLR0913, all by name
    *,
    recording: Recording,
    odometry: StereoOdometry,
    records: Sequence[PoseRecord],
    skipped: Sequence[BadFrame],
    chosen: range,
    cost: Cost,
    peak_rss_mb: float,
    error: BaseException | None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the content of summary.json; see docs/results_folder.md.

    `warnings` are those of before the run.
    """
    summary: dict[str, Any] = {
        **describe_run(recording, chosen, error),
        "body": "left" if recording.rig.robot_from_left is None else "robot",
        **describe_tracking(records, skipped),
        **cost.per_pair_ms(len(records)),
        "adjustment_cpu_ms": odometry.adjustment_cpu_ms,
        "peak_rss_mb": peak_rss_mb,
        "calibration_check": describe_calibration(odometry.calibration_check()),
    }
    return {**summary, "warnings": [*warnings, *warnings_of(summary)]}


def describe_run(
    recording: Recording, chosen: range, error: BaseException | None
) -> dict[str, Any]:
    """Return which program ran on what, and how it ended."""
    is_interrupt = isinstance(error, KeyboardInterrupt)
    return {
        "version": __version__,
        "commit": program_commit(),
        "state": "finished" if error is None else "interrupted" if is_interrupt else "failed",
        "error": None if error is None or is_interrupt else str(error),
        "recording": {
            "name": recording.name,
            "path": str(recording.path),
            "pairs": len(recording),
            "start": chosen.start,
            "end": chosen.stop,
            "every": chosen.step,
            "simulated": _simulated(recording),
        },
    }


def _simulated(recording: Recording) -> str | None:
    """Return in a line with what a recording was simulated; None of a real one."""
    record = metadata_of(recording, SIMULATION)
    return None if record is None else record.get("words", "")


def peak_rss_mb() -> float:
    """Return the most memory this process has held, MB.

    Linux' own figure for the process: `getrusage` begins with what the parent held when it forked.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def settle(records: Sequence[PoseRecord], skipped: Sequence[BadFrame]) -> list[PoseRecord]:
    """Return `records` with the pairs that could not be read marked as such."""
    unreadable = {frame.index for frame in skipped}
    return [
        replace(record, status="skipped", reason="frames_missing")
        if record.index in unreadable
        else record
        for record in records
    ]


def describe_tracking(records: Sequence[PoseRecord], skipped: Sequence[BadFrame]) -> dict[str, Any]:
    """Return how many pairs came out how, and why; the four counts add up to `pairs`."""
    counts = Counter(record.status for record in records)
    return {
        "pairs": len(records),
        "tracked": counts["tracking"],
        "degraded": counts["degraded"],
        "lost": counts["lost"],
        "skipped": counts["skipped"],
        "lost_reasons": reasons_of(records, "lost"),
        "degraded_reasons": reasons_of(records, "degraded"),
        "skipped_pairs": [
            {"index": frame.index, "timestamp_ns": frame.timestamp_ns, "reason": frame.reason}
            for frame in skipped[:LISTED_PAIRS]
        ],
        "keyframes": sum(record.is_keyframe for record in records),
        "path_length_m": path_length_m(records),
    }


def path_length_m(records: Sequence[PoseRecord]) -> float:
    """Return the way between neighbouring poses, straight across gaps, 0 between segments."""
    known = [record for record in records if record.position_m is not None]
    positions = np.array([record.position_m for record in known], dtype=np.float64).reshape(-1, 3)
    tied = np.diff([record.segment for record in known]) == 0
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1)[tied].sum())


def describe_calibration(check: CalibrationCheck) -> dict[str, Any]:
    """Return the calibration check with the size and the significance of what it found."""
    found: dict[str, Any] = {"verdict": name_of(check.verdict)}
    for name in ("right_x_offset", "y_parallax"):
        value, sigma = getattr(check, f"{name}_px"), getattr(check, f"{name}_sigma_px")
        found |= {
            f"{name}_px": value,
            f"{name}_sigma_px": sigma,
            f"{name}_significance": abs(value) / sigma if sigma > 0 else None,
        }
    return {**found, "message": calibration_words(found)}


def warnings_of(summary: dict[str, Any]) -> list[str]:
    """Return what the user must know, one sentence or two each, the gravest first."""
    warnings = []
    check = summary["calibration_check"]
    if check["verdict"] == "inconsistent":
        warnings.append(f"The scale cannot be trusted. {check['message']}")
    if summary["state"] != "finished":
        told = f"The run was {summary['state']} after {summary['pairs']} pairs"
        warnings.append(f"{told}: {summary['error']}" if summary.get("error") else f"{told}.")
    for status, verb in (("lost", "Lost"), ("degraded", "Uncertain")):
        for reason, count in summary[f"{status}_reasons"].items():
            why = f"{verb} at {plural(count, 'pair')}: {reason_words(reason)}."
            warnings.append(f"{why} {reason_remedy(reason)}".rstrip())
    if summary["skipped"]:
        first = summary["skipped_pairs"][0]
        warnings.append(
            f"{plural(summary['skipped'], 'pair')} could not be read and left out, the first at"
            f" index {first['index']}: {first['reason']}"
        )
    return warnings


def reasons_of(records: Sequence[PoseRecord], status: str) -> dict[str, int]:
    """Return how often each reason was given for `status`, most frequent first."""
    return dict(
        Counter(record.reason for record in records if record.status == status).most_common()
    )


def plural(count: int, noun: str) -> str:
    """Return "1 pair", "2 pairs"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def name_of(value: Any) -> str:
    """Return the name of an enumeration's value; a string as it is."""
    return str(getattr(value, "name", value))
