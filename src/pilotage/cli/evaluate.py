# SPDX-License-Identifier: Apache-2.0
"""The verb `evaluate`: a results folder against truth."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pilotage.cli import options
from pilotage.cli.errors import errors_to_exit

if TYPE_CHECKING:
    from pilotage.evaluation.evaluate import Comparison
    from pilotage.evaluation.metrics import Metrics


class Align(StrEnum):
    """How the trajectory is laid onto the truth before distances are taken."""

    se3 = "se3"
    origin = "origin"
    none = "none"


class TruthOf(StrEnum):
    """Whose poses the truth holds."""

    left = "left"
    body = "body"
    robot = "robot"


def evaluate(  # noqa: PLR0913, PLR0917, an argument for each option
    out: Annotated[Path, typer.Argument(help="Results folder of `pilotage localize`.")],
    truth: Annotated[
        Path | None,
        typer.Option(
            help="KITTI poses, TUM file, EuRoC csv, recording or results folder; without it the"
            " truth that came with the recording.",
            show_default=False,
        ),
    ] = None,
    align: Annotated[
        Align, typer.Option(help="Best fit, first pose on first pose, or as they are.")
    ] = Align.se3,
    truth_of: Annotated[
        TruthOf | None,
        typer.Option(help="Whose poses the truth holds, where it cannot be told."),
    ] = None,
    segment_m: Annotated[
        list[float] | None,
        typer.Option(help="Length of a segment; may be repeated.", show_default=False),
    ] = None,
    report: Annotated[bool, typer.Option(help="Draw report.html anew.")] = True,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage evaluate out/ --truth recordings/street/poses.txt

    Compare the results in OUT with truth: print the errors, write evaluation.json, and draw the
    report with the error over distance.
    """
    with errors_to_exit(debug=debug):
        from pilotage.errors import InputError
        from pilotage.evaluation.evaluate import evaluate_results

        if segment_m and min(segment_m) <= 0:
            raise InputError(f"--segment-m {min(segment_m)}: must be more than 0")
        comparison = evaluate_results(
            out,
            truth_path=truth,
            truth_of=truth_of.value if truth_of else None,
            alignment=align.value,
            lengths_m=tuple(segment_m) if segment_m else None,
        )
        if report:
            from pilotage.evaluation.report import write_report

            write_report(comparison.results, comparison)
        _print(comparison.metrics, str(out))
        if comparison.alone:
            _print_alone(comparison)


def _print_alone(comparison: Comparison) -> None:
    """Print what the stereo pairs reach by themselves, beside what joining them gave."""
    from rich.console import Console
    from rich.table import Table

    from pilotage.evaluation.verdict import alone_rows

    table = Table(title="joined, and each stereo pair alone")
    for heading in ("", "pairs with pose", "end", "ATE, rms", "ATE, largest"):
        table.add_column(heading, justify="right" if heading else "left")
    for row in alone_rows(comparison):
        table.add_row(*row)
    Console().print(table)


def _print(metrics: Metrics, title: str) -> None:
    from rich.console import Console
    from rich.table import Table

    from pilotage.evaluation.verdict import metric_rows

    figures = Table(title=title, show_header=False)
    figures.add_column(style="bold")
    figures.add_column(justify="right")
    for name, value in metric_rows(metrics):
        figures.add_row(name, value)
    console = Console()
    console.print(figures)
    if metrics.segments:
        segments = Table(title="over segments of the path")
        for heading in ("length", "segments", "translation", "rotation"):
            segments.add_column(heading, justify="right")
        for segment in metrics.segments:
            segments.add_row(
                f"{segment.length_m:.3g} m",
                str(segment.segments),
                f"{segment.translation_percent:.3f} %",
                f"{segment.rotation_deg_m:.5f} deg/m",
            )
        console.print(segments)
    if math.isfinite(metrics.end_error_percent):
        console.print(
            f"At the end {100 * metrics.end_error_m:.1f} cm off,"
            f" {metrics.end_error_percent:.3f} % of {metrics.truth_length_m:.2f} m"
        )
