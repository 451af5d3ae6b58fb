# SPDX-License-Identifier: Apache-2.0
"""The Nao: a body that walks by kinematics, a head with two cameras, a stand and a crouch.

Its joints and feet are not simulated: it moves as told, with the errors of a walk on top.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pilotage import Transform
from pilotage.calibration.nao_head import (
    CAMERAS,
    FIELD_OF_VIEW_DEG,
    HEAD_Z_M,
    HeadAngles,
    clamped,
    toward,
)
from pilotage.errors import InputError
from pilotage.simulation.body import PREFIX, REST, Motion, Pose2
from pilotage.simulation.disturbance import Disturbance
from pilotage.simulation.encoders import Encoders
from pilotage.simulation.gait import Gait
from pilotage.simulation.odometry import advanced
from pilotage.simulation.optics import camera_element
from pilotage.simulation.options import unknown
from pilotage.simulation.sight import free_m, height_below_m

FOVY_RAD = math.radians(FIELD_OF_VIEW_DEG[1])
CROUCH_M = 0.11  # how much lower a crouching Nao is; the paper's depth baseline
TORSO_M = {"stand": 0.333, "crouch": 0.333 - CROUCH_M}
RISE_M_S = 0.08
LIMITS = Motion(0.095, 0.05, 0.5)
MASS_KG = 5.4
CAPACITY_J = 48.6 * 3600
IDLE_W, WALKING_W = 20.0, 45.0
LOOK_NS = 20_000_000  # how often it feels for what is in its way
FEELERS_M = ((0.1, 0.1), (0.1, -0.1), (0.45, 0.1), (0.45, -0.1))  # height, to the left
REACH_M = 0.15
PUSH_DECAY_S = 0.25


class Nao:
    """A Nao of version 4 or 5; frames `top` and `bottom`. It halts before what is in its way.

    `head` is true, `told_head` is what its `encoders` say.
    """

    faults = frozenset({"slip", "slip_left", "slip_right", "push_forward", "push_left"})
    capacity_j = CAPACITY_J

    def __init__(self, encoders: Encoders | None = None) -> None:
        self.encoders = Encoders() if encoders is None else encoders
        self.odometry = Pose2(0, 0, 0)
        self.motion = REST
        self.energy_j = 0.0
        self.head = HeadAngles(0.0, 0.0)
        self._head_goal = self.head
        self._head_way = np.zeros(2)
        self._time_ns = 0
        self._posture = "stand"
        self._torso_m = TORSO_M["stand"]
        self._wanted, self._until_ns = REST, 0
        self._shove_m_s = np.zeros(2)
        self._is_blocked = False
        self._acting = Disturbance()

    def mjcf(self) -> str:
        """Return ground frame and torso, both moved by the clock, and the head on its neck."""
        cameras = "".join(
            camera_element(name, (x, 0.0, z), pitch, FOVY_RAD)
            for name, (x, z, pitch) in CAMERAS.items()
        )
        return _BODY.format(neck=HEAD_Z_M, cameras=cameras)

    def bind(self, model: Any, data: Any, start: Transform, seed: int) -> None:
        """Stand at `start`; `seed` is that of the walk's errors and of the encoders' noise."""
        self._seed = seed
        self._model, self._data = model, data
        self._mocaps = [model.body(PREFIX + n).mocapid[0] for n in ("robot", "torso")]
        joints = [model.joint(PREFIX + n) for n in ("head_yaw", "head_pitch")]
        self._head_qpos = [joint.qposadr[0] for joint in joints]
        self._head_dofs = [joint.dofadr[0] for joint in joints]
        x_m, y_m, self._height_m = (float(v) for v in start.translation_m)
        w, _, _, z = start.quaternion_wxyz
        self._place = Pose2(x_m, y_m, 2 * math.atan2(z, w))
        self._gait = Gait(np.random.default_rng(seed))
        self._step_s = float(model.opt.timestep)
        self._show()

    @property
    def steps(self) -> int:
        """Return how many steps it has taken."""
        return self._gait.steps

    @property
    def told_head(self) -> HeadAngles:
        """Return the angles that the encoders tell; asked again at the same time, the same."""
        return self.encoders.read(self.head, self._head_way, seed=[self._seed, self._time_ns])

    @property
    def robot_from_torso(self) -> Transform:
        """Return where its legs hold the torso, by its own joints: a shaken body does not know."""
        return Transform(translation_m=[0.0, 0.0, self._torso_m])

    @property
    def posture(self) -> str | None:
        """Return `stand` or `crouch`, or None while on the way between them."""
        return self._posture if self._torso_m == TORSO_M[self._posture] else None

    def command(self, motion: Motion, until_ns: int) -> Motion:
        """Walk so until then; a Nao that does not stand stays where it is."""
        self._wanted = motion.within(LIMITS) if self.posture == "stand" else REST
        self._until_ns = until_ns
        return self._wanted

    def turn_head(self, yaw_rad: float, pitch_rad: float) -> HeadAngles:
        """Start turning the head; return the goal within the limits of joints and shell."""
        self._head_goal = clamped(HeadAngles(yaw_rad, pitch_rad))
        return self._head_goal

    def take_posture(self, name: str) -> None:
        """Start to `stand` or to `crouch`; it stops walking first. InputError for other names."""
        if name not in TORSO_M:
            raise InputError(f"posture {name!r} {unknown(name, TORSO_M)}")
        self._posture = name
        self._wanted = REST

    def before_step(self, time_ns: int, acting: Disturbance) -> None:
        """Settle what is wanted for the next step."""
        self._acting = acting
        wanted = self._wanted if time_ns < self._until_ns else REST
        self.motion = self._gait.advance(wanted, self._step_s)
        if time_ns % LOOK_NS == 0 and self.motion != REST:
            self._is_blocked = self._feels_obstacle()

    def after_step(self, time_ns: int) -> None:
        """Move the true body; the odometry believes in the walk without its errors."""
        self._time_ns = time_ns
        step_s = self._step_s
        self.odometry = advanced(self.odometry, self.motion, step_s)
        true = self._gait.true_motion(self.motion)
        grip = 0.0 if self._is_blocked else sum(self._acting.grip) / 2
        push = np.asarray(self._acting.push_n) * step_s / MASS_KG
        self._shove_m_s = (self._shove_m_s + push) * math.exp(-step_s / PUSH_DECAY_S)
        moved = Motion(
            grip * true.linear_m_s + float(self._shove_m_s[0]),
            grip * true.lateral_m_s + float(self._shove_m_s[1]),
            grip * true.angular_rad_s,
        )
        self._place = advanced(self._place, moved, step_s)
        self._torso_m = toward(self._torso_m, TORSO_M[self._posture], RISE_M_S * step_s)
        self._turn_head(step_s)
        self.energy_j += (IDLE_W if self.motion == REST else WALKING_W) * step_s
        if moved != REST:
            self._follow_ground()
        self._show()

    def _turn_head(self, step_s: float) -> None:
        before, self.head = self.head, self.head.turned(self._head_goal, step_s)
        way = np.sign(np.subtract(self.head, before))
        self._head_way = np.where(way == 0, self._head_way, way)

    def _follow_ground(self) -> None:
        above = np.array([self._place.x_m, self._place.y_m, self._height_m + 0.1])
        height = height_below_m(self._model, self._data, above)
        # Its feet do not fall off edges: it stays at the height it had.
        if height is not None and height > self._height_m - 0.1:
            self._height_m = height

    def _feels_obstacle(self) -> bool:
        way = math.atan2(self.motion.lateral_m_s, self.motion.linear_m_s) + self._place.yaw_rad
        if self.motion.linear_m_s == 0 and self.motion.lateral_m_s == 0:
            return False
        ahead = np.array([math.cos(way), math.sin(way), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        here = np.array([self._place.x_m, self._place.y_m, self._height_m])
        for up_m, aside_m in FEELERS_M:
            origin = here + aside_m * left + [0, 0, up_m]
            way_m = free_m(self._model, self._data, origin, ahead)
            if way_m is not None and way_m < REACH_M:
                return True
        return False

    def _show(self) -> None:
        """Hand the pose to MuJoCo."""
        ground, torso = self._mocaps
        place = self._place.at_height(self._height_m)
        shaken = place @ self._gait.sway() @ self.robot_from_torso
        for mocap, pose in ((ground, place), (torso, shaken)):
            self._data.mocap_pos[mocap] = pose.translation_m
            self._data.mocap_quat[mocap] = pose.quaternion_wxyz
        self._data.qpos[self._head_qpos] = (self.head.yaw_rad, self.head.pitch_rad)
        self._data.qvel[self._head_dofs] = 0


# Nothing of it is solid: what is in its way it feels by rays instead.
_BODY = """
<mujoco model="nao">
 <compiler angle="radian"/>
 <default>
  <geom contype="0" conaffinity="0" group="2" mass="0.1" rgba="0.85 0.85 0.87 1"/>
 </default>
 <worldbody>
  <body name="robot" mocap="true">
   <geom name="left_leg" type="capsule" size="0.035" fromto="0 0.05 0.06 0 0.05 0.18"/>
   <geom name="right_leg" type="capsule" size="0.035" fromto="0 -0.05 0.06 0 -0.05 0.18"/>
   <geom name="left_foot" type="box" size="0.07 0.04 0.02" pos="0.02 0.05 0.02"/>
   <geom name="right_foot" type="box" size="0.07 0.04 0.02" pos="0.02 -0.05 0.02"/>
  </body>
  <body name="torso" mocap="true">
   <geom name="chest" type="box" size="0.045 0.06 0.1" rgba="0.8 0.3 0.1 1"/>
   <geom name="left_arm" type="capsule" size="0.025" fromto="0 0.1 0.07 0.05 0.11 -0.12"/>
   <geom name="right_arm" type="capsule" size="0.025" fromto="0 -0.1 0.07 0.05 -0.11 -0.12"/>
   <body name="neck" pos="0 0 {neck}" gravcomp="1">
    <joint name="head_yaw" axis="0 0 1"/>
    <body name="head" gravcomp="1">
     <joint name="head_pitch" axis="0 1 0"/>
     <geom name="skull" type="sphere" size="0.052" pos="0 0 0.05"/>
     {cameras}
    </body>
    <geom name="collar" type="sphere" size="0.02"/>
   </body>
  </body>
 </worldbody>
</mujoco>
"""
