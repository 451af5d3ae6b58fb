# SPDX-License-Identifier: Apache-2.0
"""One system over one recording in a process of its own, so that its memory can be told apart.

`odometry.py` starts this. Only the track calls are timed; pictures come decoded, pair by pair.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from decoded import DecodedPairs, load_pairs, open_for_benchmark

Array = npt.NDArray[Any]
SYSTEMS = ("pilotage-patch", "pilotage-paper", "opencv")
NO_POSE = np.full((4, 4), np.nan)
NO_COVARIANCE = np.full((6, 6), np.nan)


@dataclass(frozen=True)
class Outcome:
    """What a system says of one pair; pose (4, 4) and covariance (6, 6) are NaN when lost."""

    world_from_left: Array
    covariance: Array
    status: str
    reason: str = "none"
    segment: int = 0


class System(Protocol):
    """What is measured."""

    def track(self, left: Array, right: Array, timestamp_ns: int) -> Outcome:
        """Take the next pair."""

    def skip(self, timestamp_ns: int) -> Outcome:
        """Pass over a pair that could not be read."""

    def finish(self) -> list[Outcome] | None:
        """Return the outcomes after the last adjustment, None when there is none."""


class PilotageSystem:
    """Pilotage with one of its front ends."""

    def __init__(self, rig: Any, front_end: str, threads: int = 1) -> None:
        import pilotage

        config = pilotage.OdometryConfig.from_dict({"front_end": front_end, "threads": threads})
        self.odometry = pilotage.StereoOdometry(rig=rig, config=config)

    def track(self, left: Array, right: Array, timestamp_ns: int) -> Outcome:
        return _outcome(self.odometry.track(left, right, timestamp_ns))

    def skip(self, timestamp_ns: int) -> Outcome:
        return _outcome(self.odometry.skip(timestamp_ns))

    def finish(self) -> list[Outcome] | None:
        return [_outcome(result) for result in self.odometry.finish()]


class OpencvSystem:
    """The plain OpenCV pipeline, on one thread: all threads' time is counted anyway."""

    def __init__(self, rig: Any) -> None:
        import cv2
        from opencv_odometry import OpencvOdometry

        cv2.setNumThreads(1)
        self.odometry = OpencvOdometry(rig)

    def track(self, left: Array, right: Array, timestamp_ns: int) -> Outcome:
        pose = self.odometry.track(left, right)
        if pose is None:
            return Outcome(NO_POSE, NO_COVARIANCE, "lost", "too_few_points")
        return Outcome(pose, NO_COVARIANCE, "tracking")

    def skip(self, timestamp_ns: int) -> Outcome:
        return Outcome(NO_POSE, NO_COVARIANCE, "lost", "frames_missing")

    def finish(self) -> list[Outcome] | None:
        return None


def _outcome(result: Any) -> Outcome:
    if result.world_from_left is None:
        return Outcome(
            NO_POSE, NO_COVARIANCE, result.status.name, result.reason.name, result.segment
        )
    return Outcome(
        np.asarray(result.world_from_left.matrix()),
        np.asarray(result.covariance),
        result.status.name,
        result.reason.name,
        result.segment,
    )


def make_system(name: str, rig: Any) -> System:
    """Return a system by its name, one of `SYSTEMS`."""
    if name == "opencv":
        return OpencvSystem(rig)
    return PilotageSystem(rig, name.removeprefix("pilotage-"))


def run(path: Path, system_name: str, pairs: DecodedPairs) -> dict[str, Array]:
    """Return what one run gave: poses, costs and memory, as arrays to be saved."""
    system = make_system(system_name, open_for_benchmark(path).rig)
    live, costs = [], []
    for i, timestamp_ns in enumerate(pairs.timestamps_ns.tolist()):
        pictures = pairs.pair(i)
        cpu, wall = time.process_time(), time.perf_counter()
        if pictures is None:
            live.append(system.skip(timestamp_ns))
        else:
            live.append(system.track(*pictures, timestamp_ns))
        costs.append((time.process_time() - cpu, time.perf_counter() - wall))
    cpu = time.process_time()
    final = system.finish()
    finish_cpu_ms = 1e3 * (time.process_time() - cpu)
    return {
        "costs_ms": 1e3 * np.array(costs).reshape(-1, 2),
        "finish_cpu_ms": np.array(finish_cpu_ms),
        "peak_mb": np.array(memory_mb("VmHWM")),
        "check": np.array(_calibration_check(system)),
        **_columns("live", live),
        **_columns("final", live if final is None else final),
    }


def _columns(prefix: str, outcomes: list[Outcome]) -> dict[str, Array]:
    return {
        f"{prefix}_poses": np.array([o.world_from_left for o in outcomes]),
        f"{prefix}_covariances": np.array([o.covariance for o in outcomes]),
        f"{prefix}_status": np.array([o.status for o in outcomes]),
        f"{prefix}_reason": np.array([o.reason for o in outcomes]),
        f"{prefix}_segment": np.array([o.segment for o in outcomes]),
    }


def _calibration_check(system: System) -> str:
    """Return the verdict on the rig as JSON; empty where the system gives none."""
    odometry = getattr(system, "odometry", None)
    if not hasattr(odometry, "calibration_check"):
        return "{}"
    check = odometry.calibration_check()
    return json.dumps(
        {
            "verdict": check.verdict.name,
            "right_x_offset_px": check.right_x_offset_px,
            "right_x_offset_sigma_px": check.right_x_offset_sigma_px,
        }
    )


def memory_mb(key: str) -> float:
    """Return VmRSS (now) or VmHWM (peak) of this process.

    Not ru_maxrss: it keeps the size of the parent from before exec.
    """
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return float(line.split()[1]) / 1024
    return float("nan")


def main() -> int:
    """Run one system and save what it did."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--system", choices=SYSTEMS, default=SYSTEMS[0])
    parser.add_argument("--pairs", type=Path, required=True, help="what decoded.decode wrote")
    parser.add_argument("-o", "--out", type=Path, required=True)
    arguments = parser.parse_args()
    pairs = load_pairs(arguments.pairs)
    np.savez(arguments.out, **run(arguments.recording, arguments.system, pairs))
    return 0


if __name__ == "__main__":
    sys.exit(main())
