# SPDX-License-Identifier: Apache-2.0
"""The rover: two tracks, a mast, and two stereo cameras; it turns by letting its tracks slip."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.simulation.body import PREFIX, REST, Motion, Pose2
from pilotage.simulation.disturbance import Disturbance
from pilotage.simulation.faults import BODY, names_of
from pilotage.simulation.odometry import advanced
from pilotage.simulation.optics import camera_element

STEREO_BASE_M = 0.058
FORWARD_HEIGHT_M, FORWARD_PITCH_RAD = 0.60, math.radians(10)
DOWN_HEIGHT_M = 0.50
# Far enough ahead for the chassis and its tracks to stay out of the downward pictures.
HEAD_X_M = 0.56
FOVY_RAD = 2 * math.atan(960 / 2 / 855)  # the paper's camera

TRACK_GAUGE_M = 0.32
WHEEL_RADIUS_M = 0.07
WHEEL_X_M = (-0.135, -0.045, 0.045, 0.135)
LAG_S = 0.15
LIMITS = Motion(0.8, 0.0, 1.5)
CAPACITY_J = 60 * 3600.0  # a battery of 60 Wh
IDLE_W, MOTOR_EFFICIENCY = 6.0, 0.6
# Friction of sliding tracks yields a little, which keeps turning smooth; parked tracks must
# not creep down a slope, so their friction is stiff (MuJoCo's impratio).
IMPRATIO_ROLLING, IMPRATIO_PARKED = 0.1, 20.0
BEARING_N_M_S, BRAKE_N_M_S = 0.01, 200.0
PARKED_RAD_S = 0.02
_WHEEL_PRIORITY = 2  # above the ground's, while a fault takes the grip away


class Rover:
    """A tracked rover of 12 kg; frames `front_left`, `front_right`, `down_left`, `down_right`."""

    faults = names_of(BODY)
    capacity_j = CAPACITY_J

    def __init__(self) -> None:
        self.odometry = Pose2(0, 0, 0)
        self.motion = REST
        self.energy_j = 0.0
        self._wanted = REST
        self._until_ns = 0

    def mjcf(self) -> str:
        """Return chassis, mast, cameras, and each track as a row of sprung wheels."""
        sides = (("left", 0.5), ("right", -0.5))
        wheels = [(side, i) for side, _ in sides for i in range(len(WHEEL_X_M))]
        bodies = "".join(
            _wheel(side, i, x, share * TRACK_GAUGE_M)
            for side, share in sides
            for i, x in enumerate(WHEEL_X_M)
        )
        motors = "".join(_motor(f"{side}_{i}") for side, i in wheels)
        cameras = "".join(
            camera_element(f"{pair}_{side}", (x, share * STEREO_BASE_M, z), pitch, FOVY_RAD)
            for side, share in sides
            for pair, x, z, pitch in (
                ("front", HEAD_X_M + 0.01, FORWARD_HEIGHT_M, FORWARD_PITCH_RAD),
                ("down", HEAD_X_M, DOWN_HEIGHT_M, math.pi / 2),
            )
        )
        return _BODY.format(wheels=bodies, cameras=cameras, motors=motors)

    def bind(self, model: Any, data: Any, start: Transform, seed: int) -> None:
        """Stand at `start`. The rover draws nothing at random: physics alone makes it err."""
        del seed
        self._model, self._data = model, data
        self._robot = model.body(f"{PREFIX}robot").id
        names = [[f"{PREFIX}{side}_{i}" for i in range(len(WHEEL_X_M))] for side in _SIDES]
        # Left before right: (2, wheels of a side).
        self._motors = np.array([[model.actuator(n).id for n in side] for side in names])
        self._wheels = np.array([[model.geom(n).id for n in side] for side in names])
        self._spins = np.array([[model.joint(n).dofadr[0] for n in side] for side in names])
        self._grip = (1.0, 1.0)
        self._park(True)
        pose = model.body(f"{PREFIX}robot").jntadr[0]
        address = model.jnt_qposadr[pose]
        data.qpos[address : address + 3] = start.translation_m
        data.qpos[address + 3 : address + 7] = start.quaternion_wxyz

    def command(self, motion: Motion, until_ns: int) -> Motion:
        """Strive for `motion` until then; it cannot move sideways."""
        self._wanted = motion.within(LIMITS)
        self._until_ns = until_ns
        return self._wanted

    def before_step(self, time_ns: int, acting: Disturbance) -> None:
        """Give the motors their speeds, and the faults their way."""
        wanted = self._wanted if time_ns < self._until_ns else REST
        half_turn = wanted.angular_rad_s * TRACK_GAUGE_M / 2
        speeds = np.array([wanted.linear_m_s - half_turn, wanted.linear_m_s + half_turn])
        self._data.ctrl[self._motors] = (speeds * acting.speed / WHEEL_RADIUS_M)[:, None]
        for motors, left in zip(self._motors, acting.speed, strict=True):
            if left == 0:  # a blocked track stops at once
                self._data.act[self._model.actuator_actadr[motors]] = 0
        if acting.grip != self._grip:
            self._set_grip(acting.grip)
        rotation = self._data.xmat[self._robot].reshape(3, 3)
        self._data.xfrc_applied[self._robot, :3] = rotation[:, :2] @ acting.push_n
        is_moving = wanted != REST or bool(self._spinning().max() > PARKED_RAD_S)
        if is_moving == self._is_parked:
            self._park(not is_moving)

    def after_step(self, time_ns: int) -> None:
        """Count the tracks' turns, as encoders would, and the energy spent."""
        del time_ns
        step_s = self._model.opt.timestep
        spins = self._data.qvel[self._spins]
        left, right = (spins.sum(axis=1) * (WHEEL_RADIUS_M / len(WHEEL_X_M))).tolist()
        self.motion = Motion((left + right) / 2, 0.0, (right - left) / TRACK_GAUGE_M)
        self.odometry = advanced(self.odometry, self.motion, step_s)
        work_w = np.abs(self._data.actuator_force[self._motors] * spins).sum() / MOTOR_EFFICIENCY
        self.energy_j += (IDLE_W + float(work_w)) * step_s

    def _spinning(self) -> NDArray[np.float64]:
        return np.asarray(np.abs(self._data.qvel[self._spins]))

    def _park(self, is_parked: bool) -> None:
        """Hold the tracks and stiffen their friction, or let go."""
        self._is_parked = is_parked
        self._model.opt.impratio = IMPRATIO_PARKED if is_parked else IMPRATIO_ROLLING
        self._model.dof_damping[self._spins] = BRAKE_N_M_S if is_parked else BEARING_N_M_S

    def _set_grip(self, grip: tuple[float, float]) -> None:
        """Let the wheels' own friction rule where grip is lost, the ground's elsewhere."""
        ground = _ground_friction(self._model)
        for wheels, share in zip(self._wheels, grip, strict=True):
            self._model.geom_priority[wheels] = _WHEEL_PRIORITY if share < 1 else 0
            # MuJoCo wants some friction where there is a contact.
            self._model.geom_friction[wheels, 0] = max(share, 0.01) * ground
        self._grip = grip


