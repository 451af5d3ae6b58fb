# SPDX-License-Identifier: Apache-2.0
"""stops.csv: what became of each stop of a walk. Its columns are told in docs/results_folder.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pilotage.pose_files import (
    COVARIANCE_COLUMNS,
    POSITION_COLUMNS,
    QUATERNION_COLUMNS,
    UPPER_TRIANGLE,
)

if TYPE_CHECKING:
    from pilotage import PlacedStop

STOP_COLUMNS = (
    *("stop", "timestamp_ns", "fate"),
    *POSITION_COLUMNS,
    *QUATERNION_COLUMNS,
    *("sights", "set_aside"),
    *COVARIANCE_COLUMNS,
)


def stops_text(stops: Sequence[PlacedStop], times_ns: Sequence[int]) -> str:
    """Return the whole file; cells of what is not known are empty."""
    lines = [",".join(STOP_COLUMNS)]
    for number, (stop, time_ns) in enumerate(zip(stops, times_ns, strict=True)):
        cells = [str(number), str(time_ns), stop.fate.name]
        pose = stop.world_from_stop
        known = pose is not None
        place = [*pose.translation_m, *pose.quaternion_wxyz] if pose is not None else []
        cells += [f"{float(v):.10g}" for v in place] or [""] * 7
        cells += [str(stop.sights), str(stop.set_aside)]
        cells += [f"{stop.covariance[at]:.10g}" if known else "" for at in UPPER_TRIANGLE]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"
