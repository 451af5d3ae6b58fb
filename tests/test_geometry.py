# SPDX-License-Identifier: Apache-2.0
# Long: one test a promise of the geometry classes.
"""Lens models, rectification and remapping against OpenCV and SciPy."""

import pickle

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pilotage import Camera, Rectifier, StereoRig, Transform, triangulate

# The two cameras of a common drone rig: 752x480, 0.11 m apart, not quite parallel.
LEFT_BROWN = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
RIGHT_BROWN = (-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05)
FISHEYE = (0.0034823894, 0.0007150348, -0.0020532361, 0.00020293673)


def brown_left() -> Camera:
    return Camera(
        width_px=752, height_px=480, fx_px=458.654, fy_px=457.296, cx_px=367.215, cy_px=248.375,
        distortion="brown", coefficients=LEFT_BROWN,
    )  # fmt: skip


def brown_right() -> Camera:
    return Camera(
        width_px=752, height_px=480, fx_px=457.587, fy_px=456.134, cx_px=379.999, cy_px=255.238,
        distortion="brown", coefficients=RIGHT_BROWN,
    )  # fmt: skip


def fisheye() -> Camera:
    return Camera(
        width_px=512, height_px=512, fx_px=190.97, fy_px=190.97, cx_px=254.93, cy_px=256.89,
        distortion="kannala_brandt", coefficients=FISHEYE,
    )  # fmt: skip


def pinhole(**changes: float) -> Camera:
    values = {
        "width_px": 640, "height_px": 400, "fx_px": 500.0, "fy_px": 500.0, "cx_px": 320.0,
        "cy_px": 200.0,
    }  # fmt: skip
    return Camera(**(values | changes))  # type: ignore[arg-type]


def transform(
    rotation_vector_rad: tuple[float, ...], translation_m: tuple[float, ...]
) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(rotation_vector_rad).as_matrix()
    matrix[:3, 3] = translation_m
    return Transform.from_matrix(matrix)


RIGHT_FROM_LEFT = transform((0.0071, -0.0023, 0.0140), (-0.11007, 0.00039, -0.00085))


def brown_rig() -> StereoRig:
    return StereoRig(left=brown_left(), right=brown_right(), right_from_left=RIGHT_FROM_LEFT)


def fisheye_rig() -> StereoRig:
    return StereoRig(
        left=fisheye(),
        right=fisheye(),
        right_from_left=transform((0.01, 0.02, -0.01), (-0.1, 0.001, 0.002)),
    )


def camera_matrix(camera: Camera) -> NDArray[np.float64]:
    return np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1.0]])


def textured_picture(width: int, height: int) -> NDArray[np.uint8]:
    noise = np.random.default_rng(7).uniform(0, 255, (height, width))
    picture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)
    return picture.astype(np.uint8)


def test_transform_composes_and_inverts() -> None:
    b_from_a = transform((0.1, -0.2, 0.3), (1.0, 2.0, 3.0))
    c_from_b = transform((-0.5, 0.2, 0.1), (0.5, 0.0, -1.0))
    np.testing.assert_allclose(
        (c_from_b @ b_from_a).matrix(), c_from_b.matrix() @ b_from_a.matrix(), atol=1e-14
    )
    np.testing.assert_allclose((b_from_a @ b_from_a.inverse()).matrix(), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(
        Transform.exp(b_from_a.log()).matrix(), b_from_a.matrix(), atol=1e-13
    )


def test_transform_maps_points() -> None:
    b_from_a = transform((0.0, 0.0, np.pi / 2), (1.0, 2.0, 3.0))
    points = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(b_from_a @ points, [[1, 3, 3], [0, 2, 3]], atol=1e-14)
    np.testing.assert_allclose(b_from_a @ points[0], [1, 3, 3], atol=1e-14)


def test_transform_fields_keep_their_order() -> None:
    t = Transform(translation_m=(1, 2, 3), quaternion_wxyz=(0.5, -0.5, 0.5, 0.5))
    np.testing.assert_allclose(t.translation_m, [1, 2, 3])
    np.testing.assert_allclose(t.quaternion_wxyz, [0.5, -0.5, 0.5, 0.5])
    xyzw = np.roll(t.quaternion_wxyz, -1)
    np.testing.assert_allclose(t.matrix()[:3, :3], Rotation.from_quat(xyzw).as_matrix(), atol=1e-15)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(t)).matrix(), t.matrix())


