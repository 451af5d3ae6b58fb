# SPDX-License-Identifier: Apache-2.0
"""The report's figures, each as SVG text; to be drawn inside `matplotlib.rc_context(STYLE)`."""

from __future__ import annotations

import io
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotage.evaluation.course import Course
from pilotage.evaluation.metrics import position_errors
from pilotage.evaluation.poses import Array, way_m
from pilotage.evaluation.truth import poses_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pilotage.evaluation.evaluate import Comparison

# Okabe and Ito (2008): told apart with any colour vision, and in grey by their lightness.
BLUE, ORANGE, RED, GREEN, BLACK = "#0072B2", "#E69F00", "#D55E00", "#009E73", "#222222"
YELLOW = "#F0E442"  # for dots and areas; a line of it is not seen on white
PAIR_COLOURS = ("#CC79A7", "#009E73", "#56B4E9", "#A68A00")
# Beyond this a curve shows no more on a page, and the page only grows.
MOST_POINTS = 3000
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "lines.linewidth": 1.4,
    "legend.edgecolor": "none",
    "legend.framealpha": 0.85,
    "svg.hashsalt": "pilotage",
    "svg.fonttype": "path",
}


def pair_colour(number: int) -> str:
    """Return the colour of the stereo pair of that number, alike in all figures."""
    return PAIR_COLOURS[number % len(PAIR_COLOURS)]


