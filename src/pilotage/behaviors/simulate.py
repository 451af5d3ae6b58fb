# SPDX-License-Identifier: Apache-2.0
"""A drive through a simulated world with stereo cameras, recorded with its exact truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotage.behaviors.recorder import Moment, Recorder
from pilotage.errors import InputError
from pilotage.recordings.mcap_index import find_file, read_metadata
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.recordings.recording import SIMULATION
from pilotage.simulation import Drive, RobotModel, Simulation
from pilotage.simulation.camera_faults import written_rig
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.origin import Origin, origin_of
from pilotage.simulation.sensor import Sensor

OnMoment = Callable[[Moment], None]


@dataclass(frozen=True)
class Recorded:
    """What a simulated drive came to; `shots` are pairs, or pictures of each single camera."""

    shots: int
    length_m: float
    duration_s: float
    has_arrived: bool
    stops: int = 0


def record_drive(  # noqa: PLR0913, what a recording is made of
    *,
    simulation: Simulation,
    robot: RobotModel,
    drive: Drive,
    out: Path,
    width_px: int,
    rate_hz: float,
    sensor: Sensor,
    on_moment: OnMoment,
    pairs: Sequence[str] | None = None,
) -> Recorded:
    """Drive, and write pictures, odometry and truth to the MCAP file `out`.

    `pairs` names the stereo pairs that are recorded, by default all of the robot. on_moment is
    called every 20 ms of the drive. InputError for what cannot be recorded; RunError when the file
    cannot be written or the physics breaks down; what was written stays in `<out>.part`.
    """
    if not 0.5 <= rate_hz <= 60:
        raise InputError(f"rate {rate_hz:g} Hz: must lie from 0.5 to 60")
    rigs = robot.stereo_rigs(simulation, width_px, pairs, sensor.readout_s)
    cameras, seed = robot.pair_lenses(rigs), simulation.world.seed
    groups = camera_groups(simulation, cameras, sensor, seed=seed)
    way = Way(simulation)
    origin = origin_of(
        simulation, robot, drive, sensor, width_px=width_px, rate_hz=rate_hz, pairs=tuple(rigs)
    )
    with McapWriter(out) as writer:
        writer.write_metadata(SIMULATION, origin.to_record())
        for pair, rig in rigs.items():
            left, right = robot.pairs[pair]
            written = written_rig(rig, simulation.faults, pair)
            writer.add_rig(written, timestamp_ns=simulation.time_ns, left=left, right=right)
        recorder = Recorder(simulation, groups, writer)
        begin_ns, tries = simulation.time_ns, 0
        for time_ns in drive:
            way.go_on()
            # Between two steps of the drive too: no rate of pictures divides them all.
            while (shot_ns := begin_ns + round(tries * 1e9 / rate_hz)) <= time_ns:
                recorder.shoot(shot_ns)
                tries += 1
            recorder.note()
            on_moment(moment_of(simulation, drive, recorder))
        recorder.finish()
    return Recorded(recorder.shots, way.length_m, simulation.time_ns * 1e-9, drive.has_arrived)


def read_origin(path: str | Path) -> Origin | None:
    """Return with what a recording was simulated, None where it does not say so.

    InputError where the recording is no MCAP file, or what it says cannot be.
    """
    file = find_file(Path(path))
    record = read_metadata(file, SIMULATION)
    return None if record is None else Origin.from_record(record, f"{file}: {SIMULATION}")


def moment_of(simulation: Simulation, drive: Drive, recorder: Recorder) -> Moment:
    """Return how far the drive and its recording are."""
    return Moment(
        time_ns=simulation.time_ns,
        shots=recorder.shots,
        share_done=drive.progress_m / drive.path.length_m,
        world_from_robot=simulation.robot_pose(),
    )


class Way:
    """The true length of a way, m, added up at every call."""

    def __init__(self, simulation: Simulation) -> None:
        self.length_m = 0.0
        self._simulation = simulation
        self._here = simulation.robot_pose().translation_m

    def go_on(self) -> None:
        """Add the way since the last call."""
        here = self._simulation.robot_pose().translation_m
        self.length_m += float(np.linalg.norm(here - self._here))
        self._here = here
