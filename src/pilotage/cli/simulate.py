# SPDX-License-Identifier: Apache-2.0
"""The verb `simulate`: a drive through a simulated world, recorded."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from pilotage.cli.errors import errors_to_exit, say_warning, stop_on_terminate

SECONDS_BETWEEN_LINES = 5.0
RECORDING = "recording.mcap"


def simulate(  # noqa: PLR0913, PLR0917, an argument for each option
    world: Annotated[str, typer.Argument(help="yard, corridor, office, or an MJCF file.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="New folder for the recording.")],
    seed: Annotated[int, typer.Option(help="Of the world and of all that is random in it.")] = 0,
    ground: Annotated[
        str | None, typer.Option(help="Of a yard: asphalt, grass, gravel, soil or sand.")
    ] = None,
    path: Annotated[
        str, typer.Option(help="closed-10m, open-20m, square-12m, eight-30m, straight-5m, ...")
    ] = "closed-10m",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Option of the world; may be repeated."),
    ] = None,
    speed: Annotated[float, typer.Option(help="Of the drive, m/s.")] = 0.4,
    rate_hz: Annotated[float, typer.Option(help="Pairs a second.")] = 10.0,
    width: Annotated[int, typer.Option(help="Of the pictures, pixels; 4:3.")] = 640,
    faults: Annotated[
        Path | None, typer.Option(help="YAML list of faults: name, onset_s, size, camera.")
    ] = None,
    camera: Annotated[
        str, typer.Option(help="How its cameras err: good, ideal, realistic, or a YAML file.")
    ] = "good",
    debug: Annotated[bool, typer.Option(help="Show where an error came from.")] = False,
) -> None:
    """Example: pilotage simulate yard --seed 7 --ground gravel --path closed-10m -o yard7

    Drive the rover along a path and record its forward stereo camera, its own odometry and the
    truth. `pilotage localize yard7` then finds the way from the pictures. The same arguments give
    the same bytes.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.simulate import record_drive
        from pilotage.simulation import Drive, Simulation, load_world, read_faults
        from pilotage.simulation.sensor import read_sensor

        options = _options(world, ground, path, settings or [])
        loaded = load_world(world, seed=seed, options=options)
        acting = read_faults(faults) if faults is not None else ()
        sensor = read_sensor(camera)
        simulation = Simulation(loaded, "rover", seed=seed, faults=acting)
        drive = Drive(simulation, path, speed_m_s=speed)
        file = _prepare(out)
        with stop_on_terminate():
            done = record_drive(
                simulation=simulation,
                drive=drive,
                out=file,
                width_px=width,
                rate_hz=rate_hz,
                sensor=sensor,
                on_pair=_Lines(world),
            )
        if not done.has_arrived:
            say_warning(
                f"the rover did not reach the end of {path}; the recording ends where it is"
            )
        typer.echo(
            f"Drove {done.length_m:.2f} m in {done.duration_s:.1f} s, {done.pairs} pairs in {file}"
        )


def _options(world: str, ground: str | None, path: str, settings: list[str]) -> dict[str, object]:
    """Return the world's options; a yard keeps the path free by itself."""
    import yaml

    from pilotage.errors import InputError

    options: dict[str, object] = {}
    if world == "yard":
        options["path"] = path
    if ground is not None:
        options["ground"] = ground
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise InputError(f"--set {setting!r}: must be KEY=VALUE")
        options[key] = yaml.safe_load(value)
    return options


def _prepare(out: Path) -> Path:
    """Return the file to write in the folder `out`, which is made."""
    from pilotage.errors import InputError

    file = out / RECORDING
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} exists and is no folder; choose another name")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{out}: cannot be made ({error.strerror}); choose another name"
        ) from error
    return file


class _Lines:
    """Says every few seconds how far the drive is."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._said = self._started = time.monotonic()

    def __call__(self, pairs: int, part: float) -> None:
        now = time.monotonic()
        if now - self._said < SECONDS_BETWEEN_LINES:
            return
        self._said = now
        rate = pairs / max(now - self._started, 1e-9)
        print(
            f"{self._name}: {100 * part:.0f} % of the way, {pairs} pairs, {rate:.1f} pairs/s",
            file=sys.stderr,
            flush=True,
        )
