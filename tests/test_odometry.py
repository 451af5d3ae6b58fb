# SPDX-License-Identifier: Apache-2.0
# Long: one test a promise about status, reasons and poses.
"""The odometry on rendered recordings: accurate, repeatable, and honest when pictures are bad.

Twenty pictures played forwards and back again make 39 pairs. What is wrong with them is put in by
the tests; a pose that is called `tracking` must then still be within what its covariance allows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from synthetic import SyntheticRecording, make_recording

import pilotage
from pilotage import Camera, StereoRig, Transform, _core

Picture = NDArray[np.uint8]
Pair = tuple[Picture, Picture] | None  # None: could not be read
Status, Reason = _core.Status, _core.Reason
Verdict = _core.CalibrationVerdict
STEP_NS = 100_000_000
# The rendered rig is exact: nothing is to be allowed for its errors.
EXACT = {"scale_sigma": 0.0, "right_x_offset_prior_px": 0.0}
# Correlated errors of the same patches make single poses a little worse than their covariance: of
# its square root, so much is let pass where a wrong pose would be off by ten and more.
INFLATION = 2.0
BOUND = INFLATION**2 * chi2.ppf(0.999, 6)


@dataclass
class Drive:
    """Pairs with the true pose of each, (N, 4, 4), world = first left camera."""

    pairs: list[Pair]
    world_from_left: NDArray[np.float64]
    recording: SyntheticRecording


@dataclass
class Outcome:
    """What was said at once, what was said at the end, and of the calibration."""

    live: list[Any]
    final: list[Any]
    check: Any


def read_drive(recording: SyntheticRecording, back_again: bool = True) -> Drive:
    """Read all pictures; played back again, the last one is not repeated."""
    kitti = recording.options.layout == "kitti"
    sides = ("image_0", "image_1") if kitti else ("mav0/cam0/data", "mav0/cam1/data")
    files = [sorted((recording.path / side).iterdir()) for side in sides]
    pairs = [(read_grey(left), read_grey(right)) for left, right in zip(*files, strict=True)]
    order = list(range(len(pairs)))
    if back_again:
        order += order[-2::-1]
    return Drive([pairs[i] for i in order], recording.world_from_left[order], recording)


def read_grey(file: Path) -> Picture:
    return np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8)


@pytest.fixture(scope="module")
def street(synthetic_kitti: SyntheticRecording) -> Drive:
    return read_drive(synthetic_kitti)


@pytest.fixture(scope="module")
def lens(synthetic_euroc: SyntheticRecording) -> Drive:
    return read_drive(synthetic_euroc)


def make_rig(recording: SyntheticRecording, robot_from_left: Transform | None = None) -> StereoRig:
    def camera(side: Any) -> Camera:
        lens = "brown" if any(side.distortion) else "none"
        return Camera(
            width_px=side.width, height_px=side.height, fx_px=side.fx, fy_px=side.fy,
            cx_px=side.cx, cy_px=side.cy, distortion=lens,
            coefficients=list(side.distortion) if any(side.distortion) else [],
        )  # fmt: skip

    robot = {} if robot_from_left is None else {"robot_from_left": robot_from_left}
    return StereoRig(
        left=camera(recording.left), right=camera(recording.right),
        right_from_left=Transform.from_matrix(recording.right_from_left), **robot,
    )  # fmt: skip


def make_odometry(recording: SyntheticRecording, **settings: Any) -> Any:
    config = _core.OdometryConfig.from_dict(settings)
    return _core.StereoOdometry(rig=make_rig(recording), config=config)


def follow(drive: Drive, pairs: Sequence[Pair] | None = None, **settings: Any) -> Outcome:
    odometry = make_odometry(drive.recording, **settings)
    live = []
    for i, pair in enumerate(drive.pairs if pairs is None else pairs):
        time_ns = i * STEP_NS
        live.append(odometry.skip(time_ns) if pair is None else odometry.track(*pair, time_ns))
    final = odometry.finish()
    return Outcome(live, final, odometry.calibration_check())


def pose_error(result: Any, world_from_left: NDArray[np.float64]) -> NDArray[np.float64]:
    """(6,): position m, then rotation rad about the world's axes."""
    pose = result.world_from_left.matrix()
    turn = Rotation.from_matrix(pose[:3, :3] @ world_from_left[:3, :3].T).as_rotvec()
    return np.r_[pose[:3, 3] - world_from_left[:3, 3], turn]


def normalised(result: Any, world_from_left: NDArray[np.float64]) -> float:
    """Squared error over covariance, 6 degrees of freedom; the first pose has neither."""
    error = pose_error(result, world_from_left)
    if np.linalg.norm(error) < 1e-9:
        return 0.0
    return float(error @ np.linalg.solve(result.covariance + 1e-16 * np.eye(6), error))


def assert_honest(results: Sequence[Any], truth: NDArray[np.float64]) -> None:
    for i, result in enumerate(results):
        assert (result.world_from_left is None) == (result.status == Status.lost), f"pair {i}"
        assert (result.reason == Reason.none) == (result.status == Status.tracking), f"pair {i}"
        if result.status == Status.tracking:
            found = normalised(result, truth[i])
            assert found < BOUND, f"pair {i}: {found:.0f} and says tracking"