@pytest.mark.parametrize("scale", [-1.0, 1.01, float("nan")])
def test_transform_refuses_what_is_no_rotation(scale: float) -> None:
    with pytest.raises(ValueError, match="matrix"):
        Transform.from_matrix(np.diag([scale, scale, scale, 1.0]))


def test_camera_fields_keep_their_order() -> None:
    camera = Camera(
        width_px=101, height_px=52, fx_px=53.0, fy_px=54.0, cx_px=55.0, cy_px=26.0,
        distortion="brown", coefficients=(0.1, 0.2, 0.3, 0.4, 0.5),
    )  # fmt: skip
    assert (camera.width_px, camera.height_px) == (101, 52)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (53, 54, 55, 26)
    assert camera.distortion == "brown"
    assert camera.coefficients == [0.1, 0.2, 0.3, 0.4, 0.5]


def test_projection_agrees_with_opencv() -> None:
    points = np.random.default_rng(1).uniform((-0.7, -0.4, 1), (0.7, 0.4, 1.2), (500, 3))
    zero = np.zeros(3)
    camera = brown_left()
    expected, _ = cv2.projectPoints(points, zero, zero, camera_matrix(camera), np.array(LEFT_BROWN))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)

    wide = points * (3, 3, 1)
    camera = fisheye()
    expected, _ = cv2.fisheye.projectPoints(
        wide[None], zero, zero, camera_matrix(camera), np.array(FISHEYE)
    )
    np.testing.assert_allclose(camera.project(wide), expected[0], atol=1e-9)


@pytest.mark.parametrize("make", [brown_left, fisheye, pinhole])
def test_unproject_inverts_project(make) -> None:  # type: ignore[no-untyped-def]
    camera = make()
    # Up to the corners, or to 85 degrees off the axis of the lens that sees behind itself.
    margin_px = 80 if camera.distortion == "kannala_brandt" else 0
    x, y = np.meshgrid(
        np.linspace(margin_px, camera.width_px - 1 - margin_px, 23),
        np.linspace(margin_px, camera.height_px - 1 - margin_px, 17),
    )
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    np.testing.assert_allclose(camera.project(5 * rays), pixels, atol=1e-7)


def test_projection_is_nan_behind_the_camera_and_beyond_the_fold() -> None:
    assert np.isnan(brown_left().project(np.array([[0.1, 0.1, -1.0], [0, 0, 0]]))).all()
    # r (1 - 0.5 r^2) grows up to r = sqrt(2/3) = 0.816 and folds over beyond.
    folding = Camera(
        width_px=640, height_px=480, fx_px=300.0, fy_px=300.0, cx_px=320.0, cy_px=240.0,
        distortion="brown", coefficients=(-0.5, 0, 0, 0),
    )  # fmt: skip
    pixels = folding.project(np.array([[0.81, 0, 1], [0.82, 0, 1], [3.0, 0, 1]]))
    np.testing.assert_array_equal(np.isnan(pixels[:, 0]), [False, True, True])
    assert np.isnan(folding.unproject(np.array([[620.0, 240.0]]))).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx_px": 0.0}, "fx_px is 0, must be positive"),
        ({"fy_px": -1.0}, "fy_px is -1"),
        ({"fx_px": float("nan")}, "fx_px is nan"),
        ({"fx_px": float("inf")}, "fx_px is inf"),
        ({"cx_px": float("nan")}, "cx_px is nan"),
        ({"cx_px": 5000.0}, "cx_px is 5000, must be between -640 and 1280"),
        ({"width_px": 0}, "width_px is 0, must be between 1"),
        ({"height_px": -5}, "height_px is -5"),
    ],
)
def test_camera_refuses_bad_values(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pinhole(**changes)


def test_camera_refuses_bad_lenses() -> None:
    with pytest.raises(ValueError, match="3 coefficients for distortion 'brown'"):
        pinhole(distortion="brown", coefficients=(1, 2, 3))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"coefficients\[1\] is nan"):
        pinhole(distortion="brown", coefficients=(0, np.nan, 0, 0))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="must be one of 'none', 'brown', 'kannala_brandt'"):
        pinhole(distortion="fisheye")  # type: ignore[arg-type]


