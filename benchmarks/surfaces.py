# SPDX-License-Identifier: Apache-2.0
"""Do rendered grounds look to a matcher as photographs do?

    python benchmarks/surfaces.py [PHOTOGRAPH...]      # table of docs/surfaces.md

Each surface is seen twice through the same sensor: the second picture shifted by parts of pixels,
or turned by 20 degrees. Photographs are moved by cubic interpolation, rendered grounds by moving
the camera.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform, _core
from pilotage.simulation.camera_faults import WELL
from pilotage.simulation.exposure import Exposer, Imager
from pilotage.simulation.lens import Lens
from pilotage.simulation.sensor import Sensor
from pilotage.simulation.surfaces import SURFACES, SurfacePainter

Array = NDArray[Any]
# (dx, dy) in pixels and a turn in degrees -> radiance
View = Callable[[float, float, float], Array]

SIDE = 320
MARGIN, PATCH, REACH, SAME = 60, 21, 30, 4
SHIFT = (3.4, -2.6)
TURN_DEG = 20.0
PIXELS_M = {"0.7 mm": 0.0007, "1.4 mm": 0.0014}


def photograph_view(picture: Array, side: int = SIDE) -> View:
    """Return square views of the middle of a grey picture; 320 pixels wide they need 512."""
    middle = (np.array(picture.shape[::-1]) - 1) / 2

    def view(dx: float, dy: float, turn_deg: float) -> Array:
        moved = cv2.getRotationMatrix2D(tuple(middle), -turn_deg, 1.0)
        moved[:, 2] += (side - 1) / 2 - middle + (dx, dy)
        return cv2.warpAffine(picture, moved, (side, side), flags=cv2.INTER_CUBIC)

    return view


def ground_view(kind: str, pixel_m: float) -> View:
    """Return views of a rendered ground from above."""
    scene = _core.Scene()
    layers = SurfacePainter(scene).layers(kind, albedo=0.4, seed=5, scale=1)
    scene.add_shape(
        kind=_core.ShapeKind.plane,
        size_m=[0, 0, 0],
        material=scene.add_material(_core.Material(albedo=0.4, layers=layers)),
        world_from_shape=Transform(),
    )
    scene.set_light(to_sun=[0.3, 0.2, 0.9], sun=0.7, sky=0.3, background=0)
    centre, focal_px = (SIDE - 1) / 2, 400.0
    camera = Camera(
        width_px=SIDE, height_px=SIDE, fx_px=focal_px, fy_px=focal_px, cx_px=centre, cy_px=centre
    )
    rays = _core.CameraRays(camera)

    def view(dx: float, dy: float, turn_deg: float) -> Array:
        turn = np.radians(turn_deg)
        pose = np.eye(4)
        pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ [
            [np.cos(turn), np.sin(turn), 0],
            [-np.sin(turn), np.cos(turn), 0],
            [0, 0, 1],
        ]
        pose[:3, 3] = pose[:3, :3] @ [-dx * pixel_m, -dy * pixel_m, -focal_px * pixel_m]
        pose[:2, 3] += 3.0, 2.0
        seen = _core.render(scene, rays, Transform.from_matrix(pose))
        return np.asarray(seen["radiance"])

    return view


def correlation_peaks(first: Array, second: Array) -> tuple[float, float, float]:
    """Return the mean highest and second peak of patches, and the share found where they are."""
    scores = []
    for y in range(MARGIN, SIDE - MARGIN - PATCH, 24):
        for x in range(MARGIN, SIDE - MARGIN - PATCH, 24):
            patch = first[y : y + PATCH, x : x + PATCH]
            area = second[y - REACH : y + REACH + PATCH, x - REACH : x + REACH + PATCH]
            score = cv2.matchTemplate(area, patch, cv2.TM_CCOEFF_NORMED)
            _, peak, _, (px, py) = cv2.minMaxLoc(score)
            is_right = np.hypot(px - REACH - SHIFT[0], py - REACH - SHIFT[1]) < 1.5
            score[max(0, py - SAME) : py + SAME + 1, max(0, px - SAME) : px + SAME + 1] = -1
            scores.append((peak, score.max(), is_right))
    return tuple(np.mean(scores, axis=0))


def sift_share(first: Array, second: Array) -> tuple[float, int]:
    """Return the share of right matches after the turn, and how many matches there are."""
    sift = cv2.SIFT.create(500)
    points_a, words_a = sift.detectAndCompute(first, None)
    points_b, words_b = sift.detectAndCompute(second, None)
    if words_a is None or words_b is None or min(len(words_a), len(words_b)) < 3:
        return float("nan"), 0
    matcher = cv2.BFMatcher()
    back = {m.queryIdx: m.trainIdx for m in matcher.match(words_b, words_a)}
    turn = np.radians(TURN_DEG)
    centre = (SIDE - 1) / 2
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    right = count = 0
    for best, other in matcher.knnMatch(words_a, words_b, k=2):
        if best.distance > 0.8 * other.distance or back[best.trainIdx] != best.queryIdx:
            continue
        expected = rotation @ (np.array(points_a[best.queryIdx].pt) - centre) + centre
        right += np.linalg.norm(expected - points_b[best.trainIdx].pt) < 2
        count += 1
    return right / max(1, count), count


def spectrum_slope(picture: Array) -> float:
    """Return the exponent of amplitude over frequency, from 0.02 to 0.25 cycles a pixel."""
    window = np.hanning(SIDE)[:, None] * np.hanning(SIDE)
    power = np.abs(np.fft.fft2((picture - picture.mean()) * window)) ** 2
    frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.fftfreq(SIDE))
    edges = np.geomspace(0.02, 0.25, 12)
    mean = [power[(frequency >= low) & (frequency < high)].mean() for low, high in pairwise(edges)]
    middles = np.sqrt(edges[:-1] * edges[1:])
    return float(np.polyfit(np.log(middles), 0.5 * np.log(mean), 1)[0])


def camera_of(view: View) -> Callable[[Array, int], Array]:
    """Return what makes a picture of a view's light; its noise follows from the number."""
    sensor = Sensor(vignetting=0.0)
    exposer, lens = Exposer(sensor, light=1.0), Lens(sensor.blur_px, [3])
    imager = Imager(sensor, np.random.default_rng(3))
    exposer.regulate(float(view(0, 0, 0).mean()))

    def expose(light: Array, number: int) -> Array:
        seen = lens.pass_on(np.asarray(light, np.float32), WELL)
        return imager.expose(seen, exposer, seed=number)

    return expose


