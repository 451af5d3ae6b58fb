# SPDX-License-Identifier: Apache-2.0
"""Reports drawn in a process of their own."""

from __future__ import annotations

from pathlib import Path


def draw_report(module: str, out: Path) -> str | None:
    """Let `module` draw the report of `out`; return a fault in a line, None where it is drawn.

    In a process of its own, as plotting needs more memory than what was run.
    """
    import subprocess
    import sys

    drawn = subprocess.run(
        [sys.executable, "-m", module, str(out)], capture_output=True, text=True, check=False
    )
    if drawn.returncode == 0:
        return None
    said = drawn.stderr.strip().splitlines()
    return said[-1] if said else f"exit code {drawn.returncode}"
