# SPDX-License-Identifier: Apache-2.0
"""The verb `simulate`: a drive through a simulated world, recorded."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pilotage.cli.errors import (
    FAILED,
    errors_to_exit,
    fail,
    is_full_disk,
    say_warning,
    stop_on_terminate,
)
from pilotage.cli.options import Debug

if TYPE_CHECKING:
    from pilotage.behaviors.stop_and_go import StopPlan
    from pilotage.calibration.nao_head import HeadAngles
    from pilotage.simulation import Body, RobotModel, World

RECORDING = "recording.mcap"
YARD = "yard"
ROVER_OPTIONS, NAO_OPTIONS = "Of the rover", "Of the Nao"


def simulate(  # noqa: PLR0913, PLR0917, an argument for each option
    world: Annotated[str, typer.Argument(help="yard, corridor, office, or an MJCF file.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="New folder for the recording.")],
    robot: Annotated[str, typer.Option(help="rover or nao.")] = "rover",
    seed: Annotated[int, typer.Option(help="Of the world and of all that is random in it.")] = 0,
    ground: Annotated[
        str | None, typer.Option(help="Of a yard: asphalt, grass, gravel, soil or sand.")
    ] = None,
    path: Annotated[
        str | None,
        typer.Option(
            help="closed-10m, open-20m, square-12m, eight-30m, straight-5m, ...; by default one "
            "that fits into the world.",
            show_default=False,
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Option of the world; may be repeated."),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Of the drive, m/s; by default 0.4, a Nao's 0.095.", show_default=False),
    ] = None,
    rate_hz: Annotated[
        float, typer.Option(help="Pairs a second.", rich_help_panel=ROVER_OPTIONS)
    ] = 10.0,
    width: Annotated[int, typer.Option(help="Of the pictures, pixels; 4:3.")] = 640,
    pairs: Annotated[
        str | None,
        typer.Option(
            help="Stereo pairs: front, down, or front,down.",
            show_default="all",
            rich_help_panel=ROVER_OPTIONS,
        ),
    ] = None,
    stop_every: Annotated[
        int, typer.Option(help="Steps from stop to stop.", rich_help_panel=NAO_OPTIONS)
    ] = 12,
    looks: Annotated[
        str,
        typer.Option(
            help="At each stop: yaws, degrees, or YAW:PITCH; left and down positive.",
            rich_help_panel=NAO_OPTIONS,
        ),
    ] = "33.5,0,-33.5",
    crouch: Annotated[
        bool,
        typer.Option(
            "--crouch",
            help="Look again from 11 cm lower at each stop.",
            rich_help_panel=NAO_OPTIONS,
        ),
    ] = False,
    walking_hz: Annotated[
        float,
        typer.Option(help="Pictures a second on the way, 0 for none.", rich_help_panel=NAO_OPTIONS),
    ] = 0.0,
    encoders: Annotated[
        float,
        typer.Option(
            help="How much the head's encoders err: 1 as a Nao's, 0 not at all.",
            rich_help_panel=NAO_OPTIONS,
        ),
    ] = 1.0,
    faults: Annotated[
        Path | None, typer.Option(help="YAML list of faults: name, onset_s, size, camera.")
    ] = None,
    camera: Annotated[
        str, typer.Option(help="How its cameras err: good, ideal, realistic, or a YAML file.")
    ] = "good",
    debug: Debug = False,
) -> None:
    """Example: pilotage simulate yard --seed 7 --ground gravel --path closed-10m -o yard7

    Drive a robot along a path and record its cameras, its own odometry and the truth. The rover
    drives with a stereo camera looking ahead and one looking down; `pilotage localize yard7` then
    finds the way from the pictures. The Nao stops, looks around with its two single cameras, and
    walks on. The same arguments give the same bytes.
    """
    with errors_to_exit(debug=debug):
        from pilotage.behaviors.simulate import record_drive
        from pilotage.behaviors.stop_and_go import record_stops
        from pilotage.cli.live import make_drive_view
        from pilotage.simulation import Drive, Simulation, read_faults, read_sensor, robot_model

        model = robot_model(robot)
        plan = _plan(model, stop_every, looks, crouch=crouch, walking_hz=walking_hz)
        chosen = model.chosen_pairs(pairs)
        loaded = _load(world, seed, path or model.paths[0], _options(ground, settings or []))
        acting = read_faults(faults) if faults is not None else ()
        sensor = read_sensor(camera)
        body = _body(model, encoders)
        simulation = Simulation(loaded, body, seed=seed, faults=acting)
        path = _fitting(loaded, model, path)
        drive = Drive(simulation, path, speed_m_s=model.speed_m_s if speed is None else speed)
        shots, file = "looks" if plan else "pairs", out / RECORDING
        view = make_drive_view(
            f"{loaded.name}, {path}", drive.points_in_world, drive.path.length_m, shots
        )
        job: dict[str, Any] = {
            "simulation": simulation, "robot": model, "drive": drive, "out": file,
            "width_px": width, "sensor": sensor, "on_moment": view.on_moment,
        }  # fmt: skip
        with stop_on_terminate(), _kept_when_interrupted(file), view:
            if plan is not None:
                done = record_stops(**job, plan=plan)
            else:
                done = record_drive(**job, pairs=chosen, rate_hz=rate_hz)
        if not done.has_arrived:
            say_warning(
                f"the {robot} did not reach the end of {path}; the recording ends where it is"
            )
        seen = f"{done.stops} stops, {done.shots} {shots}" if plan else f"{done.shots} {shots}"
        typer.echo(f"Went {done.length_m:.2f} m in {done.duration_s:.1f} s, {seen} in {file}")


@contextmanager
def _kept_when_interrupted(file: Path) -> Iterator[None]:
    """Make the folder, which goes again where nothing comes into it.

    Say what an interrupt or a full disk left behind; the latter asks for another place.
    """
    from pilotage.errors import InputError, RunError
    from pilotage.recordings.mcap_writer import PART_SUFFIX

    is_new = _make_folder(file.parent)
    part = file.with_name(file.name + PART_SUFFIX)
    recover = f"`pilotage recover {part}` makes what was recorded whole"
    try:
        yield
    except KeyboardInterrupt:
        fail("interrupted" + (f"; {recover}" if part.exists() else ""), FAILED)
    except RunError as error:
        if is_full_disk(error):
            raise InputError(f"{error}; choose another place with -o, or {recover}") from error
        raise
    finally:
        if is_new:
            with suppress(OSError):  # there is something in it
                file.parent.rmdir()


def _plan(
    model: RobotModel, stop_every: int, looks: str, *, crouch: bool, walking_hz: float
) -> StopPlan | None:
    """Return when a robot with a head stops and where it looks, None for others."""
    from pilotage.behaviors.stop_and_go import StopPlan
    from pilotage.errors import InputError

    if not model.singles:
        if crouch or walking_hz:
            raise InputError("--crouch and --walking-hz are for a robot with a head: --robot nao")
        return None
    words = looks.replace(",", " ").split()
    return StopPlan(
        steps=stop_every,
        looks=tuple(_look(word) for word in words),
        crouches=crouch,
        walking_hz=walking_hz,
    )


def _body(model: RobotModel, encoders: float) -> Body:
    """Return the robot's body, with encoders that err so much where it has a head."""
    from pilotage.errors import InputError
    from pilotage.simulation import Encoders

    if model.singles:
        return model.make_body(encoders=Encoders().scaled(encoders))
    if encoders != 1:
        raise InputError("--encoders is for a robot with a head: --robot nao")
    return model.make_body()


