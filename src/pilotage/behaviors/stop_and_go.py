# SPDX-License-Identifier: Apache-2.0
"""A simulated Nao's walk, recorded: it stops, looks around with both cameras, and walks on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pilotage import Transform
from pilotage.behaviors.recorder import Recorder
from pilotage.behaviors.simulate import OnMoment, Recorded, Way, moment_of
from pilotage.calibration.nao_head import (
    clamped,
    head_from_camera,
    neck_from_head,
    torso_from_neck,
)
from pilotage.errors import InputError, RunError
from pilotage.recordings.mcap_writer import ROBOT, McapWriter
from pilotage.recordings.recording import SIMULATION
from pilotage.robots.robot import HeadAngles
from pilotage.robots.simulated import SimulatedNao
from pilotage.simulation import Drive, RobotModel, Simulation
from pilotage.simulation.camera_group import CameraGroup, camera_groups
from pilotage.simulation.nao import Nao
from pilotage.simulation.origin import origin_of
from pilotage.simulation.sensor import Sensor

TORSO, NECK, HEAD = "torso", "neck", "head"
AHEAD = HeadAngles(0.0, 0.0)
# The second paper's six pictures: these yaws, both cameras.
LOOKS = tuple(HeadAngles(math.radians(yaw_deg), 0.0) for yaw_deg in (33.5, 0.0, -33.5))
NOTE_NS = 100_000_000
SETTLING_NS = 200_000_000  # a head at its goal still trembles
PATIENCE_NS = 10_000_000_000  # no turn of the head and no crouch takes so long


@dataclass(frozen=True, kw_only=True)
class StopPlan:
    """When to stop and what to look at: after `steps` steps, at each of `looks`, standing.

    With `crouches` each stop is looked at a second time, 11 cm lower. `walking_hz` pictures a
    second are taken on the way as well, 0 for none. InputError names what cannot be.
    """

    steps: int = 12
    looks: tuple[HeadAngles, ...] = LOOKS
    crouches: bool = False
    walking_hz: float = 0.0

    def __post_init__(self) -> None:
        if self.steps < 1:
            raise InputError(f"stop every {self.steps} steps: must be 1 or more")
        if not 0 <= self.walking_hz <= 30:
            raise InputError(f"{self.walking_hz:g} pictures a second on the way: must be 0 to 30")
        if not self.looks:
            raise InputError("no look is given; name one yaw at least, say 0")
        for look in self.looks:
            if clamped(look) != look:
                near = ":".join(f"{math.degrees(angle):.1f}" for angle in clamped(look))
                wanted = ":".join(f"{math.degrees(angle):g}" for angle in look)
                raise InputError(
                    f"look {wanted} degrees: joints and shell do not let the head there; "
                    f"the nearest is {near}"
                )

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as a recording holds it."""
        looks_rad = [list(look) for look in self.looks]
        return {
            "steps": self.steps, "looks_rad": looks_rad, "crouches": self.crouches,
            "walking_hz": self.walking_hz,
        }  # fmt: skip


def record_stops(  # noqa: PLR0913, what a recording is made of
    *,
    simulation: Simulation,
    robot: RobotModel,
    drive: Drive,
    out: Path,
    width_px: int,
    plan: StopPlan,
    sensor: Sensor,
    on_moment: OnMoment,
) -> Recorded:
    """Walk, and write pictures, head angles, odometry and truth to the MCAP file `out`.

    on_moment is called ten times a second and after each look. InputError for what cannot be
    recorded; RunError when the file cannot be written, or head or posture do not get where they are
    to be; what was written stays in `<out>.part`.
    """
    cameras, seed = robot.single_lenses(width_px), simulation.world.seed
    groups = camera_groups(simulation, cameras, sensor, seed=seed)
    origin = origin_of(simulation, robot, drive, sensor, width_px=width_px, stops=plan.to_dict())
    with McapWriter(out) as writer, SimulatedNao(simulation) as nao:
        writer.write_metadata(SIMULATION, origin.to_record())
        for name, group in cameras.items():
            writer.add_camera(name, group[name])
        seats = {(HEAD, name): head_from_camera(name) for name in cameras}
        writer.add_static_transforms(seats, timestamp_ns=simulation.time_ns)
        recorder = _NaoRecorder(simulation, groups, writer)
        walk = _Walk(simulation, nao, drive, recorder, plan, on_moment)
        walk.run()
        recorder.finish()
    return Recorded(
        recorder.shots,
        walk.way.length_m,
        simulation.time_ns * 1e-9,
        drive.has_arrived,
        stops=walk.stops,
    )


