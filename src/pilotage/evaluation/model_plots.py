# SPDX-License-Identifier: Apache-2.0
"""The figures of a model's report, each as SVG text; to be drawn inside `rc_context(STYLE)`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotage.evaluation.level import level_from_world, limits_of
from pilotage.evaluation.plots import BLACK, BLUE, ORANGE, RED, make_figure, svg_of
from pilotage.evaluation.poses import Array
from pilotage.models import Model
from pilotage.models.ply import pyramid_corners

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Between black and white, of which clouds have both; and dots enough to be seen, few enough to be
# told apart.
GROUND = "#c9cdd2"
DOT_AREA = (1.2, 9.0)
DOTS_PER_AREA = 12000
DOT_DPI = 170
# Pyramids no smaller than this share of what is drawn.
LEAST_PYRAMID = 0.018
WIDTH, TALLEST = 10.4, 10.0
# The corners of a picture, and from each to the centre of projection.
OUTLINE = (0, 1, 2, 0, 3, 4, 0, 1, 4, 3, 2)
MOST_BINS = 12
# Of a walk, whose cameras stand in clusters: their lines, and the most stops that have a number.
LINE, WALK_LINE = 0.8, 0.45
MOST_NUMBERS = 40
# Stops nearer to each other than this share of the figure have their numbers on different sides.
NEAR_STOPS = 0.03
SIDES = ((0, 7), (0, -8), (11, 0), (-11, 0))  # points, from a stop to its number


@dataclass(frozen=True, kw_only=True)
class StopPath:
    """Where a robot stood: (S, 3) places, metres, their numbers, and to which it walked.

    A stop `is_walked_to` from the one before it here: not the first, none it was carried to, none
    after one that is lost.
    """

    places: Array
    numbers: tuple[int, ...]
    is_walked_to: tuple[bool, ...]


def draw_cloud(
    model: Model, unit: str, *, is_ordered: bool, stops: StopPath | None = None
) -> tuple[str, int]:
    """Draw points and cameras from above and from the side, equal scale, `unit` at the axes.

    The world of a walk with `stops` has z up already, and the way is drawn from stop to stop. The
    second value is the number of points that lie outside the figure.
    """
    level = level_from_world(model.world_from_camera()) if stops is None else np.eye(3)
    origin = model.world_from_camera()[0, :3, 3] if stops is None else np.zeros(3)
    points = (model.points_in_world - origin) @ level.T
    centres = (model.world_from_camera()[:, :3, 3] - origin) @ level.T
    limits = limits_of(points, centres)
    extent = limits[1] - limits[0]
    corners = pyramid_corners(model, least_depth=LEAST_PYRAMID * float(extent.max()))
    corners = (corners - origin) @ level.T
    limits = np.array(
        [np.minimum(limits[0], corners.min((0, 1))), np.maximum(limits[1], corners.max((0, 1)))]
    )
    figure, axes = _two_views(limits[1] - limits[0])
    # What is nearer is drawn later: from above what is higher, from the side what is on the right.
    for place, upward, nearer, title, name in (
        (axes[0], 1, points[:, 2], "From above", "across"),
        (axes[1], 2, -points[:, 1], "From the side", "height"),
    ):
        shown = np.argsort(nearer, kind="stable")
        view = [0, upward]
        _draw_points(place, points[shown][:, view], model.colors[shown] / 255.0)
        line = LINE if stops is None else WALK_LINE
        is_way = is_ordered and stops is None
        _draw_cameras(place, corners[:, :, view], line=line, is_way=is_way)
        place.set(
            title=title, xlim=limits[:, 0], ylim=limits[:, upward], facecolor=GROUND,
            xlabel=f"main direction [{unit}]", ylabel=f"{name} [{unit}]",
        )  # fmt: skip
        place.set_aspect("equal", adjustable="box")
        if stops is not None:
            _draw_stops(place, stops.places[:, view], stops, is_numbered=upward == 1)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncol=5)
    inside = ((points >= limits[0]) & (points <= limits[1])).all(axis=1)
    return svg_of(figure), int(np.count_nonzero(~inside))


def _two_views(extent: Array) -> tuple[Figure, tuple[Axes, Axes]]:
    """Return axes below or beside each other, whichever shows more on a page."""
    from matplotlib.figure import Figure

    along, across, height = (max(float(size), 1e-9) for size in extent)
    # Inches for a unit; what is taken off are titles, numbers and the legend.
    below = min((WIDTH - 1.0) / along, (TALLEST - 1.8) / (across + height))
    beside = min((WIDTH / 2 - 0.9) / along, (TALLEST - 1.6) / max(across, height))
    if below >= beside:
        size = (WIDTH, max(below * (across + height) + 1.8, 3.0))
        layout: dict[str, Any] = {"nrows": 2, "height_ratios": (across, height)}
    else:
        size = (WIDTH, max(beside * max(across, height) + 1.6, 3.0))
        layout = {"ncols": 2}
    figure = Figure(figsize=size, dpi=DOT_DPI, layout="constrained")
    places = figure.subplots(**layout)
    for place in places:
        place.set_anchor("N")
    return figure, (places[0], places[1])


def _draw_points(axes: Axes, points: Array, colors: Array) -> None:
    area = float(np.clip(DOTS_PER_AREA / max(len(points), 1), *DOT_AREA))
    axes.scatter(points[:, 0], points[:, 1], s=area, c=colors, linewidths=0, rasterized=True)


def _draw_cameras(axes: Axes, corners: Array, *, line: float, is_way: bool) -> None:
    """Draw (P, 5, 2) pyramids and, where pictures follow each other, the way between them."""
    from matplotlib.collections import LineCollection

    axes.add_collection(
        LineCollection(
            list(corners[:, OUTLINE]), colors=RED, linewidths=line, label="cameras", zorder=3
        )
    )
    if not is_way:
        return
    centres = corners[:, 0]
    axes.plot(*centres.T, color=RED, lw=0.9, alpha=0.6, zorder=2.5)
    for at, marker, name in ((0, "o", "first picture"), (-1, "s", "last picture")):
        axes.plot(
            *centres[at], marker, ms=5, mfc="white", mec=BLACK, mew=1.3, ls="", label=name,
            zorder=4,
        )  # fmt: skip


def _draw_stops(axes: Axes, places: Array, stops: StopPath, *, is_numbered: bool) -> None:
    """Draw (S, 2) places, the way walked between them, and where the robot was carried."""
    name = "way walked"
    for before, to in zip(places[:-1], range(1, len(places)), strict=True):
        if stops.is_walked_to[to]:
            axes.plot(*zip(before, places[to], strict=True), color=BLUE, lw=1.6, zorder=4,
                      label=name)  # fmt: skip
            name = "_"
    axes.plot(*places.T, "o", ms=4.5, mfc="white", mec=BLUE, mew=1.3, ls="", label="stops",
              zorder=5)  # fmt: skip
    found = [at for at, walked in enumerate(stops.is_walked_to) if at and not walked]
    if found:
        axes.plot(*places[found].T, "D", ms=6, mfc="white", mec=BLACK, mew=1.5, ls="",
                  label="not walked to from the stop before", zorder=5)  # fmt: skip
    if is_numbered:
        _number_stops(axes, places, stops.numbers)


def _number_stops(axes: Axes, places: Array, numbers: tuple[int, ...]) -> None:
    """Write the numbers of (S, 2) places above them, or on the first side that is free."""
    from matplotlib.patheffects import withStroke

    chosen = range(0, len(places), -(-len(places) // MOST_NUMBERS))
    near = NEAR_STOPS * max(abs(high - low) for low, high in (axes.get_xlim(), axes.get_ylim()))
    side_of: dict[int, tuple[int, int]] = {}
    for at in chosen:
        taken = [s for i, s in side_of.items() if np.linalg.norm(places[at] - places[i]) < near]
        side_of[at] = next((side for side in SIDES if side not in taken), SIDES[0])
        axes.annotate(str(numbers[at]), places[at], side_of[at],
                      textcoords="offset points", ha="center", va="center", fontsize=8,
                      fontweight="bold", color=BLACK, zorder=6,
                      path_effects=[withStroke(linewidth=2.5, foreground="white")])  # fmt: skip


def draw_track_lengths(model: Model) -> str:
    """Draw how many points were seen in how many pictures."""
    figure, axes = make_figure()
    lengths = np.bincount(model.point, minlength=len(model.points_in_world))
    longest = max(int(lengths.max(initial=2)), 2)
    edges = np.arange(2, min(longest, MOST_BINS) + 1)
    counts = [np.count_nonzero(lengths == length) for length in edges]
    counts[-1] = np.count_nonzero(lengths >= edges[-1])
    names = [str(length) for length in edges]
    if longest > edges[-1]:
        names[-1] += "+"
    axes.margins(y=0.12)
    bars = axes.bar(names, counts, color=BLUE, width=0.75)
    axes.bar_label(bars, padding=1, fontsize=7)
    axes.set(xlabel="pictures that show a point", ylabel="points", title="Length of tracks")
    axes.grid(visible=False, axis="x")
    return svg_of(figure)


def draw_residual_counts(model: Model) -> str:
    """Draw how many observations have how large a residual; the largest 2 % are left out."""
    figure, axes = make_figure()
    errors = model.reprojection_errors_px()
    errors = errors[np.isfinite(errors)]
    top = max(float(np.quantile(errors, 0.98)), 1e-6) if len(errors) else 1.0
    axes.hist(errors, bins=40, range=(0, top), color=BLUE)
    if len(errors):
        middle = float(np.median(errors))
        axes.axvline(middle, color=BLACK, ls="--", lw=1.1, label=f"median {middle:.2f} px")
        axes.legend()
    axes.set(xlabel="distance from where the point should be [px]", ylabel="observations")
    axes.set(title="Residuals, all but the largest 2 %", xlim=(0, top))
    return svg_of(figure)


def draw_pictures(model: Model, names: list[str]) -> str:
    """Draw for each of all pictures how many points it shows and its residual, rms of x and y.

    `names` are those of all pictures in their order; those without pose are marked.
    """
    figure, (above, below) = _stacked(3.6 if _are_short(names) else 4.5)
    place = {name: at for at, name in enumerate(names)}
    at = np.array([place[name] for name in model.names], dtype=int)
    counts = np.bincount(model.picture, minlength=len(model.names))
    errors = model.reprojection_errors_px()
    known = np.isfinite(errors)
    sums = np.bincount(model.picture[known], weights=errors[known] ** 2, minlength=len(model.names))
    seen = np.bincount(model.picture[known], minlength=len(model.names))
    above.bar(at, counts, color=BLUE, width=0.8)
    below.bar(at, np.sqrt(sums / np.maximum(2 * seen, 1)), color=ORANGE, width=0.8)
    missing = sorted(set(range(len(names))) - set(at.tolist()))
    for axes in (above, below):
        for gap in missing:
            axes.axvspan(gap - 0.5, gap + 0.5, color=RED, alpha=0.25, lw=0, zorder=0)
        axes.grid(visible=False, axis="x")
    above.set(ylabel="points seen", title="Each picture")
    below.set(xlabel="picture", ylabel="residual, rms [px]", xlim=(-0.7, len(names) - 0.3))
    _name_pictures(below, names)
    return svg_of(figure)


def _stacked(height: float) -> tuple[Figure, tuple[Axes, Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    return figure, (above, below)


def _name_pictures(axes: Axes, names: list[str]) -> None:
    """Write as many names below the axis as fit, aslant where they are long."""
    stride = -(-len(names) // 14)
    at = range(0, len(names), stride)
    shown = [
        names[i] if len(names[i]) <= 24 else "\N{HORIZONTAL ELLIPSIS}" + names[i][-23:] for i in at
    ]
    if _are_short(names):
        axes.set_xticks(list(at), shown)
    else:
        axes.set_xticks(list(at), shown, rotation=30, ha="right")


def _are_short(names: list[str]) -> bool:
    """Tell whether names fit beside each other below an axis."""
    return max((len(name) for name in names), default=0) <= 9
