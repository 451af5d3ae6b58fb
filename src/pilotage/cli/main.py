# SPDX-License-Identifier: Apache-2.0
"""The command `pilotage`: one verb per file of this folder."""

from __future__ import annotations

from typing import Annotated

import typer

from pilotage.cli.convert import convert
from pilotage.cli.depth import depth
from pilotage.cli.evaluate import evaluate
from pilotage.cli.localize import localize
from pilotage.cli.mosaic import mosaic
from pilotage.cli.reconstruct import reconstruct
from pilotage.cli.recover import recover
from pilotage.cli.simulate import simulate

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(localize)
app.command()(reconstruct)
app.command()(depth)
app.command()(mosaic)
app.command()(evaluate)
app.command()(convert)
app.command()(recover)
app.command()(simulate)


def _print_version(wanted: bool) -> None:
    if wanted:
        from pilotage import __version__

        typer.echo(f"pilotage {__version__}")
        raise typer.Exit


@app.callback()
def pilotage(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Say which it is."),
    ] = False,
) -> None:
    """Example: pilotage localize recordings/street -o out/

    Robots that know where they are from their cameras alone.
    """


def main() -> None:
    """Run the command line; the exit code is 0 done, 1 failed, 2 misuse."""
    app()


if __name__ == "__main__":
    main()
