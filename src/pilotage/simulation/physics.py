# SPDX-License-Identifier: Apache-2.0
"""A body in a world: physics by MuJoCo, and poses at any instant of the last moments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.errors import InputError, RunError
from pilotage.simulation.body import PREFIX, Body, Pose2
from pilotage.simulation.disturbance import disturbance
from pilotage.simulation.faults import Fault, check_faults
from pilotage.simulation.history import PoseHistory
from pilotage.simulation.mark_covers import cover_marks
from pilotage.simulation.models import robot_model
from pilotage.simulation.optics import MUJOCO_FROM_CAMERA
from pilotage.simulation.options import check_seed, unknown
from pilotage.simulation.scene import WALK_PREFIX
from pilotage.simulation.sight import height_below_m
from pilotage.simulation.solids import Solids
from pilotage.simulation.walkers import Walk, read_walk
from pilotage.simulation.world import World, start_of

STEP_NS = 2_000_000
REMEMBERED_STEPS = 200  # 0.4 s: longer than any exposure, read-out and want of step together
SETTLING_STEPS = 400
SEARCH_HEIGHT_M = 1.0  # the ground under the start lies below this
MOST_PUSHED_M = 0.1  # by what it stands in, while it comes to rest


_BREAKDOWNS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


class Simulation:
    """One body in one world on its own clock; the same arguments give the same bits.

    `seed` is that of what the body does at random. InputError when the world's MJCF is broken, a
    fault does not fit the body, or there is no ground at the start.
    """

    def __init__(
        self,
        world: World,
        body: str | Body = "rover",
        *,
        seed: int = 0,
        faults: Sequence[Fault] = (),
    ) -> None:
        self.world = world
        self.body = robot_model(body).make_body() if isinstance(body, str) else body
        self.faults = tuple(faults)
        self.seed = check_seed(seed)
        spec = world.spec()
        self._walks = [
            read_walk(text.name, text.data)
            for text in spec.texts
            if text.name.startswith(WALK_PREFIX)
        ]
        self._start = start_of(spec, world.name)
        self._covers = cover_marks(spec, world, self.faults)
        self.model: Any = _compile(spec, world, self.body)
        self.data: Any = mujoco.MjData(self.model)
        self._cameras = _cameras(self.model)
        check_faults(self.faults, body_faults=self.body.faults, cameras=self.camera_names)
        self._mocap = [self._mocap_of(walk) for walk in self._walks]
        mounts = {int(body) for body in self.model.cam_bodyid}
        self._parts = {
            name.removeprefix(PREFIX): body
            for body in range(self.model.nbody)
            if (name := self.model.body(body).name).startswith(PREFIX)
        }
        moving = {body for body in range(self.model.nbody) if moves(self.model, body)}
        self._remembered = np.array(sorted(mounts | set(self._parts.values()) | moving))
        self._history = PoseHistory(len(self._remembered), REMEMBERED_STEPS, STEP_NS)
        self._time_ns = 0
        self._begin(self.seed)

    @property
    def time_ns(self) -> int:
        """Return the time of the newest step, nanoseconds since the start."""
        return self._time_ns

    @property
    def camera_names(self) -> list[str]:
        """Return the cameras, those of the robot without its prefix."""
        return list(self._cameras)

    def advance(self, until_ns: int) -> None:
        """Step until the clock stands at `until_ns` or up to one step (2 ms) after it.

        RunError when the physics broke down; MuJoCo would go on from the start, as if new.
        """
        while self._time_ns < until_ns:
            self._step()
        self._check_sanity()

    def robot_pose(self, time_ns: int | None = None) -> Transform:
        """Return the true world_from_robot, now or at a time of the last 0.4 s."""
        return self.part_pose("robot", time_ns)

    def part_pose(self, name: str, time_ns: int | None = None) -> Transform:
        """Return world_from_part of a part of the body, `robot` or `torso`, as `robot_pose`."""
        if name not in self._parts:
            raise InputError(f"part {name!r} {unknown(name, self._parts)}")
        return self.body_pose(self._parts[name], self._time_ns if time_ns is None else time_ns)

    def body_pose(self, body: int, time_ns: int) -> Transform:
        """Return world_from_body of a body of the model that moves, at a time of the last 0.4 s."""
        return self._history.pose(int(np.searchsorted(self._remembered, body)), time_ns)

    def camera_pose(self, name: str, time_ns: int | None = None) -> Transform:
        """Return world_from_camera (x right, y down, z forward), now or within the last 0.4 s.

        That is where it was built in and calibrated; faults that move it are not in it.
        InputError when there is no such camera, or the time is not remembered.
        """
        return self.camera_poses(name, [self._time_ns if time_ns is None else time_ns])[0]

    def camera_poses(self, name: str, times_ns: Sequence[int]) -> list[Transform]:
        """Return `camera_pose` at several times, as a rolling shutter or a long exposure needs."""
        if name not in self._cameras:
            raise InputError(f"camera {name!r} {unknown(name, self._cameras)}")
        camera = self._cameras[name]
        mount = int(self.model.cam_bodyid[camera])
        body_from_mujoco = Transform(
            translation_m=self.model.cam_pos[camera], quaternion_wxyz=self.model.cam_quat[camera]
        )
        body_from_camera = body_from_mujoco @ MUJOCO_FROM_CAMERA
        return [self.body_pose(mount, time) @ body_from_camera for time in times_ns]

    def _begin(self, seed: int) -> None:
        """Put the body on the ground, let it come to rest, and start the clock."""
        x_m, y_m, yaw_rad = self._start
        mujoco.mj_kinematics(self.model, self.data)
        top = np.array([x_m, y_m, SEARCH_HEIGHT_M])
        height_m = height_below_m(self.model, self.data, top)
        if height_m is None:
            raise InputError(f"{self.world.name}: no ground below the start {x_m, y_m}; add one")
        start = Pose2(x_m, y_m, yaw_rad).at_height(height_m)
        self.body.bind(self.model, self.data, start, seed)
        self._move_things(0)
        self._check_room()
        mujoco.mj_step1(self.model, self.data)
        for _ in range(SETTLING_STEPS):
            self.body.before_step(0, disturbance((), 0))
            mujoco.mj_step2(self.model, self.data)
            mujoco.mj_step1(self.model, self.data)
        self._remember()
        self._check_sanity()
        pushed_m = np.linalg.norm(self.robot_pose().translation_m - start.translation_m)
        if pushed_m > MOST_PUSHED_M:
            raise InputError(
                f"{self.world.name}: the robot does not fit at the start x {x_m:.2f}, y {y_m:.2f} "
                f"m: it was pushed {pushed_m:.2f} m away; move the start, or what is there"
            )

    def _check_room(self) -> None:
        """Raise InputError when a camera of the body stands inside something from the start."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        self.solids = Solids(self.model, self.data)
        for name, camera in self._cameras.items():
            if self.model.camera(camera).name.startswith(PREFIX):
                self.check_free(name, self.data.cam_xpos[camera], 0)

    def check_free(self, camera: str, point_m: NDArray[np.float64], time_ns: int) -> None:
        """Raise InputError when a point (3,) of the world lies inside something that stands still.

        The message names world, thing, place and time, and that it is the place of that camera.
        """
        holder = self.solids.around(point_m)
        if holder is not None:
            x_m, y_m, z_m = point_m.tolist()
            raise InputError(
                f"{self.world.name}: camera {camera} is inside {holder} at x {x_m:.2f}, y "
                f"{y_m:.2f}, z {z_m:.2f} m, {time_ns / 1e9:.2f} s from the start; move the start, "
                "choose another path or seed, or clear the way"
            )

    def _check_sanity(self) -> None:
        """Raise RunError when the physics broke down or a pose is none, from wherever it comes."""
        broke_down = any(self.data.warning[warning].number for warning in _BREAKDOWNS)
        if broke_down or not np.isfinite(self.data.xpos).all():
            raise RunError(
                f"{self.world.name}: the physics broke down, {self._time_ns / 1e9:.3f} s from "
                "the start; look for bodies of little mass or stiff joints in the world"
            )

    def _step(self) -> None:
        """Act on the state of this moment, then move on to the next and see where things are.

        The two halves of MuJoCo's step in this order leave poses that belong to the new time.
        """
        self.body.before_step(self._time_ns, disturbance(self.faults, self._time_ns))
        mujoco.mj_step2(self.model, self.data)
        self._time_ns += STEP_NS
        self.body.after_step(self._time_ns)
        self._move_things(self._time_ns)
        mujoco.mj_step1(self.model, self.data)
        self._remember()

    def _remember(self) -> None:
        poses = self.data.xpos[self._remembered], self.data.xquat[self._remembered]
        self._history.add(self._time_ns, *poses)

    def _move_things(self, time_ns: int) -> None:
        """Put walkers where they are by now, and leaves on the marks that are covered."""
        for cover in self._covers:
            cover.move(self.model, self.data, time_ns)
        for walk, mocap in zip(self._walks, self._mocap, strict=True):
            self.data.mocap_pos[mocap, :2], self.data.mocap_quat[mocap] = walk.pose(time_ns / 1e9)

    def _mocap_of(self, walk: Walk) -> int:
        found = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, walk.body)
        mocap = int(self.model.body_mocapid[found]) if found >= 0 else -1
        if mocap < 0:
            raise InputError(
                f"{self.world.name}: text '{WALK_PREFIX}{walk.body}' names no mocap body; "
                f'write <body name="{walk.body}" mocap="true">'
            )
        return mocap


def moves(model: Any, body: int) -> bool:
    """Tell whether a body of MuJoCo's model ever moves, by the physics or by the clock."""
    return bool(model.body_weldid[body] != 0 or model.body_mocapid[body] >= 0)


def _cameras(model: Any) -> dict[str, int]:
    """Return the number of each camera by name; the robot's come before a world's namesakes."""
    numbers = {model.camera(i).name: i for i in range(model.ncam)}
    robots = {name for name in numbers if name.startswith(PREFIX)}
    others = {name: number for name, number in numbers.items() if name not in robots}
    return others | {n.removeprefix(PREFIX): i for n, i in numbers.items() if n in robots}


def _compile(spec: Any, world: World, body: Body) -> Any:
    """Return the model of the world with the body in it, with the options our bodies need."""
    spec.option.timestep = STEP_NS / 1e9
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.tolerance = 1e-6  # poses agree to 1 um over 5 s with 1e-8, at a fifth less time
    child = mujoco.MjSpec.from_string(body.mjcf())
    try:
        spec.attach(child, prefix=PREFIX, frame=spec.worldbody.add_frame())
        return spec.compile()
    except ValueError as error:
        raise world.fault(error) from error
