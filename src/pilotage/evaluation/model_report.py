# SPDX-License-Identifier: Apache-2.0
"""report.html of a model: how much was placed, what it looks like, and what it rests on.

`python -m pilotage.evaluation.model_report OUT` draws it anew from a model's folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from pilotage.errors import InputError
from pilotage.evaluation import model_plots
from pilotage.evaluation.page import (
    appendix,
    figure_card,
    head,
    number_cards,
    run_alone,
    verdict_card,
    warnings_card,
    write_page,
)
from pilotage.evaluation.track_pictures import legend, track_figures
from pilotage.evaluation.verdict import missing_lines, model_words
from pilotage.evaluation.walk_sections import stop_path, walk_sections
from pilotage.models import Model, read_colmap_binary
from pilotage.pose_files import read_text
from pilotage.recordings.pictures import natural_key
from pilotage.results import COLMAP_BINARY, SUMMARY, WALK_PICTURES, is_results_folder


def draw_report(out: Path) -> None:
    """Draw the report of a model's folder; of the pictures those that are still where they were.

    InputError where the folder holds no model that was finished, or one that cannot be read.
    """
    if not is_results_folder(out):
        raise InputError(f"{out} is not a results folder: it has no {SUMMARY} of pilotage")
    summary = json.loads(read_text(out / SUMMARY))
    if "without_pose" not in summary:
        raise InputError(f"{out} holds no finished model; run pilotage reconstruct")
    model = read_colmap_binary(out / COLMAP_BINARY) if summary["posed"] else None
    write_page(out, Path(summary["source"]).name, _sections(out, summary, model))


def _sections(out: Path, summary: Mapping[str, Any], model: Model | None) -> Iterable[str]:
    source, is_walk = Path(summary["source"]), "stops" in summary
    yield head(source.name, str(source), summary)
    said = [model_words(summary)]
    if model is not None and summary["verdict"].startswith("unsure"):
        said.append(f"U{summary['verdict'][1:]}.")
    faults = [summary[key] for key in ("lens_fault", "length_fault") if key in summary]
    said += [f"{fault[0].upper()}{fault[1:]}." for fault in faults]
    yield verdict_card(said, is_bad=summary["verdict"] != "whole")
    missing = what_is_missing(summary["verdict"]) if is_walk else None
    yield warnings_card(
        missing_lines(summary["without_pose"]) if missing is None else missing,
        "Pictures without a pose" if missing is None else "Stops that are not where steps led",
    )
    yield _numbers(summary)
    if model is None:
        yield "<h2>Points and cameras</h2><p class='card'>There is no model to draw.</p>"
    else:
        names = [*model.names, *summary["without_pose"]]
        names.sort(key=lambda name: natural_key(Path(name)))
        yield from _cloud(model, summary, stop_path(out) if is_walk else None)
        if is_walk:
            yield from walk_sections(out, summary)
        yield from _pictures(model, names, out / WALK_PICTURES if is_walk else source)
        yield "<h2>What the model rests on</h2><div class='figures'>"
        lengths = model_plots.draw_track_lengths(model)
        yield figure_card(lengths, "points by the number of pictures that show them")
        yield figure_card(model_plots.draw_residual_counts(model), "residuals of observations")
        shown = model_plots.draw_pictures(model, names)
        yield figure_card(shown, "points and residual of each picture", wide=True)
        yield "</div>"
        if summary["without_pose"]:
            yield "<p class='made'>Shaded: pictures without a pose.</p>"
    yield appendix(out)


def what_is_missing(verdict: str) -> list[str]:
    """Return a line for each stretch of a walk that its verdict tells of."""
    return [] if verdict == "whole" else verdict.split("; ")


def _numbers(summary: Mapping[str, Any]) -> str:
    points, seen = summary["points"], summary["observations"]
    rms_px = summary["rms_px"]
    return number_cards(
        [
            (f"{summary['features']:,}", "features"),
            (f"{summary['matched_pairs']:,}", "matched pairs"),
            (f"{summary['tracks']:,}", "tracks"),
            (f"{points:,}", "points"),
            (f"{seen:,}", "observations"),
            (f"{seen / points:.1f}" if points else "-", "pictures a point"),
            ("-" if rms_px is None or not points else f"{rms_px:.2f} px", "residual, rms"),
        ]
    )


def _cloud(
    model: Model, summary: Mapping[str, Any], stops: model_plots.StopPath | None
) -> Iterable[str]:
    is_metric = summary["unit"] == "m"
    unit = "m" if is_metric else "model's unit"
    drawn, outside = model_plots.draw_cloud(
        model, unit, is_ordered=bool(summary.get("ordered", False)), stops=stops
    )
    yield "<h2>Points and cameras</h2><div class='figures'>"
    yield figure_card(drawn, "points and cameras from above and from the side", wide=True)
    yield "</div>"
    said = "Up is the mean of what is up in the pictures; 0 is where the first picture was taken."
    if stops is not None:
        said = "Up is as the robot stood at the first stop; 0 is between its feet there."
    if is_metric and stops is None:
        sigma = summary["lengths"]["sigma"] / summary["lengths"]["factor"]
        said += f" Lengths are metres by marks of a known size, to {100 * sigma:.1f} %."
    if not is_metric:
        said += (
            " From pictures alone the size is unknown: lengths are in a unit of the model's own."
        )
    if outside:
        said += f" {outside} of {len(model.points_in_world)} points lie outside, far from the rest."
    yield f"<p class='made'>{escape(said)}</p>"


def _pictures(model: Model, names: list[str], source: Path) -> Iterable[str]:
    place = {name: at for at, name in enumerate(names)}
    order = sorted(range(len(model.names)), key=lambda i: place[model.names[i]])
    figures = list(track_figures(model, order, source))
    yield "<h2>What was found again in the pictures</h2>"
    if figures:
        yield f"{legend()}<div class='figures'>{''.join(figures)}</div>"
    else:
        yield f"<p class='card'>The pictures are no longer in {escape(str(source))}.</p>"


if __name__ == "__main__":
    sys.exit(run_alone(draw_report))
