# SPDX-License-Identifier: Apache-2.0
"""The report's part on several stereo pairs: whom was believed when, and why not the others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from pilotage import JudgeConfig
from pilotage.evaluation.evaluate import Comparison
from pilotage.evaluation.judge_plots import draw_chi_squares, draw_choice, draw_differences
from pilotage.evaluation.page import figure_card
from pilotage.evaluation.several import Several
from pilotage.evaluation.verdict import alone_rows

# More stretches than this tell no more; judge.csv has them all.
LISTED = 20


def judge_sections(several: Several, summary: Mapping[str, Any]) -> Iterable[str]:
    """Yield the section on the judge; `summary` may be that of a killed run."""
    told = summary.get("judge", {})
    rule = str(told.get("rule", "chi_square"))
    yield "<h2>Which camera is believed</h2><div class='figures'>"
    yield figure_card(draw_choice(several, rule), "which pair is believed over time", wide=True)
    yield from _comparisons(several, told)
    yield _happenings(told.get("happenings", []), rule)


def _comparisons(several: Several, told: Mapping[str, Any]) -> Iterable[str]:
    if not any(math.isfinite(row.chi_square) for row in several.rows):
        yield "</div><p class='card'>No two pairs had poses at the same time to be compared.</p>"
        return
    names = several.names
    # Of two the second one's difference is the first one's, turned round.
    for name in names[1:] if len(names) <= 2 else names:
        yield figure_card(draw_differences(several, name), f"difference of {name} over time")
    confidence = float(told.get("confidence", str(JudgeConfig().confidence)))
    yield figure_card(draw_chi_squares(several, confidence), "chi-square over time")
    yield "</div>"
    yield (
        "<p class='made'>dX, dY, dZ: how far the camera's motion over the last"
        f" {told.get('window_s', 1.0):g} s puts it from where the calibration says it sits against"
        " the others, along the robot's axes. Shaded: not every pair is believed.</p>"
    )


def _happenings(happenings: list[Mapping[str, Any]], rule: str) -> str:
    """Return the table of stretches in which not all pairs were believed."""
    if not happenings and rule == "paper":
        return "<p class='card'>The stereo pairs never differed by more than the limit.</p>"
    if not happenings:
        return "<p class='card'>All stereo pairs were believed all the time.</p>"
    rows = "".join(
        f"<tr><td class='number'>{one['from_s']:.1f} s</td>"
        f"<td class='number'>{one['to_s']:.1f} s</td>"
        f"<td{' class=stop' if one['stop'] else ''}>{escape(one['words'])}</td></tr>"
        for one in happenings[:LISTED]
    )
    more = len(happenings) - LISTED
    if more > 0:
        rows += f"<tr><td></td><td></td><td>and {more} more, see judge.csv</td></tr>"
    return (
        "<div class='card'><table><thead><tr><th class='number'>from</th><th class='number'>to</th>"
        f"<th>what was told at its end</th></tr></thead>{rows}</table></div>"
    )


def alone_table(comparison: Comparison) -> str:
    """Return the table of what joining gave; empty for a single pair."""
    if not comparison.alone:
        return ""
    heads = "".join(
        f"<th{' class=number' if at else ''}>{name}</th>"
        for at, name in enumerate(
            ("", "pairs with pose", "error at the end", "ATE, rms", "ATE, largest")
        )
    )
    rows = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=number' if at else ''}>{escape(cell)}</td>" for at, cell in enumerate(row)
        )
        + "</tr>"
        for row in alone_rows(comparison)
    )
    return (
        "<h2>What joining gave</h2><div class='card'><table><thead><tr>"
        f"{heads}</tr></thead>{rows}</table></div>"
    )