def measure(name: str, view: View) -> None:
    """Print a row of the table."""
    expose = camera_of(view)
    first, shifted, turned = (
        expose(view(*moved), number)
        for number, moved in enumerate([(0, 0, 0), (*SHIFT, 0), (0, 0, TURN_DEG)])
    )
    peak, second, found = correlation_peaks(first, shifted)
    share, count = sift_share(first, turned)
    matches = f"{100 * share:.0f} % of {count}" if count else "none"
    contrast = first.std() / first.mean()
    print(
        f"| {name} | {contrast:.2f} | {peak:.2f} | {second:.2f} | {100 * found:.0f} % | "
        f"{matches} | {spectrum_slope(first.astype(float)):.2f} |",
        flush=True,
    )


def read_grey(data: bytes) -> Array:
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    # Of large photographs the middle, halved: their finest detail is the lens' and the file's.
    while min(picture.shape) >= 1024:
        picture = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return picture.astype(np.float32) / 255


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photographs", type=Path, nargs="*", help="at least 512 pixels wide")
    arguments = parser.parse_args()
    print(
        "| surface | contrast | peak | second peak | found | SIFT after 20 degrees | slope |\n"
        "|---|---|---|---|---|---|---|"
    )
    folder = resources.files("pilotage.simulation").joinpath("textures")
    for name in ("brick", "grass", "gravel"):
        data = folder.joinpath(f"{name}.png").read_bytes()
        measure(f"photograph: {name}", photograph_view(read_grey(data)))
    for path in arguments.photographs:
        measure(f"photograph: {path.stem}", photograph_view(read_grey(path.read_bytes())))
    for kind in SURFACES:
        for size, pixel_m in PIXELS_M.items():
            measure(f"rendered {kind}, {size} a pixel", ground_view(kind, pixel_m))


if __name__ == "__main__":
    main()
