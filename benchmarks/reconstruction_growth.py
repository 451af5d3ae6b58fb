# SPDX-License-Identifier: Apache-2.0
"""How the cost of a reconstruction grows with the length of an ordered walk.

    python benchmarks/reconstruction_growth.py [--counts 62 125 250 500]

A walk down a street, rendered at 320x240 by the renderer of the tests; its first pictures, ever
more of them, are reconstructed, each time in a process of its own. The exponent is the slope of a
line through the logarithms: 1 is linear, and n log n comes out as 1.2 between 62 and 500 pictures.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from picture_sets import PictureSet
from reconstruction import matrices, run_in_child
from tables import markdown_table, number

from pilotage import Camera
from pilotage.evaluation.camera_poses import pose_errors

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from rendering import PinholeCamera, Renderer, street
from synthetic import ROBOT_FROM_CAMERA

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 320, 240, 260.0
STEP_M = 0.2
NOISE_GREY = 1.5
SEED = 5


def walk(folder: Path, count: int, *, seed: int = SEED, first: int = 0) -> PictureSet:
    """Render pictures of a walk that sways, looking half to the side, with their poses.

    `first`: the walk has gone so many steps before.
    """
    rng = np.random.default_rng(seed)
    centre = (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2
    pinhole = PinholeCamera(WIDTH_PX, HEIGHT_PX, FOCAL_PX, FOCAL_PX, *centre)
    renderer = Renderer(street(STEP_M * (first + count), rng), pinhole, seed)
    files, poses = [], np.tile(np.eye(4), (count, 1, 1))
    for i, pose in enumerate(poses, first):
        yaw = 0.5 + 0.2 * np.sin(0.05 * i)
        turn = [[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
        pose[:3, :3] = np.array(turn) @ ROBOT_FROM_CAMERA
        pose[:3, 3] = STEP_M * i, 0.3 * np.sin(0.1 * i), 1.2
        grey = renderer.render(pose) + rng.normal(0, NOISE_GREY, (HEIGHT_PX, WIDTH_PX))
        files.append(folder / f"{i:04d}.png")
        cv2.imwrite(str(files[-1]), np.clip(grey, 0, 255).astype(np.uint8))
    camera = Camera(
        width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=FOCAL_PX, fy_px=FOCAL_PX,
        cx_px=centre[0], cy_px=centre[1],
    )  # fmt: skip
    return PictureSet("street", tuple(files), camera, poses)


def exponent(counts: Sequence[int], costs: Sequence[float]) -> float:
    """Return the slope of log cost over log count; NaN for fewer than two."""
    if len(counts) < 2:
        return float("nan")
    return float(np.polyfit(np.log(counts), np.log(costs), 1)[0])


def main() -> int:
    """Read the command line, run, print a table and the exponent."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--counts", nargs="+", type=int, default=[62, 125, 250, 500])
    counts = sorted(parser.parse_args().counts)
    rows, cpu_s = [], []
    with tempfile.TemporaryDirectory(prefix="pilotage-growth-") as folder:
        pictures = walk(Path(folder), counts[-1])
        for count in counts:
            options = {"is_ordered": True, "matches_all": False, "threads": 2}
            run = run_in_child(pictures, pictures.pictures[:count], "pilotage", options)
            found = matrices(run["poses"])
            errors = pose_errors(estimate=found, truth=pictures.truth[:count])
            placed = int(np.isfinite(found).all(axis=(1, 2)).sum())
            cpu_s.append(run["cpu_s"])
            rows.append([
                str(count), str(placed), number(run["cpu_s"]), number(1e3 * run["cpu_s"] / count),
                number(run["peak_mb"]), number(errors.ate_percent_of_length) if errors else "",
            ])  # fmt: skip
            print(f"{count} pictures: {run['cpu_s']:.1f} CPU-s", file=sys.stderr, flush=True)
    titles = ["pictures", "placed", "CPU s", "CPU ms a picture", "memory MB", "ATE % of path"]
    print(markdown_table(titles, rows))
    print(
        f"\nCPU time grows with the power {exponent(counts, cpu_s):.2f} of the number of pictures"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
