# SPDX-License-Identifier: Apache-2.0
"""Tell whether memory stays flat over a long run.

    python benchmarks/memory.py RECORDING [--pairs 10000]

Plays a recording forwards and backwards until so many pairs have been tracked, prints resident
memory on the way, and says flat or growing by the slope of its second half. Exit 1 when it grows or
its peak passes the goal.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from decoded import decode, open_for_benchmark
from run_system import SYSTEMS, make_system, memory_mb

PEAK_GOAL_MB = 150.0
# What a run must keep of every pair (pose, covariance, status) stays well below this.
FLAT_KB_PER_PAIR = 1.0


def there_and_back(count: int, total: int) -> Iterator[int]:
    """Yield `total` picture numbers 0, 1 .. count - 1, count - 2 .. 0, 1 .."""
    lap = [*range(count), *range(count - 2, 0, -1)] or [0]
    return (lap[i % len(lap)] for i in range(total))


def replay(path: Path, system_name: str, total: int, report_every: int) -> list[tuple[int, float]]:
    """Track `total` pairs and return (pairs, resident MB) on the way, printing each."""
    samples: list[tuple[int, float]] = []
    recording = open_for_benchmark(path)
    with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
        pairs = decode(recording, Path(scratch) / "pairs.raw")
        system = make_system(system_name, recording.rig)
        lost, begin_s = 0, time.process_time()
        for done, i in enumerate(there_and_back(len(pairs), total), start=1):
            timestamp_ns = done * 100_000_000
            pictures = pairs.pair(i)
            if pictures is None:
                outcome = system.skip(timestamp_ns)
            else:
                outcome = system.track(*pictures, timestamp_ns)
            lost += outcome.status == "lost"
            if done % report_every == 0 or done == total:
                samples.append((done, memory_mb("VmRSS")))
                cpu_ms = 1e3 * (time.process_time() - begin_s) / done
                line = f"{done:6d} pairs  {samples[-1][1]:7.1f} MB  {cpu_ms:6.1f} CPU-ms/pair"
                print(f"{line}  {lost} lost", flush=True)
        before_finish_mb = memory_mb("VmHWM")
        begin_s = time.process_time()
        system.finish()
        print(f"peak {before_finish_mb:.1f} MB before the last adjustment, ", end="")
        print(f"{memory_mb('VmHWM'):.1f} MB with it ({time.process_time() - begin_s:.1f} CPU-s)")
    return samples


def slope_kb_per_pair(samples: list[tuple[int, float]]) -> float:
    """Return the growth over the second half of the run; NaN for fewer than two samples there."""
    late = np.array(samples[len(samples) // 2 :])
    if len(late) < 2:
        return math.nan
    return float(np.polyfit(late[:, 0], late[:, 1] * 1024, 1)[0])


def main() -> int:
    """Replay, print, and judge."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path, metavar="RECORDING")
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--system", choices=SYSTEMS, default=SYSTEMS[0])
    parser.add_argument("--report-every", type=int, default=500)
    arguments = parser.parse_args()
    samples = replay(arguments.recording, arguments.system, arguments.pairs, arguments.report_every)
    slope = slope_kb_per_pair(samples)
    peak_mb = memory_mb("VmHWM")
    flat = not slope > FLAT_KB_PER_PAIR
    verdict = "flat" if flat else "growing"
    print(f"{verdict}: {slope:.3f} kB a pair; peak {peak_mb:.1f} MB, goal {PEAK_GOAL_MB:.0f} MB")
    return 0 if flat and peak_mb <= PEAK_GOAL_MB else 1


if __name__ == "__main__":
    sys.exit(main())
