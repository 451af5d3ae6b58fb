# SPDX-License-Identifier: Apache-2.0
"""The verb `recover`: a recording that was cut off made whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pilotage.cli import options
from pilotage.cli.errors import errors_to_exit, place_to_write, say_warning

if TYPE_CHECKING:
    from pilotage.recordings.mcap_recover import Recovery

LOSSES_SHOWN = 10
NS_PER_S = 1_000_000_000


def recover(
    file: Annotated[Path, typer.Argument(help="A .mcap or .mcap.part that was cut off.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="The whole file; by itself FILE without .part, or FILE.recovered.mcap.",
            show_default=False,
        ),
    ] = None,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage recover recordings/monday.mcap.part

    Make a recording whole that a crash, a kill or a full disk cut off: every complete message is
    kept, index and footer are made anew. FILE stays as it is.
    """
    with errors_to_exit(debug=debug):
        from pilotage.recordings.mcap_recover import recover as repair

        with place_to_write():
            recovery = repair(file, out)
        _say(recovery, file)


def _say(recovery: Recovery, file: Path) -> None:
    for loss in recovery.losses[:LOSSES_SHOWN]:
        say_warning(f"lost: {loss}")
    if len(recovery.losses) > LOSSES_SHOWN:
        say_warning(f"lost: {len(recovery.losses) - LOSSES_SHOWN} more such")
    for topic, count in sorted(recovery.kept.items()):
        typer.echo(f"{topic}: {count} messages")
    span_s = ((recovery.end_ns or 0) - (recovery.start_ns or 0)) / NS_PER_S
    lost = "nothing was lost" if recovery.was_whole else f"{recovery.lost_bytes} bytes lost"
    typer.echo(
        f"Kept {recovery.kept.total()} messages of {file}, {span_s:.3f} s; {lost}."
        f" Whole now: {recovery.out}"
    )
