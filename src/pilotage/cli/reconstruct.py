# SPDX-License-Identifier: Apache-2.0
"""The verb `reconstruct`: pictures in, a model in a results folder out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pilotage.cli import options
from pilotage.cli.drawing import draw_report
from pilotage.cli.errors import FAILED, errors_to_exit, fail, say_warning
from pilotage.errors import InputError

if TYPE_CHECKING:
    from pilotage.behaviors.square_marks import MarkSize


def reconstruct(  # noqa: PLR0913, PLR0917, an argument for each option
    source: Annotated[
        Path,
        typer.Argument(
            metavar="PICTURES|RECORDING",
            help="Folder of pictures of one camera, or a recording of a robot that stops and looks"
            " around (.mcap, or a folder with one).",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the model.")] = Path("out"),
    calibration: options.Calibration = None,
    fov_deg: options.FovDeg = None,
    refine_fov: Annotated[
        bool,
        typer.Option(
            "--refine-fov", help="Find a better field of view than --fov-deg from the pictures."
        ),
    ] = False,
    mark_size_m: Annotated[
        float | None,
        typer.Option(
            help="Side of the black square of printed marks (AprilTag, ArUco) that the pictures"
            " show, for lengths in metres.",
            show_default=False,
        ),
    ] = None,
    mark_family: Annotated[str, typer.Option(help="Family of the marks.")] = "apriltag-36h11",
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
    shown by a report; lengths are in the model's own unit, or in metres where --mark-size-m tells
    the side of printed marks. Pictures that cannot be placed are
    named with the reason.

    Of a recorded walk with stops (pilotage simulate office --robot nao) all cameras and turns of
    the head at a stop count as one, joints and steps take part, lengths are metres, and each stop
    is placed or said to be lost.
    """
    with errors_to_exit(debug=debug):
        from pilotage.recordings.motion import find_mcap

        marks = _mark_size(mark_size_m, mark_family)
        if find_mcap(source) is None:
            from pilotage.behaviors.model_folder import reconstruct_folder
            from pilotage.config import load_reconstruction_config

            summary = reconstruct_folder(
                pictures=source,
                out=out,
                calibration=calibration,
                fov_deg=fov_deg,
                ordered=not unordered,
                config=load_reconstruction_config(config, settings or []),
                refine_fov=refine_fov,
                marks=marks,
                overwrite=overwrite,
            )
        else:
            from pilotage.behaviors.walk_folder import reconstruct_recording

            _check_options_of_walk(calibration, fov_deg, refine_fov=refine_fov, unordered=unordered)
            summary = reconstruct_recording(
                recording=source,
                out=out,
                config=config,
                settings=settings or [],
                marks=marks,
                overwrite=overwrite,
            )
        fault = draw_report("pilotage.evaluation.model_report", out) if report else None
        _conclude(summary, out)
        if fault is not None:
            fail(f"report not drawn: {fault}", FAILED)


def _mark_size(side_m: float | None, family: str) -> MarkSize | None:
    if side_m is None:
        return None
    from pilotage.behaviors.square_marks import MarkSize

    return MarkSize(side_m=side_m, family=family)


def _check_options_of_walk(
    calibration: Path | None, fov_deg: float | None, *, refine_fov: bool, unordered: bool
) -> None:
    given = {
        "--calibration": calibration is not None,
        "--fov-deg": fov_deg is not None,
        "--refine-fov": refine_fov,
        "--unordered": unordered,
    }
    for name, is_given in given.items():
        if is_given:
            raise InputError(f"{name}: a recording tells that itself; leave it out")


def _conclude(summary: dict[str, Any], out: Path) -> None:
    from pilotage.evaluation.verdict import missing_lines, model_words
    from pilotage.results import REPORT, SUMMARY

    if "stops" in summary:
        if summary["verdict"] != "whole":
            say_warning(summary["verdict"])
    else:
        lines = missing_lines(summary["without_pose"])
        # One reason for all pictures is that of the failure, which says it.
        for words in lines if summary["posed"] or len(lines) > 1 else []:
            say_warning(words)
        if summary["posed"] and summary["verdict"].startswith("unsure"):
            say_warning(summary["verdict"])
    if "lens_fault" in summary:
        say_warning(summary["lens_fault"])
    if summary["posed"] and "length_fault" in summary:
        say_warning(f"--mark-size-m: {summary['length_fault']}")
    if summary["posed"] == 0:
        fail(model_words(summary), FAILED)
    shown = REPORT if (out / REPORT).exists() else SUMMARY
    typer.echo(f"{model_words(summary)}. Model in {out}, see {out / shown}")
