# SPDX-License-Identifier: Apache-2.0
"""The front end (corners, descriptors, matching, sub-pixel) beside OpenCV and known shifts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import spearmanr

from pilotage import _core

Array = NDArray[Any]


def texture(height: int = 240, width: int = 360, *, seed: int = 0) -> Array:
    """Random float texture, (height, width), grey levels around 128, nothing finer than 4 px."""
    noise = np.random.default_rng(seed).standard_normal((height, width))
    fine, coarse = cv2.GaussianBlur(noise, (0, 0), 1.6), cv2.GaussianBlur(noise, (0, 0), 5)
    return 128 + 28 * fine / fine.std() + 18 * coarse / coarse.std()


def as_image(grey: Array, *, noise: float = 1.0, seed: int = 1) -> Array:
    """8-bit picture of `grey` with sensor noise."""
    noisy = grey + noise * np.random.default_rng(seed).standard_normal(grey.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def moved(grey: Array, dx: float, dy: float) -> Array:
    """`grey` moved by (dx, dy) pixels, exactly (by its Fourier transform, so it wraps around)."""
    v = np.fft.fftfreq(grey.shape[0])[:, None]
    u = np.fft.fftfreq(grey.shape[1])[None, :]
    return np.fft.ifft2(np.fft.fft2(grey) * np.exp(-2j * np.pi * (u * dx + v * dy))).real


def corners(image: Array, **settings: Any) -> Array:
    options = _core.HarrisOptions()
    for name, value in settings.items():
        setattr(options, name, value)
    return np.asarray(_core.detect_corners(image=image, options=options))


def cosine(a: Array, b: Array) -> Array:
    a, b = a.astype(float), b.astype(float)
    return np.asarray((a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1))


def opencv_sift(image: Array, points: Array, angles_rad: Array) -> Array:
    # Octave 0, layer 0 and size 2 * 1.6 are our smoothing and cell size.
    keypoints = [
        cv2.KeyPoint(float(x), float(y), 3.2, float(np.degrees(a)), 0, 0)
        for (x, y), a in zip(points, angles_rad, strict=True)
    ]
    kept, descriptors = cv2.SIFT.create().compute(image, keypoints)
    assert len(kept) == len(points)
    return np.asarray(descriptors)


def test_corners_are_those_of_opencv() -> None:
    image = as_image(texture())
    found = corners(image, points_per_cell=8, min_distance_px=4.0)
    response = cv2.cornerHarris(image, 5, 3, 0.04)
    # OpenCV's window is a box and its value not rooted: ranks are compared, over nearby pixels.
    nearby = cv2.dilate(response, np.ones((5, 5)))
    at = np.rint(found[:, :2]).astype(int)
    assert spearmanr(found[:, 2], nearby[at[:, 1], at[:, 0]]).statistic > 0.95
    is_peak = response == cv2.dilate(response, np.ones((13, 13)))
    is_peak[:12] = is_peak[-12:] = False
    is_peak[:, :12] = is_peak[:, -12:] = False
    peaks = np.argwhere(is_peak)[:, ::-1]
    strongest = peaks[np.argsort(-response[is_peak])[:40]]
    distance = np.linalg.norm(strongest[:, None] - found[None, :, :2], axis=2).min(1)
    assert np.mean(distance < 2.0) > 0.9


@pytest.mark.parametrize("turn_rad", [0.0, 0.7])
def test_descriptors_agree_with_opencv(turn_rad: float) -> None:
    image = as_image(texture())
    points = np.ascontiguousarray(corners(image, border_px=30)[:, :2])
    angles = np.full(len(points), turn_rad, np.float32)
    ours = _core.describe_points(
        image=image, points_px=points, angles_rad=angles if turn_rad else None
    )
    similarity = cosine(np.asarray(ours), opencv_sift(image, points, angles))
    assert np.median(similarity) > 0.99
    assert np.percentile(similarity, 5) > 0.97


def test_matches_agree_with_opencv() -> None:
    grey = texture()
    a, b = as_image(grey, noise=4), as_image(moved(grey, 6.3, -3.6), noise=4, seed=2)
    points_a = np.ascontiguousarray(corners(a, points_per_cell=2)[:, :2])
    points_b = np.ascontiguousarray(corners(b, points_per_cell=2)[:, :2])
    ours_a = _core.describe_points(image=a, points_px=points_a)
    ours_b = _core.describe_points(image=b, points_px=points_b)
    pairs = np.asarray(_core.match_all(a=ours_a, b=ours_b)["pairs"])
    upright_a, upright_b = np.zeros(len(points_a)), np.zeros(len(points_b))
    theirs = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(
        opencv_sift(a, points_a, upright_a), opencv_sift(b, points_b, upright_b)
    )
    expected = {(m.queryIdx, m.trainIdx) for m in theirs}
    assert len(pairs) > 40
    assert np.mean([tuple(pair) in expected for pair in pairs.tolist()]) > 0.95
    shift = points_b[pairs[:, 1]] - points_a[pairs[:, 0]]
    assert np.mean(np.linalg.norm(shift - [6.3, -3.6], axis=1) < 2) > 0.95


def test_matches_keep_to_rows_and_windows() -> None:
    grey = texture()
    left, right = as_image(grey), as_image(moved(grey, -14.4, 0.0), seed=2)
    points_l = np.ascontiguousarray(corners(left)[:, :2])
    points_r = np.ascontiguousarray(corners(right)[:, :2])
    left_descriptors = _core.describe_points(image=left, points_px=points_l)
    right_descriptors = _core.describe_points(image=right, points_px=points_r)
    rows = _core.match_along_rows(
        left_px=points_l, left=left_descriptors, right_px=points_r, right=right_descriptors
    )
    windows = _core.match_in_windows(
        predicted_px=points_l - np.float32([14, 0]),
        radius_px=np.float32([3]),
        a=left_descriptors,
        b_px=points_r,
        b=right_descriptors,
    )
    for found in (rows, windows):
        pairs = np.asarray(found["pairs"])
        shift = points_r[pairs[:, 1]] - points_l[pairs[:, 0]]
        assert len(pairs) > 20
        assert np.mean(np.linalg.norm(shift - [-14.4, 0], axis=1) < 2) > 0.95
        assert np.all(np.asarray(found["ratio"]) <= _core.DescriptorMatchOptions().max_ratio)


def test_stereo_match_measures_disparity_and_y_parallax() -> None:
    grey = texture()
    left, right = as_image(grey), as_image(moved(grey, -21.3, 0.4), seed=2)
    points = np.ascontiguousarray(corners(left, border_px=40)[:, :2])
    found = _core.match_stereo(left=left, right=right, points_px=points)
    ok = np.asarray(found["ok"]) > 0
    assert np.mean(ok) > 0.9
    assert abs(np.mean(np.asarray(found["disparity_px"])[ok]) - 21.3) < 0.02
    assert np.std(np.asarray(found["disparity_px"])[ok]) < 0.05
    assert abs(np.mean(np.asarray(found["dy_px"])[ok]) - 0.4) < 0.02


@pytest.mark.parametrize("dx", [0.0, 0.2, 0.5, 0.8])
def test_refined_matches_are_unbiased(dx: float) -> None:
    grey = texture()
    a, b = as_image(grey, noise=2), as_image(moved(grey, dx, -dx / 2), noise=2, seed=2)
    points = np.ascontiguousarray(corners(a, points_per_cell=3, border_px=20)[:, :2])
    found = _core.refine_matches(a=a, points_in_a_px=points, b=b, guesses_in_b_px=points)
    ok = np.asarray(found["ok"]) > 0
    error = np.asarray(found["position_px"])[ok] - points[ok] - [dx, -dx / 2]
    assert np.mean(ok) > 0.9
    assert np.all(np.abs(error.mean(0)) < 0.02)
    assert np.sqrt(np.mean(error**2)) < 0.05


def test_wrong_calls_are_refused() -> None:
    image = as_image(texture())
    points = np.zeros((3, 2), np.float32)
    with pytest.raises(TypeError):
        _core.detect_corners(image=image.astype(np.float32))
    with pytest.raises(ValueError, match="cell_px 7"):
        corners(image, cell_px=7)
    with pytest.raises(ValueError, match="2 angles for 3 points"):
        _core.describe_points(image=image, points_px=points, angles_rad=np.zeros(2, np.float32))
    with pytest.raises(ValueError, match="3 points and 2 guesses"):
        _core.refine_matches(
            a=image, points_in_a_px=points, b=image, guesses_in_b_px=points[:2].copy()
        )
    with pytest.raises(ValueError, match="3 points and 1 of a_from_b"):
        _core.refine_matches(
            a=image, points_in_a_px=points, b=image, guesses_in_b_px=points,
            a_from_b=np.eye(2, dtype=np.float32)[None],
        )  # fmt: skip


def test_stereo_match_on_the_motorcycle(data_folder: Path) -> None:
    folder = data_folder / "middlebury_motorcycle"
    left, right = (
        cv2.imread(str(folder / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    truth = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    points = np.ascontiguousarray(corners(left, points_per_cell=4)[:, :2])
    found = _core.match_stereo(left=left, right=right, points_px=points)
    at = np.rint(points).astype(int)
    expected = truth[at[:, 1], at[:, 0]]
    ok = (np.asarray(found["ok"]) > 0) & np.isfinite(expected)
    error = np.abs(np.asarray(found["disparity_px"]) - expected)[ok]
    assert np.mean(ok) > 0.65
    assert np.mean(error < 1) > 0.9
    assert np.median(error) < 0.12


def test_stereo_match_finds_street_points(data_folder: Path) -> None:
    left, right = (
        cv2.imread(str(data_folder / "kitti_a" / side / "000005.jpg"), cv2.IMREAD_GRAYSCALE)
        for side in ("image_0", "image_1")
    )
    points = np.ascontiguousarray(corners(left)[:, :2])
    forth = _core.match_stereo(left=left, right=right, points_px=points)
    ok = np.asarray(forth["ok"]) > 0
    assert np.mean(ok) > 0.6
    # Back again, from the right picture with the disparity's sign turned, ends where it began.
    options = _core.StereoMatchOptions()
    options.min_disparity_px, options.max_disparity_px = -128, 0
    disparity = np.asarray(forth["disparity_px"])[ok]
    there = (points[ok] - np.stack([disparity, 0 * disparity], 1)).astype(np.float32)
    back = _core.match_stereo(left=right, right=left, points_px=there, options=options)
    agrees = np.abs(np.asarray(back["disparity_px"]) + disparity) < 1
    assert np.mean(agrees[np.asarray(back["ok"]) > 0]) > 0.95
