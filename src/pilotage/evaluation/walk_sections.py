# SPDX-License-Identifier: Apache-2.0
"""Sections of a report that only a walk with stops has: its stops, and what tells their scale."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pilotage.evaluation.model_plots import StopPath
from pilotage.pose_files import read_text
from pilotage.results import STOPS

FATE_WORDS = {
    "placed": "placed",
    "carried": "carried there",
    "found": "found again",
    "lost": "lost",
}


def walk_sections(out: Path, summary: Mapping[str, Any]) -> Iterable[str]:
    """Yield the tables of stops and of lengths."""
    yield "<h2>Stops</h2>"
    yield _stop_table(out)
    said = (
        "From the first stop that has a pose: x ahead, y to the left. Set aside are features that"
        " other stops show as well and that contradict the room: of whoever moves about, or matched"
        " wrongly."
    )
    if summary["moving_pictures"]:
        said += f" {summary['moving_pictures']} pictures taken on the way were left out."
    yield f"<p class='made'>{escape(said)}</p>"
    yield "<h2>How long a metre is</h2>"
    yield _length_table(summary["lengths"])
    if summary["truth"] is not None:
        yield "<h2>Against the truth</h2>"
        yield _truth_table(summary["truth"])


def stop_path(out: Path) -> StopPath:
    """Return where the stops of a walk's folder are that have a pose."""
    rows = _rows(out)
    posed = [at for at, row in enumerate(rows) if row["x_m"]]
    return StopPath(
        places=np.array([[float(rows[at][f"{axis}_m"]) for axis in "xyz"] for at in posed]),
        numbers=tuple(int(rows[at]["stop"]) for at in posed),
        is_walked_to=tuple(at - 1 in posed and rows[at]["fate"] == "placed" for at in posed),
    )


def _rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(read_text(out / STOPS))))


def _stop_table(out: Path) -> str:
    rows = _rows(out)
    heads = (
        *("stop", "fate", "x [m]", "y [m]", "turned [\N{DEGREE SIGN}]", "standard error [mm]"),
        *("seen again", "set aside"),
    )
    first = next((row["stop"] for row in rows if row["x_m"]), None)
    return _table(heads, (_stop_cells(row, is_first=row["stop"] == first) for row in rows), text=2)


def _stop_cells(row: Mapping[str, str], *, is_first: bool) -> list[str]:
    fate = FATE_WORDS[row["fate"]]
    if not row["x_m"]:
        return [row["stop"], fate, "", "", "", "", "", ""]
    # From -180 to 180, whichever of its two signs the quaternion has.
    turned_deg = math.degrees(2 * math.atan2(float(row["qz"]), float(row["qw"])))
    turned_deg = (turned_deg + 180) % 360 - 180
    sigma_m = math.sqrt(max(0.0, sum(float(row[f"cov_{axis}_{axis}"]) for axis in "xy")))
    return [
        row["stop"],
        fate,
        f"{float(row['x_m']):.3f}",
        f"{float(row['y_m']):.3f}",
        f"{turned_deg:.1f}",
        "-" if is_first else f"{1e3 * sigma_m:.1f}",  # the first is where the world begins
        row["sights"],
        row["set_aside"],
    ]


def _length_table(lengths: Mapping[str, Any]) -> str:
    rows = [
        [
            one["source"],
            f"{one['factor']:.4f}",
            f"\N{PLUS-MINUS SIGN} {one['sigma']:.4f}",
            str(one["count"]),
        ]
        for one in lengths["sources"]
    ]
    taken = [f"{lengths['factor']:.4f}", f"\N{PLUS-MINUS SIGN} {lengths['sigma']:.4f}", ""]
    rows.append(["all together, which lengths were multiplied by", *taken])
    heads = ("by", "factor", "standard error", "pictures, steps, places, marks")
    return _table(heads, rows, text=1)


def _truth_table(truth: Mapping[str, float]) -> str:
    rows = [
        ["last stop, from the first", f"{1e3 * truth['home_m']:.1f} mm"],
        ["last stop, turn", f"{truth['home_deg']:.3f}\N{DEGREE SIGN}"],
        ["largest, from the first", f"{1e3 * truth['largest_m']:.1f} mm"],
        ["ATE, rms", f"{1e3 * truth['ate_rmse_m']:.1f} mm"],
        ["estimated size / true size", f"{truth['scale']:.5f}"],
    ]
    return _table(("", ""), rows, text=1)


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]], *, text: int) -> str:
    """Return a table whose first `text` columns are words, and the others numbers."""

    def line(cells: Iterable[str], tag: str) -> str:
        kinds = ("" if at < text else " class='number'" for at in itertools.count())
        each = zip(cells, kinds, strict=False)
        return "".join(f"<{tag}{kind}>{escape(cell)}</{tag}>" for cell, kind in each)

    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    named = [*heads]
    head = f"<thead><tr>{line(named, 'th')}</tr></thead>" if any(named) else ""
    return f"<div class='card'><table>{head}{body}</table></div>"
