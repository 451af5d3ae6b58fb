# SPDX-License-Identifier: Apache-2.0
"""Which program made a result, where it runs from a checkout."""

from __future__ import annotations

import subprocess
from pathlib import Path


def program_commit() -> str | None:
    """Return the commit of the checkout this package runs from; None where it runs from none."""
    package = Path(__file__).resolve().parent
    root = package.parents[1]
    # A wheel installed inside somebody else's checkout must not claim their commit.
    if not (root / "cpp" / "odometry").is_dir() or package != root / "src" / "pilotage":
        return None
    try:
        asked = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return asked.stdout.strip()
