# SPDX-License-Identifier: Apache-2.0
"""How fast are simulated cameras, and do they see what MuJoCo's own renderer sees?

    python benchmarks/rendering.py --width 640          # goal: 10 steps/s of four views
    python benchmarks/rendering.py --width 1280         # goal: 3 steps/s of four views

The rover drives through a yard and takes a picture with each of its four cameras ten times a
second, with all that its sensor does. MuJoCo's renderer draws the same views in the same run:
through Mesa on the processor (MUJOCO_GL=egl or osmesa), without lens, noise or fine ground.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np

from pilotage import Camera, _core
from pilotage.simulation import Drive, Simulation, load_world, robot_model
from pilotage.simulation.camera_group import camera_groups
from pilotage.simulation.pictures import Pictures, camera_rays
from pilotage.simulation.sensor import read_sensor

PATH, RATE_HZ = "closed-10m", 10
GOALS = {640: 10.0, 1280: 3.0}
# Software rasterizers compute depth from 24 bits between the near and the far plane.
SAME_DEPTH = 0.01


@dataclass
class Times:
    """Seconds of wall and processor time, one of each for each step."""

    wall_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)

    def __enter__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        self.wall_s.append(time.perf_counter() - self._wall)
        self.cpu_s.append(time.process_time() - self._cpu)


def make_renderer(simulation: Simulation, width: int, height: int) -> Any:
    """Return MuJoCo's renderer; None where the machine has no Mesa to draw with."""
    simulation.model.vis.global_.offwidth = width
    simulation.model.vis.global_.offheight = height
    try:
        return mujoco.Renderer(simulation.model, height, width)
    except Exception as error:  # whatever the graphics library finds missing
        print(f"without MuJoCo's renderer: {error}", file=sys.stderr)
        return None


def mujoco_views(simulation: Simulation, renderer: Any, names: list[str]) -> Any:
    """Draw the views with MuJoCo; return the depth (m) of the first one."""
    for name in reversed(names):
        renderer.update_scene(simulation.data, camera=simulation.camera_names.index(name))
        renderer.render()
    renderer.enable_depth_rendering()
    depth = renderer.render()
    renderer.disable_depth_rendering()
    return depth


def same_depth(ours: Any, theirs: Any) -> float:
    """Return the share of what both see, to 30 m, where depths are the same."""
    is_near = (ours > 0) & (ours < 30) & (theirs < 30)
    return float((np.abs(ours - theirs)[is_near] < SAME_DEPTH * ours[is_near]).mean())


def measure(ground: str, arguments: argparse.Namespace) -> None:
    """Print one row of the table."""
    world = load_world("yard", seed=7, options={"ground": ground, "path": PATH})
    simulation = Simulation(world, "rover", seed=7)
    robot, pictures = robot_model("rover"), Pictures(simulation)
    sensor, width = read_sensor(arguments.camera), arguments.width
    cameras = robot.pair_lenses(robot.stereo_rigs(simulation, width))
    groups = camera_groups(simulation, cameras, sensor, seed=7, pictures=pictures)
    names = [name for pair in robot.pairs.values() for name in pair]
    height = arguments.width * 3 // 4
    renderer = make_renderer(simulation, arguments.width, height)
    plain = plain_camera(simulation, names[0], arguments.width, height)
    ours, theirs, agreeing = Times(), Times(), []
    drive = iter(Drive(simulation, PATH, speed_m_s=0.4))
    for step in range(arguments.steps + 1):
        wanted_ns = (step + 1) * 1_000_000_000 // RATE_HZ
        while simulation.time_ns < wanted_ns:
            next(drive)
        times = ours if step else Times()  # the first view of all finds nothing kept
        with times:
            for group in groups.values():
                group.take()
        if renderer is not None and step % 5 == 0:
            with theirs if step else Times():
                depth = mujoco_views(simulation, renderer, names)
            seen = pictures.depth_m(names[0], plain, at_ns=simulation.time_ns)
            agreeing.append(same_depth(seen, depth))
    rate = 1 / np.median(ours.wall_s)
    our_ms = 1e3 * np.mean(ours.cpu_s) / len(names)
    goal = GOALS.get(arguments.width, 0.0)
    compared = "- | - | -"
    if theirs.cpu_s:
        their_ms = 1e3 * np.mean(theirs.cpu_s) / (len(names) + 1)
        agreement = 100 * np.mean(agreeing)
        compared = f"{their_ms:.0f} | {their_ms / our_ms:.1f} | {agreement:.1f} %"
    print(
        f"| {ground} | {arguments.width}x{height} | {rate:.1f} | {goal:g} | {our_ms:.0f} | "
        f"{compared} |",
        flush=True,
    )


def plain_camera(simulation: Simulation, name: str, width: int, height: int) -> _core.CameraRays:
    """Return the rays of a camera as MuJoCo has it: a pinhole."""
    fovy = np.radians(simulation.model.cam_fovy[simulation.camera_names.index(name)])
    focal_px = height / 2 / np.tan(fovy / 2)
    return camera_rays(
        Camera(
            width_px=width,
            height_px=height,
            fx_px=focal_px,
            fy_px=focal_px,
            cx_px=(width - 1) / 2,
            cy_px=(height - 1) / 2,
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--camera", default="good", help="good, ideal, realistic or a YAML file")
    parser.add_argument("--grounds", default="asphalt,grass,gravel,soil,sand")
    arguments = parser.parse_args()
    print(
        "| ground | views | steps/s | goal | CPU-ms a view | MuJoCo's | ratio | same depth |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for ground in arguments.grounds.split(","):
        measure(ground, arguments)


if __name__ == "__main__":
    main()
