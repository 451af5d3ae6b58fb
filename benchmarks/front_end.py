# SPDX-License-Identifier: Apache-2.0
"""Speed and agreement of the front end beside OpenCV's, on one stereo pair, on one thread.

python benchmarks/front_end.py LEFT RIGHT
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import _core

Array = NDArray[Any]


def best_ms(call: Callable[[], Any], *, batches: int = 15, calls: int = 4) -> float:
    """CPU milliseconds a call: the least over batches, as other processes only add to it."""
    call()
    times = []
    for _ in range(batches):
        start = time.process_time()
        for _ in range(calls):
            call()
        times.append((time.process_time() - start) / calls)
    return 1e3 * min(times)


def keypoints_of(points: Array) -> list[cv2.KeyPoint]:
    return [cv2.KeyPoint(float(x), float(y), 3.2, 0, 0, 0) for x, y in points]


def row(name: str, ours_ms: float, theirs_ms: float, note: str = "") -> None:
    print(f"{name:<26}{ours_ms:>10.3f}{theirs_ms:>12.3f}{theirs_ms / ours_ms:>8.1f}  {note}")


def compare_detection(image: Array) -> None:
    ours = best_ms(lambda: _core.detect_corners(image=image))
    theirs = best_ms(
        lambda: cv2.goodFeaturesToTrack(image, 500, 1e-3, 8, blockSize=5, useHarrisDetector=True)
    )
    row("corners", ours, theirs, f"{len(_core.detect_corners(image=image))} points")


def compare_stable_regions(image: Array) -> None:
    """Both with the same limits; the share is of OpenCV's centres that ours have within 2 px."""
    ours = best_ms(lambda: _core.detect_stable_regions(image=image), batches=5, calls=1)
    area = int(0.1 * image.size)
    mser = cv2.MSER.create(5, 30, area, 0.25, 0.2)
    theirs = best_ms(lambda: mser.detectRegions(image), batches=5, calls=1)
    found = np.asarray(_core.detect_stable_regions(image=image))[:, :2]
    regions, _ = mser.detectRegions(image)
    centres = np.array([region.mean(axis=0) for region in regions])
    apart = np.linalg.norm(centres[:, None] - found[None], axis=2).min(axis=1)
    note = f"{len(found)} regions, OpenCV {len(regions)}, {np.mean(apart < 2):.0%} of them here"
    row("stable regions (MSER)", ours, theirs, note)


def compare_description(image: Array, points: Array) -> None:
    sift = cv2.SIFT.create()
    keypoints = keypoints_of(points)
    ours = best_ms(lambda: _core.describe_points(image=image, points_px=points))
    theirs = best_ms(lambda: sift.compute(image, keypoints), batches=5, calls=1)
    a = np.asarray(_core.describe_points(image=image, points_px=points)).astype(float)
    b = np.asarray(sift.compute(image, keypoints)[1]).astype(float)
    cosine = (a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    note = f"{1e3 * ours / len(points):.2f} us a point, cosine {np.median(cosine):.4f}"
    row("SIFT descriptors", ours, theirs, note)


def compare_matching(left: Array, right: Array, points: Array) -> None:
    options = _core.HarrisOptions()
    options.points_per_cell = 3
    corners = np.asarray(_core.detect_corners(image=right, options=options))
    other = np.ascontiguousarray(corners[:, :2])
    a = _core.describe_points(image=left, points_px=points)
    b = _core.describe_points(image=right, points_px=other)
    floats = np.asarray(a, np.float32), np.asarray(b, np.float32)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    ours = best_ms(lambda: _core.match_all(a=a, b=b), batches=5, calls=1)
    theirs = best_ms(lambda: matcher.knnMatch(*floats, 2), batches=5, calls=1)
    row("match all", ours, theirs, f"{1e6 * ours / len(points) / len(other):.1f} ns a pair")
    rows = best_ms(lambda: _core.match_along_rows(left_px=points, left=a, right_px=other, right=b))
    row("match along rows", rows, theirs, "against OpenCV's match of all")


def compare_stereo(left: Array, right: Array, points: Array) -> None:
    sgbm = cv2.StereoSGBM.create(0, 128, 7)
    ours = best_ms(lambda: _core.match_stereo(left=left, right=right, points_px=points))
    theirs = best_ms(lambda: sgbm.compute(left, right), batches=2, calls=1)
    found = _core.match_stereo(left=left, right=right, points_px=points)
    share = float(np.mean(np.asarray(found["ok"]) > 0))
    note = f"{1e3 * ours / len(points):.2f} us a point, {100 * share:.0f} % found; SGBM is dense"
    row("stereo of points, 128 px", ours, theirs, note)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("left", help="left picture of a rectified pair")
    parser.add_argument("right", help="right picture")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    left, right = (
        cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in (arguments.left, arguments.right)
    )
    if left is None or right is None:
        parser.error(f"cannot read {arguments.left if left is None else arguments.right}")
    options = _core.HarrisOptions()
    options.points_per_cell = 3
    corners = np.asarray(_core.detect_corners(image=left, options=options))
    points = np.ascontiguousarray(corners[:, :2])
    print(f"{left.shape[1]}x{left.shape[0]}, {len(points)} points")
    print(f"{'':<26}{'ours, ms':>10}{'OpenCV, ms':>12}{'ratio':>8}")
    compare_detection(left)
    compare_stable_regions(left)
    compare_description(left, points)
    compare_matching(left, right, points)
    compare_stereo(left, right, points)


if __name__ == "__main__":
    main()