def _look(word: str) -> HeadAngles:
    """Return the look that `YAW` or `YAW:PITCH` means, degrees."""
    from pilotage.calibration.nao_head import HeadAngles
    from pilotage.errors import InputError

    yaw, _, pitch = word.partition(":")
    try:
        return HeadAngles(math.radians(float(yaw)), math.radians(float(pitch or 0)))
    except ValueError:
        raise InputError(f"--looks {word!r}: must be YAW or YAW:PITCH in degrees") from None


def _options(ground: str | None, settings: list[str]) -> dict[str, object]:
    """Return the world's options as they were given."""
    import yaml

    from pilotage.errors import InputError

    options: dict[str, object] = {} if ground is None else {"ground": ground}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals:
            raise InputError(f"--set {setting!r}: must be KEY=VALUE")
        options[key] = yaml.safe_load(value)
    return options


def _load(name: str, seed: int, path: str, options: dict[str, object]) -> World:
    """Return the world; a yard grows with the path and keeps it free by itself."""
    from pilotage.simulation import load_world
    from pilotage.simulation.yard import YardOptions, side_for_m

    if name == YARD:
        size_m = max(YardOptions.size_m, side_for_m(path))
        options = {"path": path, "size_m": size_m, **options}
    return load_world(name, seed=seed, options=options)


def _fitting(world: World, model: RobotModel, path: str | None) -> str:
    """Return the path to take: the given one, which has to fit, or the first that does."""
    from pilotage.simulation import FreeFloor

    floor = FreeFloor(world, model.radius_m)
    if path is None:
        return floor.choose(model.paths)
    floor.check(path)
    return path


def _make_folder(out: Path) -> bool:
    """Make the folder `out` and return whether there was none."""
    from pilotage.errors import InputError

    is_new = not out.exists()
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} exists and is no folder; choose another name")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{out}: cannot be made ({error.strerror}); choose another name"
        ) from error
    return is_new
