# SPDX-License-Identifier: Apache-2.0
"""Sections of a report that only a walk with stops has: its stops, and what tells their scale."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from pilotage.pose_files import read_text
from pilotage.results import STOPS

FATE_WORDS = {
    "placed": "placed",
    "carried": "carried there",
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


def _stop_table(out: Path) -> str:
    rows = list(csv.DictReader(io.StringIO(read_text(out / STOPS))))
    heads = ("stop", "", "x", "y", "turned", "standard error", "seen again", "set aside")
    return _table(heads, (_stop_cells(row) for row in rows))


def _stop_cells(row: Mapping[str, str]) -> list[str]:
    fate = FATE_WORDS[row["fate"]]
    if not row["x_m"]:
        return [row["stop"], fate, "", "", "", "", "", ""]
    w, z = float(row["qw"]), float(row["qz"])
    sigma_m = math.sqrt(max(0.0, sum(float(row[f"cov_{axis}_{axis}"]) for axis in "xy")))
    return [
        row["stop"],
        fate,
        f"{float(row['x_m']):.3f} m",
        f"{float(row['y_m']):.3f} m",
        f"{math.degrees(2 * math.atan2(z, w)):.1f}\N{DEGREE SIGN}",
        f"{1e3 * sigma_m:.1f} mm",
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
    return _table(("by", "factor", "standard error", "from"), rows)


def _truth_table(truth: Mapping[str, float]) -> str:
    rows = [
        ["last stop, from the first", f"{1e3 * truth['home_m']:.1f} mm"],
        ["last stop, turn", f"{truth['home_deg']:.3f}\N{DEGREE SIGN}"],
        ["largest, from the first", f"{1e3 * truth['largest_m']:.1f} mm"],
        ["ATE, rms", f"{1e3 * truth['ate_rmse_m']:.1f} mm"],
        ["estimated size / true size", f"{truth['scale']:.5f}"],
    ]
    return _table(("", ""), rows)


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    first = "".join(f"<th>{escape(head)}</th>" for head in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<div class='card'><table><thead><tr>{first}</tr></thead>{body}</table></div>"