def changed(drive: Drive, places: range, change: Callable[[Any], Pair]) -> list[Pair]:
    return [change(p) if i in places else p for i, p in enumerate(drive.pairs)]


def darken(pair: Any) -> Pair:
    left, right = ((0.02 * side).astype(np.uint8) for side in pair)
    return left, right


def blur(pair: Any) -> Pair:
    left, right = (cv2.GaussianBlur(side, (0, 0), 6).astype(np.uint8) for side in pair)
    return left, right


def swap(pair: Any) -> Pair:
    return pair[1], pair[0]


def shift_right(pair: Any, shift_px: float) -> Pair:
    left, right = pair
    by = np.array([[1, 0, shift_px], [0, 1, 0]], np.float32)
    moved = cv2.warpAffine(
        right, by, right.shape[::-1], flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE
    )
    return left, moved.astype(np.uint8)


@pytest.mark.parametrize("front_end", ["patch", "paper"])
@pytest.mark.parametrize("name", ["street", "lens"])
def test_error_is_bounded(name: str, front_end: str, request: pytest.FixtureRequest) -> None:
    drive: Drive = request.getfixturevalue(name)
    found = follow(drive, front_end=front_end)
    bound_m = 0.01 if front_end == "patch" else 0.03
    for results in (found.live, found.final):
        assert all(r.status == Status.tracking for r in results)
        errors = [pose_error(r, t) for r, t in zip(results, drive.world_from_left, strict=True)]
        assert np.linalg.norm(np.array(errors)[:, :3], axis=1).max() < bound_m
        assert np.linalg.norm(np.array(errors)[:, 3:], axis=1).max() < 0.002
    assert_honest(found.live, drive.world_from_left)
    assert_honest(found.final, drive.world_from_left)


@pytest.mark.parametrize("name", ["street", "lens"])
def test_exact_rig_keeps_its_covariance(name: str, request: pytest.FixtureRequest) -> None:
    drive: Drive = request.getfixturevalue(name)
    found = follow(drive, **EXACT)
    assert_honest(found.live, drive.world_from_left)
    assert_honest(found.final, drive.world_from_left)


def as_bytes(outcome: Outcome) -> bytes:
    parts = []
    for r in (*outcome.live, *outcome.final):
        assert r.world_from_left is not None
        parts += [r.world_from_left.matrix().tobytes(), r.covariance.tobytes()]
    return b"".join(parts)


def test_same_bytes_again_and_on_two_threads(street: Drive) -> None:
    first = as_bytes(follow(street))
    assert as_bytes(follow(street)) == first
    assert as_bytes(follow(street, threads=2)) == first


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (darken, Reason.too_dark),
        (blur, Reason.blurred),
        (lambda _: None, Reason.frames_missing),
        (swap, Reason.left_right_swapped),
    ],
    ids=["dark", "blurred", "missing", "swapped"],
)
def test_bad_stretch_is_lost_with_its_reason(
    street: Drive, change: Callable[[Any], Pair], reason: Any
) -> None:
    bad = range(8, 11)
    found = follow(street, changed(street, bad, change))
    for results in (found.live, found.final):
        for i in bad:
            assert results[i].status == Status.lost
            assert results[i].reason == reason
            assert results[i].world_from_left is None
            assert results[i].covariance is None
        # It resumes by itself, on the same map.
        assert all(r.status != Status.lost for r in results[bad.stop :])
        assert results[-1].segment == 0
        assert_honest(results, street.world_from_left)


@pytest.mark.parametrize("dark_pairs", [8, 20])
def test_long_dark_stretch_begins_a_segment(street: Drive, dark_pairs: int) -> None:
    dark = range(8, 8 + dark_pairs)
    found = follow(street, changed(street, dark, darken))
    for results in (found.live, found.final):
        assert all(results[i].world_from_left is None for i in dark)
        first = results[dark.stop]
        assert (first.status, first.reason) == (Status.degraded, Reason.frames_missing)
        assert first.segment == 1
        assert_honest(results, street.world_from_left)
        # Unseen, the rig may have gone as fast as any small robot goes.
        assert np.sqrt(first.covariance[0, 0]) > 0.09 * dark_pairs
        # What was known before the gap stays known.
        assert np.sqrt(np.trace(results[7].covariance[:3, :3])) < 0.05


def test_points_too_far_to_measure_say_no_parallax(tmp_path: Path) -> None:
    far = make_recording(tmp_path, layout="kitti", frames=4, baseline_m=0.002)
    found = follow(read_drive(far, back_again=False))
    for results in (found.live, found.final):
        assert all(r.world_from_left is not None for r in results)
        assert all((r.status, r.reason) == (Status.degraded, Reason.no_parallax) for r in results)


def test_always_swapped_gives_no_pose(street: Drive) -> None:
    found = follow(street, [swap(p) for p in street.pairs])
    assert all(r.world_from_left is None for r in found.live)
    assert all(r.reason == Reason.left_right_swapped for r in found.live)


