# SPDX-License-Identifier: Apache-2.0
"""The report's figures of several stereo pairs; to be drawn inside `matplotlib.rc_context(STYLE)`.

Colours are those of `plots`, so that a pair has the same one in all figures.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pilotage.evaluation.metrics import position_errors
from pilotage.evaluation.plots import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    RED,
    make_figure,
    pair_colour,
    svg_of,
    thin,
    unit_of,
)
from pilotage.evaluation.poses import way_m
from pilotage.evaluation.truth import poses_of
from pilotage.judge_files import JudgeRow
from pilotage.judge_words import chi_square_limit
from pilotage.reasons import short_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pilotage.evaluation.evaluate import Comparison
    from pilotage.evaluation.several import Several

GREY = "#BBBBBB"
BELIEF_COLOURS = {"joined": GREEN, "disagrees": ORANGE, "lost": RED, "absent": GREY}
BELIEF_WORDS = {
    "joined": "believed",
    "disagrees": "set aside",
    "lost": "lost",
    "absent": "no pictures",
}
NOT_CHOSEN = "#A9D8C6"
STATUS_COLOURS = {"tracking": BLUE, "degraded": ORANGE, "lost": BLACK, "skipped": BLACK}
STATUS_WORDS = {"tracking": "sure", "degraded": "uncertain", "lost": "stop", "skipped": "stop"}
Key = TypeVar("Key")
# A stretch shorter than this share of the run has no room for words.
ROOM_FOR_WORDS = 0.08
# What is larger than so many times the usual is cut off: it would flatten all the rest.
CUT_OFF = 8.0


def draw_choice(several: Several, rule: str) -> str:
    """Draw a strip for each pair, whether it is believed and why not, and what the robot may do.

    By the rule `paper` one is chosen, which says nothing against the others.
    """
    names = several.names
    colours, belief_words = dict(BELIEF_COLOURS), dict(BELIEF_WORDS)
    if rule == "paper":
        colours["disagrees"], belief_words["disagrees"] = NOT_CHOSEN, "not chosen"
    figure, axes = make_figure(width=10.4, height=0.9 + 0.42 * (len(names) + 1))
    axes.grid(visible=False)
    times_s = several.times_s(names[0])
    whole_s = float(times_s[-1]) if len(times_s) > 1 else 1.0
    for place, name in enumerate(names):
        for key, start_s, end_s in _runs([(r.belief, r.reason) for r in several.of(name)], times_s):
            belief, reason = key
            axes.broken_barh(
                [(start_s, end_s - start_s)], (place - 0.35, 0.7), color=colours.get(belief, GREY)
            )
            said = "" if belief == "joined" else belief_words.get(belief, belief)
            if belief == "lost" and reason != "none":
                said = short_words(reason)
            _write(axes, said, place, (start_s, end_s), whole_s, light=belief == "lost")
    first = several.of(names[0])
    for status, start_s, end_s in _runs([row.status for row in first], times_s):
        colour = STATUS_COLOURS.get(status, GREY)
        axes.broken_barh([(start_s, end_s - start_s)], (len(names) - 0.35, 0.7), color=colour)
        words = STATUS_WORDS.get(status, status)
        _write(axes, words, len(names), (start_s, end_s), whole_s, light=status != "degraded")
    axes.set(xlabel="time [s]", xlim=(0, whole_s), ylim=(len(names) + 0.5, -0.5))
    axes.set_yticks(range(len(names) + 1), [*names, "together"])
    axes.tick_params(axis="y", length=0)
    for belief, colour in colours.items():
        axes.broken_barh([(-1, 0.5)], (0, 0.1), color=colour, label=belief_words[belief])
    axes.legend(
        ncol=len(BELIEF_COLOURS), loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.2
    )
    return svg_of(figure)


def _write(  # noqa: PLR0913, what and where
    axes: Axes, words: str, place: int, span_s: tuple[float, float], whole_s: float, *, light: bool
) -> None:
    width_s = span_s[1] - span_s[0]
    if words and width_s > max(ROOM_FOR_WORDS, 0.011 * len(words)) * whole_s:
        axes.text(
            0.5 * sum(span_s), place, words, ha="center", va="center", fontsize=8,
            color="white" if light else BLACK, clip_on=True,
        )  # fmt: skip


def _runs(keys: Sequence[Key], times_s: np.ndarray) -> Iterable[tuple[Key, float, float]]:
    """Yield stretches of equal keys with begin and end, each up to the next one's begin."""
    at = 0
    for key, group in groupby(keys):
        count = sum(1 for _ in group)
        end = min(at + count, len(times_s) - 1)
        yield key, float(times_s[at]), float(times_s[end])
        at += count


