# SPDX-License-Identifier: Apache-2.0
"""A small world that renders fast, and shots and recordings of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import Camera
from pilotage.behaviors.simulate import record_drive
from pilotage.recordings import StereoFrame, open_recording
from pilotage.simulation import Drive, Fault, Motion, Simulation, World, load_world, robot_model
from pilotage.simulation.camera_group import CameraGroup, Shot
from pilotage.simulation.sensor import Sensor

Picture = NDArray[np.uint8]
QUIET = Sensor.ideal()
LEFT, RIGHT = "front_left", "front_right"
WIDTH_PX = 160
FOREVER_NS = 10**15
PERIOD_NS = 100_000_000

WORLD = """
<mujoco>
 <custom>
  <text name="surface:floor" data="gravel seed=7 scale=4"/>
  <text name="surface:wall" data="poster seed=9 scale=8"/>
 </custom>
 <asset>
  <material name="floor" rgba="0.4 0.4 0.4 1"/>
  <material name="wall" rgba="0.6 0.4 0.3 1"/>
  <material name="red" rgba="0.8 0.06 0.06 1"/>
 </asset>
 <worldbody>
  <light type="directional" dir="-0.4 0.3 -1"/>
  <geom name="ground" type="plane" size="0 0 1" material="floor" priority="1" friction="0.9"/>
  <geom name="wall" type="box" size="0.1 4 1.5" pos="{wall_x_m} 0 1.5" material="wall"/>
  <geom name="post" type="box" size="0.05 0.05 0.6" pos="2 0.3 0.6" rgba="0.1 0.1 0.1 1"/>
  <geom name="mark_a" type="cylinder" size="0.2 0.001" pos="2 -0.1 0" material="red"
        contype="0" conaffinity="0"/>
 </worldbody>
</mujoco>
"""


def small_world(folder: Path, *, wall_x_m: float = 5.0) -> World:
    """Return a floor of stones, a wall ahead, a post, and the red mark A."""
    file = folder / "small.xml"
    file.write_text(WORLD.format(wall_x_m=wall_x_m))
    return load_world(file, seed=4)


def lenses(simulation: Simulation) -> dict[str, Camera]:
    """Return the rover's forward cameras."""
    rig = robot_model("rover").stereo_rig(simulation, "front", WIDTH_PX)
    return {LEFT: rig.left, RIGHT: rig.right}


def group_of(simulation: Simulation, sensor: Sensor, *, seed: int = 1) -> CameraGroup:
    return CameraGroup(simulation, lenses(simulation), sensor, seed=seed)


def shots(  # noqa: PLR0913, what a series is made of
    world: World,
    *,
    faults: Sequence[Fault] = (),
    sensor: Sensor | None = None,
    motion: Motion | None = None,
    count: int = 3,
    seed: int = 1,
) -> list[Shot]:
    """Return shots 100 ms apart, the first after 100 ms, of a rover that moves so, or stands."""
    simulation = Simulation(world, faults=faults)
    group = group_of(simulation, sensor or Sensor(), seed=seed)
    if motion is not None:
        simulation.body.command(motion, FOREVER_NS)
    taken = []
    for number in range(1, count + 1):
        simulation.advance(number * PERIOD_NS)
        shot = group.take()
        assert shot is not None
        taken.append(shot)
    return taken


def record(
    world: World, out: Path, *, faults: Sequence[Fault] = (), sensor: Sensor | None = None
) -> Path:
    """Drive a metre and return the recording of it, 5 pairs a second."""
    simulation = Simulation(world, faults=faults)
    record_drive(
        simulation=simulation,
        robot=robot_model("rover"),
        drive=Drive(simulation, "straight-1m", speed_m_s=0.8),
        out=out,
        width_px=WIDTH_PX,
        rate_hz=5.0,
        sensor=sensor or Sensor(),
        on_moment=lambda moment: None,
        pairs=["front"],
    )
    return out


def pairs_in(recording: Path) -> list[StereoFrame]:
    return [f for f in open_recording(recording).frames() if isinstance(f, StereoFrame)]


def differing(a: Picture, b: Picture) -> float:
    """Return the share of the pixels that differ by more than an edge's flicker."""
    return float((np.abs(a.astype(int) - b) > 8).mean())
