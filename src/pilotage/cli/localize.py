# SPDX-License-Identifier: Apache-2.0
"""The verb `localize`: a recording in, a results folder out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pilotage.behaviors.choice import Use
from pilotage.cli import options
from pilotage.cli.drawing import draw_report
from pilotage.cli.errors import (
    FAILED,
    errors_to_exit,
    fail,
    say_warning,
    stop_on_terminate,
)

if TYPE_CHECKING:
    from pilotage.behaviors.choice import Choice
    from pilotage.behaviors.localize import Selection
    from pilotage.config import UserConfig


def localize(  # noqa: PLR0913, PLR0917, an argument for each option
    recording: Annotated[Path, typer.Argument(help="Folder, .mcap or video of a stereo camera.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path("out"),
    calibration: options.Calibration = None,
    pair: options.Pair = None,
    use: Annotated[
        Use | None,
        typer.Option(
            help="Of several stereo pairs the one that looks ahead or down, all of them joined, or"
            " the rover paper's choice between them; by default all that are calibrated against"
            " the robot.",
            show_default=False,
        ),
    ] = None,
    config: options.Config = None,
    settings: options.Settings = None,
    rate_hz: options.RateHz = None,
    every: Annotated[int, typer.Option(help="Take each n-th pair only.")] = 1,
    start: Annotated[int, typer.Option(help="First pair to take, counted from 0.")] = 0,
    end: Annotated[
        int | None, typer.Option(help="First pair not to take any more.", show_default=False)
    ] = None,
    report: options.Report = True,
    overwrite: options.Overwrite = False,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage localize recordings/street -o out/

    Find where the camera was at every stereo pair of RECORDING. Formats are recognised by
    themselves: KITTI, EuRoC, MCAP (ROS 2), folders of left and right or side-by-side pictures,
    video. Several stereo pairs are compared and joined. Ctrl-C ends the run early and keeps what
    was computed.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.choice import choose
        from pilotage.behaviors.localize import Selection
        from pilotage.config import load_config

        selection = Selection(start=start, end=end, every=every)
        used = load_config(config, settings or [])
        choice = choose(
            recording, config=used, pair=pair, use=use, calibration=calibration, rate_hz=rate_hz
        )
        run = _track_joint if choice.is_joint else _track_one
        with stop_on_terminate():
            summary = run(choice, used, selection, out, overwrite)
        fault = draw_report("pilotage.evaluation.report", out) if report else None
        _conclude(summary, out)
        if fault is not None:
            fail(f"report not drawn: {fault}", FAILED)


def _track_one(
    choice: Choice, config: UserConfig, selection: Selection, out: Path, overwrite: bool
) -> dict[str, Any]:
    from pilotage.behaviors.localize import localize as track
    from pilotage.cli.progress import make_progress

    (source,) = choice.sources
    opened = source.recording
    odometry = source.make_odometry()
    with make_progress(opened.name, len(selection.indices(len(opened)))) as progress:
        return track(
            recording=opened,
            odometry=odometry,
            config=source.config,
            out=out,
            selection=selection,
            overwrite=overwrite,
            on_pair=progress.on_pair,
            warnings=choice.warnings(),
        )


def _track_joint(
    choice: Choice, config: UserConfig, selection: Selection, out: Path, overwrite: bool
) -> dict[str, Any]:
    from pilotage.behaviors.localize_joint import localize_joint
    from pilotage.cli.progress import make_progress

    first = choice.sources[0].recording
    rule = "paper" if choice.use is Use.paper else "chi_square"
    with make_progress(first.name, len(selection.indices(len(first)))) as progress:
        return localize_joint(
            choice=choice,
            judge=config.judge(rule=rule),
            out=out,
            selection=selection,
            overwrite=overwrite,
            on_instant=progress.on_pair,
        )


def _conclude(summary: dict[str, Any], out: Path) -> None:
    from pilotage.evaluation.verdict import failure_words, tracking_words
    from pilotage.results import REPORT

    for warning in summary["warnings"]:
        say_warning(warning)
    typer.echo(
        f"{tracking_words(summary)} {summary['cpu_ms_per_pair']:.1f} CPU-ms a pair,"
        f" {summary['peak_rss_mb']:.0f} MB. Results in {out}"
        + (f", see {out / REPORT}" if (out / REPORT).exists() else "")
    )
    failure = failure_words(summary)
    if failure is not None:
        fail(failure, FAILED)
    if summary["state"] == "interrupted":
        fail(f"interrupted after {summary['pairs']} pairs; what was computed is kept", FAILED)