_SIDES = ("left", "right")


def _ground_friction(model: Any) -> float:
    """Return the friction of the geom `ground`, or that of MuJoCo's default in other worlds."""
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "ground")
    return float(model.geom_friction[found, 0]) if found >= 0 else 1.0


def _wheel(side: str, number: int, x_m: float, y_m: float) -> str:
    name = f"{side}_{number}"
    return (
        f'<body name="{name}" pos="{x_m} {y_m} {WHEEL_RADIUS_M}">'
        f'<joint type="slide" axis="0 0 1" stiffness="5000" damping="60" springref="-0.0026"/>'
        f'<joint name="{name}" axis="0 1 0" armature="0.01" damping="{BEARING_N_M_S}"/>'
        f'<geom name="{name}" class="wheel"/></body>'
    )


def _motor(name: str) -> str:
    return (
        f'<general name="{name}" joint="{name}" dyntype="filterexact" dynprm="{LAG_S}" '
        f'gainprm="12" biastype="affine" biasprm="0 0 -12" forcerange="-3 3"/>'
    )


# Robot geoms touch the world (contype 1) and never each other. The battery at the rear balances
# the mast, so that the rover stands level.
_BODY = """
<mujoco model="rover">
 <compiler angle="radian"/>
 <default>
  <geom contype="2" conaffinity="1" group="2"/>
  <default class="wheel">
   <geom type="sphere" size="0.07" mass="0.35" friction="0.9 0.005 0.0001" condim="3"
         solref="0.01 1" solimp="0.9 0.95 0.002" rgba="0.1 0.1 0.1 1"/>
  </default>
  <default class="plate">
   <geom type="box" rgba="0.75 0.45 0.1 1"/>
  </default>
 </default>
 <worldbody>
  <body name="robot">
   <freejoint/>
   <geom name="chassis" class="plate" size="0.25 0.11 0.04" pos="0 0 0.12" mass="4.0"/>
   <geom name="battery" class="plate" size="0.07 0.08 0.02" pos="-0.155 0 0.18" mass="3.6"/>
   <geom name="mast" class="plate" size="0.015 0.015 0.22" pos="0.2 0 0.4" mass="0.7"/>
   <geom name="arm" class="plate" size="0.17 0.012 0.012" pos="0.36 0 0.63" mass="0.4"/>
   <geom name="front_cameras" class="plate" size="0.012 0.045 0.012"
         pos="{front}" mass="0.2"/>
   <geom name="down_cameras" class="plate" size="0.012 0.045 0.012"
         pos="{down}" mass="0.2"/>
   <geom name="hanger" class="plate" size="0.006 0.006 0.06" pos="0.535 0 0.57" mass="0.1"/>
   {{cameras}}{{wheels}}
  </body>
 </worldbody>
 <actuator>{{motors}}</actuator>
</mujoco>
""".format(
    # Behind and above their lenses, so that no camera looks at its own case.
    front=f"{HEAD_X_M - 0.015} 0 {FORWARD_HEIGHT_M + 0.01}",
    down=f"{HEAD_X_M} 0 {DOWN_HEIGHT_M + 0.015}",
)
