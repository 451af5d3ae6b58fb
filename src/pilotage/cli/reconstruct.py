# SPDX-License-Identifier: Apache-2.0
"""The verb `reconstruct`: pictures in, a model in a results folder out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pilotage.cli import options
from pilotage.cli.drawing import draw_report
from pilotage.cli.errors import FAILED, errors_to_exit, fail, say_warning


def reconstruct(  # noqa: PLR0913, PLR0917, an argument for each option
    pictures: Annotated[Path, typer.Argument(help="Folder of pictures of one camera.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the model.")] = Path("out"),
    calibration: options.Calibration = None,
    fov_deg: options.FovDeg = None,
    unordered: Annotated[
        bool, typer.Option("--unordered", help="The pictures do not follow each other.")
    ] = False,
    config: options.Config = None,
    settings: options.Settings = None,
    report: options.Report = True,
    overwrite: options.Overwrite = False,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage reconstruct pictures/ --fov-deg 60.9 -o model/

    Find where each picture was taken and what it shows, from pictures alone (structure from
    motion). The model is written for COLMAP (text and binary), as PLY and as a trajectory, and
    shown by a report; lengths are in the model's own unit. Pictures that cannot be placed are
    named with the reason.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.model_folder import reconstruct_folder
        from pilotage.config import load_reconstruction_config

        summary = reconstruct_folder(
            pictures=pictures,
            out=out,
            calibration=calibration,
            fov_deg=fov_deg,
            ordered=not unordered,
            config=load_reconstruction_config(config, settings or []),
            overwrite=overwrite,
        )
        fault = draw_report("pilotage.evaluation.model_report", out) if report else None
        _conclude(summary, out)
        if fault is not None:
            fail(f"report not drawn: {fault}", FAILED)


def _conclude(summary: dict[str, Any], out: Path) -> None:
    from pilotage.evaluation.verdict import model_words
    from pilotage.results import REPORT, SUMMARY

    for name, words in summary["without_pose"].items():
        say_warning(f"{name}: {words}")
    if summary["posed"] == 0:
        fail(model_words(summary), FAILED)
    shown = REPORT if (out / REPORT).exists() else SUMMARY
    typer.echo(f"{model_words(summary)}. Model in {out}, see {out / shown}")
