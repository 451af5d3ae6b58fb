# SPDX-License-Identifier: Apache-2.0
"""The verb `mosaic`: a sweep of the head in, one wide view in a results folder out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pilotage.cli import options
from pilotage.cli.errors import FAILED, errors_to_exit, fail, say_warning


def mosaic(  # noqa: PLR0913, PLR0917, an argument for each option
    source: Annotated[
        Path, typer.Argument(help="Recording of a Nao's stops, or a folder of pictures.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the view.")] = Path("out"),
    stop: Annotated[
        int | None,
        typer.Option(
            min=0, help="Which stop of the recording, the first is 0.", show_default=False
        ),
    ] = None,
    calibration: options.Calibration = None,
    fov_deg: options.FovDeg = None,
    overwrite: options.Overwrite = False,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage mosaic walk.mcap --stop 1 -o wide/

    Join pictures of one place in several directions into one wide picture, and sum their features
    as one camera would see them that looks straight ahead: by homographies, as if the camera had
    only turned, and, where the recording tells the head's angles, with cameras that move as the
    neck turns them. Pictures that cannot be joined are named with the reason.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.mosaic_folder import mosaic_folder

        summary = mosaic_folder(
            source=source,
            out=out,
            stop=stop,
            calibration=calibration,
            fov_deg=fov_deg,
            overwrite=overwrite,
        )
        _conclude(summary, out)


def _conclude(summary: dict[str, Any], out: Path) -> None:
    from pilotage.behaviors.mosaic_folder import MOSAIC, MOSAIC_MOVING

    for words in summary["bad_pictures"]:
        say_warning(words)
    if summary["status"] == "refused":
        fail(f"no wide view: {summary['reason']}; {summary['remedy']}", FAILED)
    for picture in summary["pictures"]:
        if not picture["is_joined"]:
            say_warning(f"{picture['name']}: not in {MOSAIC}: {picture['reason']}")
    count, moving = len(summary["pictures"]), summary["moving_centres"]
    words = f"{summary['joined']} of {count} pictures joined by homographies"
    if moving is not None:
        if moving["reason"]:
            say_warning(f"head angles are as told: {moving['reason']}")
        words += f"; all {count} by the neck's angles, with {moving['points']} points"
    shown = MOSAIC if moving is None else MOSAIC_MOVING
    typer.echo(f"{words}, {summary['features']} features, {summary['wall_s']:.1f} s; {out / shown}")