def draw_differences(several: Several, name: str) -> str:
    """Draw dX, dY and dZ of a pair against the others, over the judge's window, from calibrated."""
    figure, axes = make_figure()
    times_s, rows = several.times_s(name), several.of(name)
    apart_mm = 1e3 * np.array([row.difference[:3] for row in rows]).reshape(-1, 3)
    styles = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."))
    for axis, (colour, style) in enumerate(styles):
        axes.plot(
            *thin(times_s, apart_mm[:, axis]), style, color=colour, lw=1.2, label=f"d{'XYZ'[axis]}"
        )
    known = np.abs(apart_mm[np.isfinite(apart_mm)])
    if len(known):
        limit = max(1.0, min(float(known.max()), CUT_OFF * float(np.quantile(known, 0.75))))
        axes.set_ylim(-1.1 * limit, 1.1 * limit)
    axes.axhline(0, color=BLACK, lw=0.8)
    _shade_disbelief(axes, rows, times_s)
    axes.set(
        xlabel="time [s]",
        xlim=(0, times_s[-1]),
        ylabel="off the calibrated [mm]",
        title=f"{name} against the others",
    )
    axes.legend(ncol=3)
    return svg_of(figure)


def draw_chi_squares(several: Several, confidence: float) -> str:
    """Draw each pair's chi-square over time, on a logarithmic scale, with the limit."""
    figure, axes = make_figure()
    # Of two pairs both have the same one: a curve is enough.
    names = several.names[1:] or several.names
    for name in names:
        rows = several.of(name)
        values = np.array([row.chi_square for row in rows])
        axes.plot(
            *thin(several.times_s(name), values), color=pair_colour(several.names.index(name)),
            label=name,
        )  # fmt: skip
        _shade_disbelief(axes, rows, several.times_s(name))
    limit = chi_square_limit(confidence)
    axes.axhline(limit, color=RED, ls="--", lw=1.0, label=f"limit {limit:.0f}")
    axes.set_yscale("log")
    axes.set(
        xlabel="time [s]",
        xlim=(0, several.times_s(names[0])[-1]),
        ylabel="chi-square, 6 d.o.f.",
        title="Difference in standard errors",
    )
    axes.legend(ncol=3)
    return svg_of(figure)


def draw_pair_errors(comparison: Comparison) -> str:
    """Draw the distance to the truth over the way, of the joint path and of each pair alone."""
    figure, axes = make_figure()
    told = {"joined": comparison, **comparison.alone}
    errors = {
        name: position_errors(
            estimate=poses_of(one.results.records), truth=one.truth, alignment="origin"
        )
        for name, one in told.items()
        if one is not None
    }
    unit, scale = unit_of(errors["joined"])
    for number, (name, one) in enumerate(told.items()):
        if one is None:
            continue
        colour = BLUE if number == 0 else pair_colour(number - 1)
        way = way_m(one.truth[:, :3, 3])
        axes.plot(
            *thin(way, scale * errors[name]), color=colour, lw=1.8 if number == 0 else 1.1,
            label=name, zorder=3 if number == 0 else 2,
        )  # fmt: skip
    axes.set(
        xlabel="distance travelled [m]", ylabel=f"error [{unit}]", title="Joined, and each alone"
    )
    # Whoever went astray would flatten the others: it leaves the figure.
    largest = sorted(float(np.nanmax(values)) for values in errors.values())
    axes.set_ylim(0, 1.05 * scale * min(largest[-1], CUT_OFF * largest[0]))
    axes.legend(ncol=3)
    return svg_of(figure)


def _shade_disbelief(axes: Axes, rows: Sequence[JudgeRow], times_s: np.ndarray) -> None:
    """Shade the times at which not all pairs were believed."""
    for is_whole, start_s, end_s in _runs([len(row.believed) for row in rows], times_s):
        if is_whole < max(len(row.believed) for row in rows) and end_s > start_s:
            axes.axvspan(start_s, end_s, color=ORANGE, alpha=0.2, lw=0, zorder=0)
