# SPDX-License-Identifier: Apache-2.0
"""The verb `depth`: two pictures from two places in, distances in a results folder out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pilotage.cli import options
from pilotage.cli.errors import FAILED, errors_to_exit, fail, say_warning


def depth(  # noqa: PLR0913, PLR0917, an argument for each option
    standing: Annotated[Path, typer.Argument(help="Picture to measure in.")],
    crouching: Annotated[Path, typer.Argument(help="Picture of the same from another place.")],
    baseline_m: Annotated[
        float, typer.Option(help="Distance of the camera's two places, 0.001 to 1000.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the depths.")] = Path("out"),
    calibration: options.Calibration = None,
    fov_deg: options.FovDeg = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y", help="Say the distance of what this pixel shows; may be repeated."
        ),
    ] = None,
    baseline_sigma_m: Annotated[float, typer.Option(help="Standard error of the baseline.")] = 0.0,
    camera_height_m: Annotated[
        float | None,
        typer.Option(help="Of the first picture's camera, where known.", show_default=False),
    ] = None,
    config: options.Config = None,
    settings: options.Settings = None,
    overwrite: options.Overwrite = False,
    debug: options.Debug = False,
) -> None:
    """Example: pilotage depth standing.png crouching.png --baseline-m 0.11 --fov-deg 60.9 -o d/

    Measure how far things are from two pictures of one camera that moved a known distance between
    them, say as a robot stood and crouched. Every distance comes with its standard error. The
    folder holds a table, points, and the first picture with the distances in it. What cannot be
    measured is refused with the reason.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.depth import two_picture_config
        from pilotage.behaviors.depth_folder import depth_folder
        from pilotage.config import load_reconstruction_config

        summary = depth_folder(
            first=standing,
            second=crouching,
            out=out,
            baseline_m=baseline_m,
            baseline_sigma_m=baseline_sigma_m,
            camera_height_m=camera_height_m,
            calibration=calibration,
            fov_deg=fov_deg,
            at=[_pixel(word) for word in at or []],
            config=load_reconstruction_config(config, settings or [], base=two_picture_config()),
            overwrite=overwrite,
        )
        _conclude(summary, out)


def _pixel(word: str) -> tuple[float, float]:
    from pilotage.errors import InputError

    x, _, y = word.partition(",")
    try:
        return float(x), float(y)
    except ValueError:
        raise InputError(f"--at {word!r}: must be X,Y in pixels, as in --at 320,240") from None


def _conclude(summary: dict[str, Any], out: Path) -> None:
    if summary["reason"]:
        fail(f"no depth: {summary['reason']}; {summary['remedy']}", FAILED)
    if summary["warning"]:
        say_warning(summary["warning"])
    for place in summary["at"]:
        name = f"{place['x_px']:g},{place['y_px']:g}"
        if place["distance_m"] is None:
            typer.echo(f"{name}: no distance, {place['reason']}")
        else:
            typer.echo(f"{name}: {place['distance_m']:.3f} m +- {place['sigma_m']:.3f} m")
    typer.echo(
        f"{summary['points']} points, depth {summary['median_depth_m']:.2f} m in the median, known"
        f" to {100 * summary['median_relative_sigma']:.1f} %,"
        f" {_obstacles(summary)}, {summary['wall_s']:.1f} s; {out / 'depth.png'}"
    )


def _obstacles(summary: dict[str, Any]) -> str:
    if summary["ground"] is None:
        return "no ground seen, so no obstacles told"
    found = summary["obstacles"]
    if not found:
        return "nothing stands on the ground"
    nearest = found[0]
    side = "left" if nearest["bearing_deg"] >= 0 else "right"
    count = "1 obstacle" if len(found) == 1 else f"{len(found)} obstacles, the nearest"
    return (
        f"{count} {nearest['distance_m']:.2f} m away, {abs(nearest['bearing_deg']):.0f} degrees to"
        f" the {side}"
    )