def draw_path(
    course: Course, truth_m: Array | None, pairs_m: Mapping[str, Array] | None = None
) -> str:
    """Draw the path from above, forward to the right, equal scale; gaps dotted.

    `pairs_m` are the (N, 3) paths of stereo pairs by themselves, where they were joined.
    """
    east, north = course.position_m[:, 0], course.position_m[:, 1]
    drawn = course.position_m if truth_m is None else np.vstack([course.position_m, truth_m])
    figure, axes = make_figure(width=10.4, height=_path_height(drawn))
    if truth_m is not None:
        axes.plot(*thin(truth_m[:, 0], truth_m[:, 1]), "--", color=BLACK, lw=1.1, label="truth")
    for number, (name, path_m) in enumerate((pairs_m or {}).items()):
        axes.plot(*thin(path_m[:, 0], path_m[:, 1]), color=pair_colour(number), lw=1.0, label=name)
    axes.plot(*thin(east, north), color=BLUE, lw=1.8, label="joined" if pairs_m else "tracked")
    if course.is_degraded.any():
        shown = np.where(course.is_degraded, 1.0, np.nan)
        axes.plot(east * shown, north * shown, ".", color=ORANGE, ms=5, label="uncertain")
    _draw_gaps(axes, course)
    known = np.flatnonzero(~course.is_lost)
    if len(known):
        for at, marker, name in ((known[0], "o", "start"), (known[-1], "s", "end")):
            axes.plot(
                *(east[at], north[at]), marker, ms=8, mfc="white", mec=BLACK, mew=1.6, ls="",
                label=name, zorder=5,
            )  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="forward [m]", ylabel="left [m]")
    axes.legend(ncol=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return svg_of(figure)


def _path_height(drawn: Array) -> float:
    extent = [float(np.ptp(axis[np.isfinite(axis)])) if np.isfinite(axis).any() else 0.0
              for axis in (drawn[:, 0], drawn[:, 1])]  # fmt: skip
    return float(np.clip(1.2 + 9.0 * extent[1] / max(extent[0], 1e-9), 2.6, 8.0))


def _draw_gaps(axes: Axes, course: Course) -> None:
    label = "lost"
    known = np.flatnonzero(~course.is_lost)
    for before, after in pairwise(known):
        if after - before > 1:
            ends = course.position_m[[before, after]]
            axes.plot(ends[:, 0], ends[:, 1], ":x", color=RED, lw=1.6, ms=6, label=label)
            label = "_nolegend_"


def draw_height(course: Course, truth_m: Array | None) -> str:
    """Draw height over the way travelled."""
    figure, axes = make_figure()
    if truth_m is not None:
        axes.plot(*thin(way_m(truth_m), truth_m[:, 2]), "--", color=BLACK, lw=1.1, label="truth")
        axes.plot([], [], color=BLUE, label="tracked")
        axes.legend()
    axes.plot(*thin(way_m(course.position_m), course.position_m[:, 2]), color=BLUE)
    axes.set(xlabel="distance travelled [m]", ylabel="height [m]", title="Height")
    _at_least(axes, 0.02)
    return svg_of(figure)


def draw_speed(course: Course) -> str:
    """Draw speed over time, from neighbouring pairs."""
    figure, axes = make_figure()
    spans = np.diff(course.time_s)
    steps = np.linalg.norm(np.diff(course.position_m, axis=0), axis=1)
    speed = np.divide(steps, spans, out=np.full(len(steps), np.nan), where=spans > 0)
    axes.plot(*thin(course.time_s[1:], speed), color=BLUE)
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", title="Speed")
    axes.set_ylim(bottom=0)
    _shade_lost(axes, course)
    return svg_of(figure)


def draw_matches(course: Course) -> str:
    """Draw matches and inliers over time."""
    figure, axes = make_figure()
    for name, colour, style in (("matches", BLACK, "--"), ("inliers", BLUE, "-")):
        values = np.array([float(getattr(record, name)) for record in course.records])
        axes.plot(*thin(course.time_s, values), style, color=colour, label=name)
    axes.set(xlabel="time [s]", ylabel="points", title="Matches and inliers")
    axes.set_ylim(bottom=0)
    axes.legend(ncol=2)
    _shade_lost(axes, course)
    return svg_of(figure)


def draw_residuals(course: Course) -> str:
    """Draw the rms residual and the y-parallax over time."""
    figure, axes = make_figure()
    axes.plot(
        *thin(course.time_s, course.measure("residual_px")), color=BLUE, label="residual, rms"
    )
    parallax = course.measure("y_parallax_px")
    axes.plot(*thin(course.time_s, parallax), "--", color=ORANGE, label="y-parallax, rms")
    axes.set(xlabel="time [s]", ylabel="image error [px]", title="Residual and y-parallax")
    axes.set_ylim(bottom=0)
    axes.legend(ncol=2)
    _shade_lost(axes, course)
    return svg_of(figure)


def draw_deviation(course: Course) -> str:
    """Draw the standard deviation of the position over time."""
    figure, axes = make_figure()
    unit, scale = unit_of(course.deviation_m)
    axes.plot(*thin(course.time_s, scale * course.deviation_m), color=BLUE)
    axes.set(
        xlabel="time [s]",
        ylabel=f"standard deviation [{unit}]",
        title="Uncertainty of the position",
    )
    axes.set_ylim(bottom=0)
    _shade_lost(axes, course)
    return svg_of(figure)


def draw_errors(course: Course, comparison: Comparison) -> str:
    """Draw the distance to the truth over the way travelled, both ways of alignment."""
    figure, axes = make_figure()
    estimate = poses_of(course.records)
    way = way_m(comparison.truth[:, :3, 3])
    chosen = comparison.metrics.alignment
    errors = position_errors(estimate=estimate, truth=comparison.truth, alignment="origin")
    fitted = position_errors(estimate=estimate, truth=comparison.truth, alignment="se3")
    unit, scale = unit_of(errors)
    axes.plot(*thin(way, scale * errors), color=BLUE, label="first pose on first pose")
    axes.plot(*thin(way, scale * fitted), "--", color=ORANGE, label="best fit (ATE)")
    if chosen == "none":
        raw = position_errors(estimate=estimate, truth=comparison.truth, alignment="none")
        axes.plot(*thin(way, scale * raw), ":", color=BLACK, label="as they are")
    deviation = thin(way, scale * course.deviation_m)
    axes.plot(*deviation, "-.", color=GREEN, lw=1.0, label="standard deviation claimed")
    axes.set(xlabel="distance travelled [m]", ylabel=f"error [{unit}]", title="Error against truth")
    axes.set_ylim(bottom=0)
    axes.legend()
    return svg_of(figure)


def unit_of(values_m: Array) -> tuple[str, float]:
    """Return the unit that suits lengths so large, and what metres are multiplied by."""
    largest = np.nanmax(values_m) if np.isfinite(values_m).any() else 1.0
    return ("mm", 1e3) if largest < 0.1 else ("m", 1.0)


def make_figure(width: float = 5.1, height: float = 2.7) -> tuple[Figure, Axes]:
    """Return a figure of that size, inches, and its only axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.add_subplot()


def svg_of(figure: Figure) -> str:
    """Return a figure as SVG text to be put into a page."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]


def _shade_lost(axes: Axes, course: Course) -> None:
    """Shade the times at which there is no pose."""
    if not course.is_lost.any():
        return
    time_s = course.time_s
    half = 0.5 * float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.5
    edges = np.diff(np.concatenate([[0], course.is_lost.astype(int), [0]]))
    for first, last in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        axes.axvspan(
            time_s[first] - half, time_s[last - 1] + half, color=RED, alpha=0.25, lw=0, zorder=0
        )


def _at_least(axes: Axes, span: float) -> None:
    """Widen the vertical axis to `span`: what is flat should look flat."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """Return every n-th point, so that few enough are left; gaps may shrink but do not close."""
    stride = -(-len(x) // MOST_POINTS)
    if stride <= 1:
        return x, y
    starts = np.arange(0, len(x), stride)
    is_gap = np.logical_or.reduceat(~np.isfinite(y), starts)
    return x[starts], np.where(is_gap, np.nan, y[starts])