class _NaoRecorder(Recorder):
    """Writes the joints of the head as well, and the truth of torso and cameras."""

    def __init__(
        self, simulation: Simulation, groups: Mapping[str, CameraGroup], writer: McapWriter
    ) -> None:
        super().__init__(simulation, groups, writer)
        self._nao = _nao_of(simulation)

    def note(self) -> None:
        """Write the head's angles beside odometry, moving frames and truth, once for each time."""
        now_ns, head = self._simulation.time_ns, self._nao.told_head
        if now_ns > self._newest_note_ns:
            angles = {"HeadYaw": head.yaw_rad, "HeadPitch": head.pitch_rad}
            self._writer.write_joints(timestamp_ns=now_ns, positions_rad=angles)
        super().note()

    def _moving_frames(self) -> dict[tuple[str, str], Transform]:
        head = self._nao.told_head
        return {
            (ROBOT, TORSO): self._nao.robot_from_torso,
            (TORSO, NECK): torso_from_neck(head.yaw_rad),
            (NECK, HEAD): neck_from_head(head.pitch_rad),
        }

    def _write_truth_of(self, time_ns: int) -> None:
        super()._write_truth_of(time_ns)
        simulation = self._simulation
        poses = {TORSO: simulation.part_pose(TORSO, time_ns)}
        poses |= {name: simulation.camera_pose(name, time_ns) for name in self._groups}
        for frame, pose in poses.items():
            self._writer.write_frame_truth(frame, timestamp_ns=time_ns, world_from_frame=pose)


class _Walk:
    """One walk: the steps from stop to stop, and what is done at each."""

    def __init__(  # noqa: PLR0913, PLR0917, all it works with
        self,
        simulation: Simulation,
        nao: SimulatedNao,
        drive: Drive,
        recorder: Recorder,
        plan: StopPlan,
        on_moment: OnMoment,
    ) -> None:
        self.stops = 0
        self.way = Way(simulation)
        self._simulation = simulation
        self._nao = nao
        self._body = _nao_of(simulation)
        self._drive = drive
        self._recorder = recorder
        self._plan = plan
        self._on_moment = on_moment
        self._next_note_ns = 0

    def run(self) -> None:
        """Look around at the start, after each so many steps, and at the end."""
        self._look_around()
        stopped_at, next_ns, rate_hz = self._body.steps, 0, self._plan.walking_hz
        for time_ns in self._drive:
            self._go_on()
            if self._body.steps - stopped_at >= self._plan.steps:
                self._look_around()
                stopped_at = self._body.steps
            elif rate_hz and time_ns >= next_ns:
                next_ns = time_ns + round(1e9 / rate_hz)
                self._shoot()
        if self._body.steps > stopped_at:
            self._look_around()

    def _look_around(self) -> None:
        """Stop, take pictures at each look, standing and perhaps crouching, and be ready to go."""
        self._nao.stop()
        self._wait(lambda: not self._nao.state().is_moving)
        self.stops += 1
        for posture in ("stand", "crouch") if self._plan.crouches else ("stand",):
            self._nao.take_posture(posture)
            self._wait(partial(self._has_posture, posture))
            for look in self._plan.looks:
                self._look(look)
                self._shoot()
        self._nao.take_posture("stand")
        self._look(AHEAD)
        self._wait(partial(self._has_posture, "stand"))

    def _has_posture(self, name: str) -> bool:
        return self._nao.state().posture == name

    def _look(self, look: HeadAngles) -> None:
        goal = self._nao.turn_head(look)
        # The true angles: what the encoders tell never meets the goal.
        self._wait(lambda: self._body.head == goal)

    def _wait(self, is_done: Callable[[], bool]) -> None:
        """Let time pass until it is done, and then until it has settled."""
        begin_ns = self._simulation.time_ns
        while not is_done():
            if self._simulation.time_ns - begin_ns > PATIENCE_NS:
                raise RunError("the Nao's head or posture did not get where it was to be")
            self._pass()
        settled_ns = self._simulation.time_ns + SETTLING_NS
        while self._simulation.time_ns < settled_ns:
            self._pass()

    def _pass(self) -> None:
        self._simulation.advance(self._simulation.time_ns + 20_000_000)
        self._go_on()

    def _go_on(self) -> None:
        self.way.go_on()
        if self._simulation.time_ns >= self._next_note_ns:
            self._next_note_ns = self._simulation.time_ns + NOTE_NS
            self._note()

    def _shoot(self) -> None:
        self._recorder.shoot()
        self._note()

    def _note(self) -> None:
        self._recorder.note()
        self._on_moment(moment_of(self._simulation, self._drive, self._recorder))


def _nao_of(simulation: Simulation) -> Nao:
    if not isinstance(simulation.body, Nao):
        raise InputError("only a Nao stops to look around; make the simulation with body='nao'")
    return simulation.body