def test_right_picture_one_frame_late(street: Drive) -> None:
    way_there = len(street.pairs) // 2
    pairs: list[Pair] = []
    for i in range(way_there):
        now, next_one = street.pairs[i], street.pairs[i + 1]
        assert now is not None
        assert next_one is not None
        pairs.append((now[0], next_one[1] if i > 7 else now[1]))
    found = follow(street, pairs)
    assert_honest(found.live, street.world_from_left)
    said = [r.reason for r in found.live[8:]]
    assert said.count(Reason.left_right_out_of_step) > len(said) / 2


def test_clean_recordings_raise_no_alarm(street: Drive, lens: Drive) -> None:
    for drive in (street, lens):
        check = follow(drive).check
        assert check.verdict != Verdict.inconsistent
        assert abs(check.right_x_offset_px) < 0.1
        assert abs(check.y_parallax_px) < 0.1


@pytest.mark.parametrize("shift_px", [1.5, -1.5])
def test_shifted_right_picture_is_found(street: Drive, shift_px: float) -> None:
    found = follow(street, [shift_right(p, shift_px) for p in street.pairs])
    assert found.check.verdict == Verdict.inconsistent
    assert found.check.right_x_offset_px == pytest.approx(shift_px, abs=0.3)
    assert found.check.right_x_offset_sigma_px < 0.1
    assert found.live[-1].reason == Reason.calibration_does_not_fit
    # Known at last, it is said of every pose.
    assert all(r.reason == Reason.calibration_does_not_fit for r in found.final)


def test_shift_in_y_is_found_with_its_size(street: Drive) -> None:
    by = np.array([[1, 0, 0], [0, 1, 1.5]], np.float32)
    pairs: list[Pair] = []
    for pair in street.pairs:
        assert pair is not None
        moved = cv2.warpAffine(pair[1], by, pair[1].shape[::-1], flags=cv2.INTER_LANCZOS4)
        pairs.append((pair[0], moved.astype(np.uint8)))
    check = follow(street, pairs).check
    assert check.verdict == Verdict.inconsistent
    assert check.y_parallax_px == pytest.approx(1.5, abs=0.3)


def test_pose_of_the_robot(street: Drive) -> None:
    """With the camera's place on the robot given, world and poses are the robot's."""
    robot_from_left = Transform(
        translation_m=[0.3, 0.05, 0.7], quaternion_wxyz=[0.5, -0.5, 0.5, -0.5]
    )
    count = 8
    plain = follow(street, street.pairs[:count])
    config = _core.OdometryConfig()
    rig = make_rig(street.recording, robot_from_left)
    odometry = _core.StereoOdometry(rig=rig, config=config)
    for i, pair in enumerate(street.pairs[:count]):
        assert pair is not None
        result = odometry.track(*pair, i * STEP_NS)
        camera = plain.live[i].world_from_left.matrix()
        sits = robot_from_left.matrix()
        expected = sits @ camera @ np.linalg.inv(sits)
        np.testing.assert_allclose(result.world_from_left.matrix(), expected, atol=1e-9)
        # The turn's covariance is the camera's, about the robot's axes.
        turned = sits[:3, :3] @ plain.live[i].covariance[3:, 3:] @ sits[:3, :3].T
        np.testing.assert_allclose(result.covariance[3:, 3:], turned, rtol=1e-6, atol=1e-15)
    forward = result.world_from_left.matrix()[:3, 3]
    assert forward[0] > 0.7  # the robot's x looks ahead
    assert np.abs(forward[1:]).max() < 0.2


def test_wrong_calls_name_the_value(street: Drive) -> None:
    odometry = make_odometry(street.recording)
    left, right = street.pairs[0]  # type: ignore[misc]
    odometry.track(left, right, 5 * STEP_NS)
    height, width = left.shape
    with pytest.raises(ValueError, match=rf"left.*{width - 2}x{height}.*{width}x{height}"):
        odometry.track(np.ascontiguousarray(left[:, 2:]), right, 6 * STEP_NS)
    with pytest.raises(ValueError, match=rf"right.*{width}x{height - 1}"):
        odometry.track(left, np.ascontiguousarray(right[1:]), 6 * STEP_NS)
    for stale_ns in (5 * STEP_NS, 4 * STEP_NS):
        with pytest.raises(ValueError, match=f"timestamp_ns = {stale_ns}"):
            odometry.track(left, right, stale_ns)
    assert odometry.track(left, right, 6 * STEP_NS).status == Status.tracking
    assert len(odometry.finish()) == 2, "refused pairs count as not given"
    with pytest.raises(ValueError, match="after finish"):
        odometry.track(left, right, 7 * STEP_NS)


def test_skipping_obeys_time_too(street: Drive) -> None:
    odometry = make_odometry(street.recording)
    assert odometry.skip(STEP_NS).reason == Reason.frames_missing
    with pytest.raises(ValueError, match="timestamp_ns = 0"):
        odometry.skip(0)
    odometry.finish()
    with pytest.raises(ValueError, match="after finish"):
        odometry.skip(2 * STEP_NS)


def test_package_offers_what_is_tested() -> None:
    assert pilotage.StereoOdometry is _core.StereoOdometry