def test_rig_refuses_what_is_no_pair() -> None:
    left = pinhole()

    def rig(translation_m: tuple[float, ...], right: Camera = left) -> StereoRig:
        return StereoRig(
            left=left, right=right, right_from_left=transform((0, 0, 0), translation_m)
        )

    assert rig((-0.2, 0, 0)).baseline_m == pytest.approx(0.2)
    with pytest.raises(ValueError, match=r"left and right are swapped: .* is 0\.2, must"):
        rig((0.2, 0, 0))
    with pytest.raises(ValueError, match="baseline_m is 0, must be positive"):
        rig((0, 0, 0))
    with pytest.raises(ValueError, match="side by side"):
        rig((-0.01, 0.2, 0))
    with pytest.raises(ValueError, match="right camera: width_px is 320"):
        rig((-0.2, 0, 0), pinhole(width_px=320))


def test_ideal_rig_is_used_as_it_is() -> None:
    rig = StereoRig(
        left=pinhole(),
        right=pinhole(cx_px=331.0),
        right_from_left=transform((0, 0, 0), (-0.3, 0, 0)),
    )
    rectifier = Rectifier(rig=rig)
    stereo = rectifier.stereo
    assert rectifier.is_identity
    assert (stereo.width_px, stereo.height_px, stereo.focal_px) == (640, 400, 500)
    assert (stereo.cx_px, stereo.cy_px, stereo.cx_right_px) == (320, 200, 331)
    assert stereo.baseline_m == pytest.approx(0.3)
    picture = textured_picture(640, 400)
    np.testing.assert_array_equal(rectifier.rectify(picture), picture)


def test_rectifying_rotations_agree_with_opencv() -> None:
    rig = brown_rig()
    matrix = rig.right_from_left.matrix()
    left_turn, right_turn, new_left, *_ = cv2.stereoRectify(
        camera_matrix(rig.left), np.array(LEFT_BROWN), camera_matrix(rig.right),
        np.array(RIGHT_BROWN), (752, 480), matrix[:3, :3], matrix[:3, 3:], alpha=0,
    )  # fmt: skip
    rectifier = Rectifier(rig=rig)
    assert not rectifier.is_identity
    np.testing.assert_allclose(rectifier.rectified_from_left.matrix()[:3, :3], left_turn, atol=1e-9)
    np.testing.assert_allclose(
        rectifier.rectified_from_right.matrix()[:3, :3], right_turn, atol=1e-9
    )
    # The field kept is at least OpenCV's, with every pixel seen.
    assert 0.9 * new_left[0, 0] < rectifier.stereo.focal_px <= 1.01 * new_left[0, 0]


@pytest.mark.parametrize("make", [brown_rig, fisheye_rig])
def test_rectified_rows_coincide_and_every_pixel_is_seen(make) -> None:  # type: ignore[no-untyped-def]
    rig = make()
    rectifier = Rectifier(rig=rig)
    stereo = rectifier.stereo
    white = np.full((rig.left.height_px, rig.left.width_px), 255, np.uint8)
    assert rectifier.rectify(white, "left").min() == 255
    assert rectifier.rectify(white, "right").min() == 255
    # A point of space, seen by the real cameras and by the ideal ones.
    points = np.random.default_rng(3).uniform((-1, -0.6, 2), (1, 0.6, 4), (200, 3))
    left = rectifier.rectified_from_left @ points
    right = rectifier.rectified_from_right @ (rig.right_from_left @ points)
    np.testing.assert_allclose(
        left - right, np.tile([stereo.baseline_m, 0, 0], (200, 1)), atol=1e-12
    )


def test_wide_lens_becomes_a_pinhole_of_bounded_field() -> None:
    stereo = Rectifier(rig=fisheye_rig()).stereo
    half_field_deg = np.degrees(np.arctan(0.5 * (stereo.width_px - 1) / stereo.focal_px))
    assert 40 < half_field_deg < 55.1


def lagrange(picture: NDArray[np.uint8], source: NDArray[np.float32]) -> NDArray[np.float64]:
    """Sample with cubic polynomials through four neighbours each way, borders repeated."""
    whole = np.floor(source).astype(int)
    weights = []
    for axis in (0, 1):
        t = (source - whole)[..., axis]
        weights.append(
            (
                -t * (t - 1) * (t - 2) / 6,
                (t + 1) * (t - 1) * (t - 2) / 2,
                -(t + 1) * t * (t - 2) / 2,
                (t + 1) * t * (t - 1) / 6,
            )
        )
    total = np.zeros(source.shape[:2])
    for j in range(4):
        for i in range(4):
            x = np.clip(whole[..., 0] + i - 1, 0, picture.shape[1] - 1)
            y = np.clip(whole[..., 1] + j - 1, 0, picture.shape[0] - 1)
            total += weights[0][i] * weights[1][j] * picture[y, x]
    return total


