# SPDX-License-Identifier: Apache-2.0
"""Every calibration style gives the same rig; wrong values are named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pilotage import StereoRig, Transform
from pilotage.calibration import load_rig, save_rig
from pilotage.errors import InputError

# A distinct value in each place catches a swapped order.
LEFT_K, RIGHT_K = (301.0, 302.0, 241.5, 121.5), (303.0, 304.0, 242.5, 122.5)
LEFT_D, RIGHT_D = (-0.21, 0.072, 0.003, -0.004, 0.0051), (-0.22, 0.073, 0.0032, -0.0042, 0.0052)
ROTATION = cv2.Rodrigues(np.array([0.011, -0.02, 0.03]))[0]
TRANSLATION_M = np.array([-0.12, 0.001, 0.002])

OWN = """
left: {width_px: 480, height_px: 240, fx_px: 301, fy_px: 302, cx_px: 241.5, cy_px: 121.5,
       distortion: brown, coefficients: {k1: -0.21, k2: 0.072, p1: 3e-3, p2: -0.004, k3: 0.0051}}
right: {width_px: 480, height_px: 240, fx_px: 303, fy_px: 304, cx_px: 242.5, cy_px: 122.5}
right_from_left: {translation_m: [-0.12, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}
"""


def right_from_left() -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = ROTATION, TRANSLATION_M
    return matrix


def flat(values: object) -> str:
    return "[" + ", ".join(f"{v:.17g}" for v in np.asarray(values, float).ravel()) + "]"


def check(rig: StereoRig) -> None:
    for camera, k, d in ((rig.left, LEFT_K, LEFT_D), (rig.right, RIGHT_K, RIGHT_D)):
        assert (camera.width_px, camera.height_px) == (480, 240)
        assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == k
        assert camera.distortion == "brown"
        assert tuple(camera.coefficients) == d
    np.testing.assert_allclose(rig.right_from_left.matrix(), right_from_left(), atol=1e-9)


def intrinsic_matrix(k: tuple[float, ...]) -> np.ndarray:
    return np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1]])


def ros_text(side: int) -> str:
    """A camera_info as stereo calibration writes it, from OpenCV's own rectification."""
    ks, ds = (LEFT_K, RIGHT_K), (LEFT_D, RIGHT_D)
    result = cv2.stereoRectify(
        intrinsic_matrix(LEFT_K), np.array(LEFT_D), intrinsic_matrix(RIGHT_K), np.array(RIGHT_D),
        (480, 240), ROTATION, TRANSLATION_M.reshape(3, 1), flags=cv2.CALIB_ZERO_DISPARITY,
    )  # fmt: skip
    rectification, projection = result[side], result[2 + side]
    rows = {
        "camera_matrix": (3, 3, intrinsic_matrix(ks[side])),
        "rectification_matrix": (3, 3, rectification),
        "projection_matrix": (3, 4, projection),
        "distortion_coefficients": (1, 5, ds[side]),
    }
    text = (
        f"image_width: 480\nimage_height: 240\ncamera_name: c{side}\ndistortion_model: plumb_bob\n"
    )
    for key, (r, c, values) in rows.items():
        text += f"{key}:\n  rows: {r}\n  cols: {c}\n  data: {flat(values)}\n"
    return text


def test_ros_pair_of_files(tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(ros_text(0))
    (tmp_path / "right.yaml").write_text(ros_text(1))
    check(load_rig(tmp_path))
    check(load_rig(tmp_path / "left.yaml"))
    check(load_rig(tmp_path / "right.yaml"))


def test_ros_in_one_file(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(ros_text(0) + "---\n" + ros_text(1))
    check(load_rig(tmp_path / "a.yaml"))
    nested = "".join(
        f"{name}:\n" + "".join(f"  {line}\n" for line in ros_text(side).splitlines())
        for side, name in enumerate(("left", "right"))
    )
    (tmp_path / "b.yaml").write_text(nested)
    check(load_rig(tmp_path / "b.yaml"))


def test_kalibr_and_equidistant(tmp_path: Path) -> None:
    text = (
        "cam0:\n  camera_model: pinhole\n  distortion_model: radtan\n"
        "  distortion_coeffs: [-0.21, 0.072, 0.003, -0.004]\n"
        "  intrinsics: [301, 302, 241.5, 121.5]\n  resolution: [480, 240]\n  rostopic: /a\n"
        "cam1:\n  camera_model: pinhole\n  distortion_model: equidistant\n"
        "  distortion_coeffs: [0.01, 0.02, 0.03, 0.04]\n  intrinsics: [303, 304, 242.5, 122.5]\n"
        f"  resolution: [480, 240]\n  T_cn_cnm1: {right_from_left().tolist()}\n"
    )
    (tmp_path / "camchain.yaml").write_text(text)
    rig = load_rig(tmp_path)
    assert tuple(rig.left.coefficients)[:4] == (-0.21, 0.072, 0.003, -0.004)
    assert rig.right.distortion == "kannala_brandt"
    assert tuple(rig.right.coefficients)[:4] == (0.01, 0.02, 0.03, 0.04)
    np.testing.assert_allclose(rig.right_from_left.matrix(), right_from_left(), atol=1e-9)
    (tmp_path / "camchain.yaml").write_text(text.replace("pinhole", "omni"))
    with pytest.raises(InputError, match=r"cam0\.camera_model = 'omni'.*pinhole"):
        load_rig(tmp_path)


def test_opencv_storage(tmp_path: Path) -> None:
    file = tmp_path / "stereo.yaml"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for side, (k, d) in enumerate(((LEFT_K, LEFT_D), (RIGHT_K, RIGHT_D)), start=1):
        storage.write(f"cameraMatrix{side}", intrinsic_matrix(k))
        storage.write(f"distCoeffs{side}", np.array([d]))
    storage.write("R", ROTATION)
    storage.write("T", TRANSLATION_M.reshape(3, 1))
    storage.release()
    check(load_rig(file, image_size_px=(480, 240)))
    with pytest.raises(InputError, match="imageSize"):
        load_rig(file)


def test_euroc_pair_and_opencv_header(tmp_path: Path) -> None:
    body_from_left = np.eye(4)
    body_from_left[:3, :3] = cv2.Rodrigues(np.array([0.1, 0.2, 1.5]))[0]
    body_from_left[:3, 3] = 0.1, 0.2, 0.3
    poses = (body_from_left, body_from_left @ np.linalg.inv(right_from_left()))
    for side, (pose, k, d) in enumerate(
        zip(poses, (LEFT_K, RIGHT_K), (LEFT_D, RIGHT_D), strict=True)
    ):
        (tmp_path / f"cam{side}_sensor.yaml").write_text(
            f"%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: {flat(pose)}\n"
            f"resolution: [480, 240]\ncamera_model: pinhole\nintrinsics: {flat(k)}\n"
            f"distortion_model: radial-tangential\ndistortion_coefficients: {flat(d)}\n"
        )
    check(load_rig(tmp_path))


def test_kitti_colour_pair_is_relative(tmp_path: Path) -> None:
    rows = [(0.0, 0.0), (-361.2, 0.0), (43.0, 0.2), (-325.1, 0.2)]
    lines = [f"P{i}: 602 0 241 {x} 0 602 121 {y} 0 0 1 0.001" for i, (x, y) in enumerate(rows)]
    (tmp_path / "calib.txt").write_text("\n".join([*lines, "Tr: " + "0 " * 12]))
    for colour, base_m in ((False, 361.2 / 602), (True, 368.1 / 602)):
        rig = load_rig(tmp_path / "calib.txt", image_size_px=(480, 240), colour=colour)
        translation_m = rig.right_from_left.translation_m
        np.testing.assert_allclose(translation_m, [-base_m, 0, 0], atol=1e-12)


def test_own_style_round_trips_exactly(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(OWN)
    first = load_rig(tmp_path)
    rig = StereoRig(
        left=first.left, right=first.right,
        right_from_left=Transform.from_matrix(right_from_left()),
        robot_from_left=Transform(translation_m=[1 / 3, 0.2, 0.7]), readout_s=0.1 / 7,
    )  # fmt: skip
    save_rig(rig, tmp_path / "again.yaml")
    again = load_rig(tmp_path / "again.yaml")
    assert again.readout_s == rig.readout_s
    for camera, wanted in ((again.left, rig.left), (again.right, rig.right)):
        for key in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "distortion"):
            assert getattr(camera, key) == getattr(wanted, key)
        assert tuple(camera.coefficients) == tuple(wanted.coefficients)
    for pose, wanted in (
        (again.right_from_left, rig.right_from_left),
        (again.robot_from_left, rig.robot_from_left),
    ):
        np.testing.assert_array_equal(pose.translation_m, wanted.translation_m)
        np.testing.assert_array_equal(pose.quaternion_wxyz, wanted.quaternion_wxyz)


def test_every_pose_round_trips_exactly(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(OWN)
    base = load_rig(tmp_path)
    rng = np.random.default_rng(0)
    for _ in range(100):
        rotation = cv2.Rodrigues(rng.normal(0, 0.1, 3))[0]
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, rotation @ [-0.1, 0, 0]
        pose = Transform.from_matrix(matrix)
        save_rig(
            StereoRig(left=base.left, right=base.right, right_from_left=pose), tmp_path / "a.yaml"
        )
        again = load_rig(tmp_path / "a.yaml").right_from_left
        np.testing.assert_array_equal(again.quaternion_wxyz, pose.quaternion_wxyz)
        np.testing.assert_array_equal(again.translation_m, pose.translation_m)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("fx_px: 301", "fx_px: .nan", ["left.fx_px", "nan"]),
        ("fx_px: 301", "fx_px: 0", ["left", "fx = 0"]),
        ("fx_px: 301", "fx_px: -301", ["left", "fx = -301"]),
        ("fx_px: 301", "fx_px: wide", ["left.fx_px", "wide", "not a number"]),
        ("fx_px: 301, ", "", ["left.fx_px", "missing"]),
        ("fx_px: 301", "fx_mm: 301", ["fx_mm", "unknown key", "fx_px"]),
        ("k3: 0.0051", "k4: 0.0051", ["left.coefficients", "k4", "unknown key"]),
        ("width_px: 480", "width_px: 480.5", ["left", "480.5"]),
        ("width_px: 480", "width_px: 0", ["left", "size 0 x 240"]),
        ("[-0.12, 0, 0]", "[0.12, 0, 0]", ["baseline = -0.12", "swap"]),
        ("[-0.12, 0, 0]", "[0, 0, 0]", ["baseline = 0"]),
        ("[-0.12, 0, 0]", "[-120, 0, 0]", ["baseline = 120", "millimetres"]),
        ("[-0.12, 0, 0]", "[0, -0.12, 0]", ["baseline"]),
        ("[-0.12, 0, 0]", "[-0.12, 0]", ["translation_m", "2 numbers"]),
        ("[1, 0, 0, 0]", "[0, 0, 0, 0]", ["quaternion_wxyz", "length 1"]),
        ("distortion: brown", "distortion: omni", ["left.distortion", "omni", "brown"]),
        (
            "right_from_left:",
            "left_from_right:",
            ["left_from_right", "unknown key", "right_from_left"],
        ),
        ("left:", "left: {}\nleft:", ["left", "twice"]),
        ("left:", "readout_s: 16\nleft:", ["readout_s", "16", "0.2"]),
    ],
)
def test_wrong_values_are_named(old: str, new: str, words: list[str], tmp_path: Path) -> None:
    assert old in OWN
    file = tmp_path / "rig.yaml"
    file.write_text(OWN.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_rig(file)
    for word in (str(file), *words):
        assert word in str(error.value)


def test_rational_lens_is_refused_unless_it_is_brown(tmp_path: Path) -> None:
    (tmp_path / "right.yaml").write_text(ros_text(1))
    rational = ros_text(0).replace("plumb_bob", "rational_polynomial").replace("cols: 5", "cols: 8")
    last = f"{LEFT_D[-1]:.17g}]"
    (tmp_path / "left.yaml").write_text(rational.replace(last, last[:-1] + ", 0, 0, 0]"))
    check(load_rig(tmp_path))
    (tmp_path / "left.yaml").write_text(rational.replace(last, last[:-1] + ", 0.1, 0, 0]"))
    with pytest.raises(InputError, match=r"distortion_coefficients.*cannot be represented"):
        load_rig(tmp_path)


def test_lonely_camera_asks_for_its_partner(tmp_path: Path) -> None:
    (tmp_path / "left.yaml").write_text(ros_text(0))
    with pytest.raises(InputError, match=r"left\.yaml.*other is not beside it"):
        load_rig(tmp_path / "left.yaml")


def test_no_calibration_and_no_yaml(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no calibration"):
        load_rig(tmp_path)
    (tmp_path / "a.yaml").write_text("{ [")
    with pytest.raises(InputError, match="not valid YAML"):
        load_rig(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        load_rig(tmp_path / "absent.yaml")
