# SPDX-License-Identifier: Apache-2.0
"""A sweep of a Nao's head as one wide picture: fixed homographies beside moving centres.

python benchmarks/head_sweep.py --seeds 5
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from sweep_pictures import SweepingNao, TrueView, sweep_goals, things_at, true_points, walls_at
from tables import markdown_table, number

from pilotage.behaviors.mosaic import (
    Joined,
    Link,
    directions_by_homographies,
    join_by_homographies,
    link_views,
)
from pilotage.behaviors.moving_centres import refine_sweep
from pilotage.behaviors.sweep import Features, Shared, View, find_features, find_shared
from pilotage.behaviors.virtual_camera import distances_of, see_features
from pilotage.simulation.nao import TORSO_M
from pilotage.simulation.world import World

Array = npt.NDArray[Any]
DISTANCES_M = (1.0, 2.0, 3.0, 5.0)
OFF_LINE_M = 5.0  # the walls that the fixed homographies are found before
MIDDLE_ROW_DEG = 20.0  # pitch of the three pictures between the top and the bottom row
FLOOR_M = 0.01  # what is lower is of the floor, whose distance the robot knows by its legs
AT = 0.15  # a thing is at a distance when it is within such a part of it
GOAL, GOAL_WITHIN_M = 5.0, 3.0
MIXED = 2  # rooms with things at every distance, for each seed
TITLES = {
    "alone": "All things at one distance:",
    "mixed": "Things at all these distances side by side:",
}
MOVING = ("moving", "crouched")
MODELS = ("off-line", "own", "told", "moving", "crouched")


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors (N,) in rad of features in other pictures than the middle one, by model.

    `distance_m` (N,) is true, from the middle picture's camera, NaN of the floor; `is_measured`
    (N,) tells by model which features two pictures show.
    """

    by_model: dict[str, Array]
    distance_m: Array
    is_measured: dict[str, Array]
    focal_px: float


@dataclass(frozen=True)
class NaoPlan:
    """The robot of all runs."""

    width_px: int
    encoders: float

    def made(self, world: World, seed: int) -> SweepingNao:
        """Return it in a world."""
        return SweepingNao(world, width_px=self.width_px, seed=seed, encoders=self.encoders)