def source_of_rectified(
    rectifier: Rectifier, camera: Camera, rectified_from_camera: Transform
) -> NDArray[np.float32]:
    stereo = rectifier.stereo
    x, y = np.meshgrid(np.arange(stereo.width_px), np.arange(stereo.height_px))
    rays = np.stack([x - stereo.cx_px, y - stereo.cy_px, np.full(x.shape, stereo.focal_px)], axis=2)
    pixels = camera.project(rectified_from_camera.inverse() @ rays.reshape(-1, 3))
    return pixels.astype(np.float32).reshape(*x.shape, 2)


@pytest.mark.parametrize("make", [brown_rig, fisheye_rig])
@pytest.mark.parametrize("side", ["left", "right"])
def test_rectified_picture_agrees_with_opencv(make, side) -> None:  # type: ignore[no-untyped-def]
    rig = make()
    camera = rig.left if side == "left" else rig.right
    picture = textured_picture(camera.width_px, camera.height_px)

    linear = Rectifier(rig=rig, interpolation="bilinear")
    turn = linear.rectified_from_left if side == "left" else linear.rectified_from_right
    source = source_of_rectified(linear, camera, turn)
    expected = cv2.remap(picture, source, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = np.abs(expected.astype(float) - linear.rectify(picture, side))
    assert difference.mean() <= 0.5  # OpenCV rounds coordinates to 1/32 px
    assert difference.max() <= 4

    cubic = Rectifier(rig=rig, interpolation="cubic").rectify(picture, side)
    difference = np.abs(np.clip(lagrange(picture, source), 0, 255) - cubic)
    assert difference.mean() <= 0.3  # rounding to whole levels alone: 0.25
    assert difference.max() <= 0.7


def test_pictures_with_padded_rows_are_taken_as_they_are() -> None:
    rectifier = Rectifier(rig=brown_rig())
    wide = textured_picture(752 * 2, 480)
    both = [rectifier.rectify(half, "right") for half in (wide[:, :752], wide[:, 752:])]
    np.testing.assert_array_equal(both[0], rectifier.rectify(wide[:, :752].copy(), "right"))
    np.testing.assert_array_equal(both[1], rectifier.rectify(wide[:, 752:].copy(), "right"))


def test_rectifier_refuses_other_pictures() -> None:
    rectifier = Rectifier(rig=brown_rig())
    with pytest.raises(ValueError, match="picture is 640 x 480 pixels, calibrated are 752 x 480"):
        rectifier.rectify(np.zeros((480, 640), np.uint8))
    with pytest.raises(ValueError, match="side is 'top', must be one of 'left', 'right'"):
        rectifier.rectify(np.zeros((480, 752), np.uint8), "top")
    with pytest.raises(TypeError):
        rectifier.rectify(np.zeros((480, 752)))  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        rectifier.rectify(np.zeros((480, 752, 3), np.uint8))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="adjacent pixels"):
        rectifier.rectify(np.zeros((480, 1504), np.uint8)[:, ::2])


def test_triangulation_is_exact_without_noise() -> None:
    rig = brown_rig()
    points = np.random.default_rng(5).uniform((-1, -0.6, 2), (1, 0.6, 4), (100, 3))
    left_px = rig.left.project(points)
    right_px = rig.right.project(rig.right_from_left @ points)
    np.testing.assert_allclose(
        triangulate(rig=rig, left_px=left_px, right_px=right_px), points, atol=1e-7
    )


def test_triangulation_is_nan_where_rays_diverge() -> None:
    rig = StereoRig(
        left=pinhole(), right=pinhole(), right_from_left=transform((0, 0, 0), (-0.3, 0, 0))
    )
    left_px, right_px = np.array([[320.0, 200.0]]), np.array([[310.0, 200.0]])
    point = triangulate(rig=rig, left_px=left_px, right_px=right_px)
    np.testing.assert_allclose(point, [[0, 0, 500 * 0.3 / 10]], atol=1e-12)
    assert np.isnan(triangulate(rig=rig, left_px=right_px, right_px=left_px)).all()
    assert np.isnan(triangulate(rig=rig, left_px=left_px, right_px=left_px)).all()
