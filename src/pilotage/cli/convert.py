# SPDX-License-Identifier: Apache-2.0
"""The verb `convert`: a recording of one format written as another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pilotage.cli import options
from pilotage.cli.errors import errors_to_exit, place_to_write, say_warning, stop_on_terminate

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pilotage.recordings import BadFrame, StereoFrame

SKIPPED_SHOWN = 10


class Target(StrEnum):
    """What a recording can become."""

    kitti = "kitti"
    euroc = "euroc"
    mcap = "mcap"


def convert(  # noqa: PLR0913, PLR0917, an argument for each option
    recording: Annotated[Path, typer.Argument(help="Folder or file of a stereo camera.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="New folder, or .mcap file.")],
    to: Annotated[Target, typer.Option(help="Format to write.")],
    calibration: options.Calibration = None,
    rate_hz: options.RateHz = None,
    pair: options.Pair = None,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage convert recordings/street -o street.mcap --to mcap

    Write pictures, calibration, times and truth of RECORDING in another format. Pictures stay as
    they are, grey; only KITTI, which holds rectified pairs, gets them rectified where they are not.
    """
    with errors_to_exit(debug=debug):
        from pilotage.recordings import open_recording
        from pilotage.recordings.convert import FRONT
        from pilotage.recordings.convert import convert as write

        opened = open_recording(recording, calibration=calibration, rate_hz=rate_hz, pair=pair)

        def watch(
            frames: Iterable[StereoFrame | BadFrame],
        ) -> Iterable[StereoFrame | BadFrame]:
            return _watched(frames, opened.name, len(opened))

        with stop_on_terminate(), place_to_write():
            done = write(opened, out, to.value, watch=watch, pair=pair or FRONT)
        for bad in done.skipped[:SKIPPED_SHOWN]:
            say_warning(f"pair {bad.index} left out: {bad.reason}")
        if len(done.skipped) > SKIPPED_SHOWN:
            say_warning(f"{len(done.skipped) - SKIPPED_SHOWN} more pairs left out")
        for note in done.notes:
            say_warning(note)
        typer.echo(f"Wrote {done.pairs} of {len(opened)} pairs to {out}")


def _watched(
    frames: Iterable[StereoFrame | BadFrame], name: str, pairs: int
) -> Iterable[StereoFrame | BadFrame]:
    """Show a bar where stderr is a terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(frames, name, total=pairs, console=console, disable=not console.is_terminal)