def main() -> int:
    """Print the tables; exit 1 when the goal is missed."""
    arguments = _arguments()
    distances_m = arguments.distances
    nao = NaoPlan(arguments.width, arguments.encoders)
    alone: dict[float, list[Errors]] = {at_m: [] for at_m in distances_m}
    mixed: list[Errors] = []
    for seed in range(arguments.seeds):
        fixed = off_line_homographies(arguments.off_line_m, seed, nao)
        for at_m in distances_m:
            alone[at_m].append(errors_before([at_m], seed, fixed, nao))
        mixed += [errors_before(distances_m, 100 * k + seed, fixed, nao) for k in range(MIXED)]
        print(f"[{seed + 1}/{arguments.seeds}]", file=sys.stderr, flush=True)
    tables = {
        "alone": [figures_at(at_m, runs) for at_m, runs in alone.items()],
        "mixed": [figures_at(at_m, mixed) for at_m in (*distances_m, math.nan)],
    }
    for name, figures in tables.items():
        print(f"\n{TITLES[name]}\n\n{table_of(figures)}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(tables, indent=2))
    return max([judge(figures, name) for name, figures in tables.items()])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--distances", type=float, nargs="+", default=list(DISTANCES_M))
    parser.add_argument("--off-line-m", type=float, default=OFF_LINE_M)
    parser.add_argument("--encoders", type=float, default=1.0, help="how much the head's err")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def off_line_homographies(distance_m: float, seed: int, plan: NaoPlan) -> dict[str, Array | None]:
    """Return `middle_from_view` by the view's name, of nine pictures before walls, as the paper.

    Three more pictures of the top camera, between its row and the bottom camera's, join the two.
    """
    nao = plan.made(walls_at(distance_m, seed), seed)
    seen = nao.look_at(sweep_goals(from_left=seed % 2 == 0))
    between = nao.look_at(sweep_goals(from_left=seed % 2 == 0, pitch_deg=MIDDLE_ROW_DEG))
    views = [s.view for s in [*seen, *(s for s in between if s.view.camera == "top")]]
    links = _links(views)
    joined = join_by_homographies(views, links)
    return dict(zip((v.name for v in views), joined.middle_from_view, strict=True))


def _links(views: Sequence[View]) -> list[Link]:
    return link_views(views, find_shared(views, [find_features(view) for view in views]))


def errors_before(
    distances_m: Sequence[float], seed: int, fixed: dict[str, Array | None], plan: NaoPlan
) -> Errors:
    """Return the errors of a sweep before things, each at one of `distances_m`."""
    # Not the way the head came when the homographies were found: the play of the gears shows.
    nao = plan.made(things_at(distances_m, seed), 1000 + seed)
    seen = nao.look_at(sweep_goals(from_left=seed % 2 == 1))
    nao.crouch()
    lower = nao.look_at(sweep_goals(from_left=seed % 2 == 0))
    views, together = [s.view for s in seen], [s.view for s in (*seen, *lower)]
    of_all = [find_features(view) for view in together]
    features, shared_by_all = of_all[: len(views)], find_shared(together, of_all)
    shared = [s for s in shared_by_all if max(s.a, s.b) < len(views)]
    joined = join_by_homographies(views, link_views(views, shared))
    off_line = Joined(
        middle=joined.middle, links=[], reasons=[],
        middle_from_view=[fixed.get(view.name) for view in views],
    )  # fmt: skip
    moving, measured = _moving(views, features, shared, joined.middle)
    crouched, measured_crouched = _moving(together, features, shared_by_all, joined.middle)
    told_middle = views[joined.middle].torso_from_camera
    told = [
        of_view.rays @ (told_middle.inverse() @ view.torso_from_camera).matrix()[:3, :3].T
        for view, of_view in zip(views, features, strict=True)
    ]
    found = {
        "off-line": directions_by_homographies(off_line, features),
        "own": directions_by_homographies(joined, features),
        "told": told,
        "moving": moving,
        "crouched": crouched,
    }
    is_measured = {"moving": measured, "crouched": measured_crouched}
    return _errors(seen, features, joined.middle, found, is_measured)


def _moving(
    views: Sequence[View], features: Sequence[Features], shared: Sequence[Shared], middle: int
) -> tuple[list[Array], list[Array]]:
    """Return unit rays in the middle camera of features by view, and which were measured."""
    refined = refine_sweep(views, shared)
    distances = distances_of(refined, middle, -TORSO_M["stand"])
    seen = see_features(features, shared, refined, distances)
    turn = refined.stop_from_camera[middle].matrix()[:3, :3]
    return [s.directions @ turn for s in seen], [s.is_measured for s in seen]


def _errors(
    seen: Sequence[TrueView],
    features: Sequence[Features],
    middle: int,
    found: dict[str, list[Array]],
    is_measured: dict[str, list[Array]],
) -> Errors:
    by_model: dict[str, list[Array]] = {name: [] for name in found}
    measured: dict[str, list[Array]] = {name: [] for name in is_measured}
    distance_m = []
    for i, (true, of_view) in enumerate(zip(seen, features, strict=True)):
        if i == middle:
            continue
        points, known = true_points(true, of_view)
        away = seen[middle].world_from_camera.inverse() @ points
        length = np.linalg.norm(away, axis=1)
        for name, directions in found.items():
            by_model[name].append(_angle(directions[i], away)[known])
        distance_m.append(np.where(points[:, 2] > FLOOR_M, length, math.nan)[known])
        for name, flags in is_measured.items():
            measured[name].append(flags[i][known])
    return Errors(
        {name: np.concatenate(parts) for name, parts in by_model.items()},
        np.concatenate(distance_m),
        {name: np.concatenate(parts) for name, parts in measured.items()},
        seen[middle].view.lens.fx_px,
    )


def _angle(directions: Array, away: Array) -> Array:
    return np.arctan2(
        np.linalg.norm(np.cross(directions, away), axis=1), np.sum(directions * away, axis=1)
    )


def figures_at(distance_m: float, runs: Sequence[Errors]) -> dict[str, Any]:
    """Return the errors of things at that distance over all runs, by model; of the floor for NaN.

    Angles are root mean squares and medians over features, pixels those at the middle of a picture.
    """
    is_floor = math.isnan(distance_m)
    near = [
        np.isnan(run.distance_m) if is_floor else np.abs(run.distance_m / distance_m - 1) < AT
        for run in runs
    ]
    figures: dict[str, Any] = {
        "distance_m": distance_m, "features": int(sum(rows.sum() for rows in near))
    }  # fmt: skip
    focal_px = runs[0].focal_px
    off_line = _joined([run.by_model["off-line"] for run in runs], near)
    for name in MODELS:
        error = _joined([run.by_model[name] for run in runs], near)
        figures[name] = _spread(error, focal_px)
        if name in runs[0].is_measured:
            is_measured = _joined([run.is_measured[name] for run in runs], near)
            figures[name] |= {
                "share": float(is_measured.mean()) if len(is_measured) else math.nan,
                "measured": _spread(error[is_measured], focal_px),
                "off-line of measured": _spread(off_line[is_measured], focal_px),
                "guessed": _spread(error[~is_measured], focal_px),
            }
    return figures


def _joined(columns: Sequence[Array], which: Sequence[Array]) -> Array:
    return np.concatenate([c[rows] for c, rows in zip(columns, which, strict=True)])


def _spread(error: Array, focal_px: float) -> dict[str, Any]:
    error = error[np.isfinite(error)]
    if not len(error):
        return {"deg": math.nan, "px": math.nan, "median_deg": math.nan, "features": 0}
    rms = math.sqrt(np.mean(error**2))
    return {
        "deg": math.degrees(rms), "px": rms * focal_px,
        "median_deg": math.degrees(float(np.median(error))), "features": len(error),
    }  # fmt: skip


def table_of(figures: Sequence[dict[str, Any]]) -> str:
    """Return the table: a line for each distance, errors in pixels with degrees in brackets."""
    titles = ["things at, m", "features", *(f"{name}, px (deg)" for name in MODELS)]
    titles += [f"{fixed}/{name}" for name in MOVING for fixed in ("off-line", "own")]
    titles += [f"{name}: {part}, px" for name in MOVING for part in ("measured", "rest")]
    rows = []
    for figure in figures:
        row = [number(figure["distance_m"]) or "floor", str(figure["features"])]
        row += [f"{figure[name]['px']:.2f} ({figure[name]['deg']:.3f})" for name in MODELS]
        for name in MOVING:
            degrees = [figure[fixed]["deg"] for fixed in ("off-line", "own")]
            row += [f"{value / figure[name]['deg']:.1f}" for value in degrees]
        for name in MOVING:
            share = 100 * figure[name]["share"]
            row.append(f"{share:.0f} %: {figure[name]['measured']['px']:.2f}")
            row.append(f"{100 - share:.0f} %: {figure[name]['guessed']['px']:.2f}")
        rows.append(row)
    return markdown_table(titles, rows)


def judge(figures: Sequence[dict[str, Any]], name: str) -> int:
    """Print the goal beside what was reached; return 1 when it is missed."""
    missed = 0
    for figure in figures:
        if not figure["distance_m"] <= GOAL_WITHIN_M:
            continue
        for model in MOVING:
            own = figure[model]
            ratios = {
                "all features": figure["off-line"]["deg"] / own["deg"],
                "in the median": figure["off-line"]["median_deg"] / own["median_deg"],
                "measured ones": own["off-line of measured"]["deg"] / own["measured"]["deg"],
            }
            missed += min(ratios.values()) < GOAL
            words = ", ".join(
                f"{part} {ratio:.1f} times {'PASS' if ratio >= GOAL else 'MISS'}"
                for part, ratio in ratios.items()
            )
            print(f"{name}, {figure['distance_m']:g} m, {model}, goal {GOAL:g}: {words}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
