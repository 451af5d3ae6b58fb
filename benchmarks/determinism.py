# SPDX-License-Identifier: Apache-2.0
"""Tell whether two runs, and runs on one and two threads, write identical bytes.

    python benchmarks/determinism.py RECORDING... [--set KEY=VALUE]

Runs `pilotage localize` three times on each recording and compares every trajectory file and the
cloud. Exit 1 when one differs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from every_recording import localize_command

from pilotage.results import CLOUD, KITTI, POSES, POSES_LIVE, TUM, TUM_LIVE

COMPARED = (TUM, KITTI, TUM_LIVE, POSES, POSES_LIVE, CLOUD)
RUNS = {"first": 1, "again": 1, "two threads": 2}


def differing_files(recording: Path, settings: Sequence[str], scratch: Path) -> list[str]:
    """Return "file (run)" for every file that is not as in the first run."""
    for name, threads in RUNS.items():
        out = scratch / name
        command = localize_command(recording, out, [*settings, f"threads={threads}"])
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    first, *others = RUNS
    return [
        f"{file} ({name})"
        for name in others
        for file in COMPARED
        if (scratch / name / file).read_bytes() != (scratch / first / file).read_bytes()
    ]


def main() -> int:
    """Compare, and say which files differ."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings")
    arguments = parser.parse_args()
    differs = False
    for recording in arguments.recordings:
        with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
            files = differing_files(recording, arguments.settings, Path(scratch))
        differs |= bool(files)
        verdict = "differ: " + ", ".join(files) if files else "identical bytes"
        print(f"{recording.name}: {len(RUNS)} runs, {len(COMPARED)} files each, {verdict}")
    return int(differs)


if __name__ == "__main__":
    sys.exit(main())
