# SPDX-License-Identifier: Apache-2.0
"""Whatever the bytes, the readers return a rig or frames, or raise an error of ours."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

import cv2
import numpy as np
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_calibration_files import OWN, ros_text

from pilotage import StereoRig
from pilotage.calibration import load_rig
from pilotage.errors import InputError
from pilotage.recordings import open_recording
from pilotage.recordings.pictures import PictureError, decode_grey
from pilotage.recordings.truth import read_kitti_poses, read_truth

fuzz = settings(
    derandomize=True, max_examples=100, deadline=None, database=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
few = settings(fuzz, max_examples=60)

KITTI = "P0: 300 0 240 0 0 300 120 0 0 0 1 0\nP1: 300 0 240 -60 0 300 120 0 0 0 1 0\n"
KALIBR = (
    "cam0: {camera_model: pinhole, distortion_model: none, distortion_coeffs: [],\n"
    "  intrinsics: [300, 300, 240, 120], resolution: [480, 240]}\n"
    "cam1: {camera_model: pinhole, distortion_model: none, distortion_coeffs: [],\n"
    "  intrinsics: [300, 300, 240, 120], resolution: [480, 240],\n"
    "  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}\n"
)
OPENCV = (
    "%YAML:1.0\n---\nM1: !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n"
    "  data: [300, 0, 240, 0, 300, 120, 0, 0, 1]\nD1: [0, 0, 0, 0]\nD2: [0, 0, 0, 0]\n"
    "M2: [300, 0, 240, 0, 300, 120, 0, 0, 1]\nR: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.1, 0, 0]\n"
)
TEXTS = {
    "a.yaml": OWN, "b.yaml": ros_text(0) + "---\n" + ros_text(1), "c.yaml": KALIBR,
    "d.yaml": OPENCV, "calib.txt": KITTI,
}  # fmt: skip
HOSTILE = [
    ".nan", "-.inf", "1e400", "0", "-1", "1e-300", "null", "true", "''", "[]", "{}", "!!binary x",
    "!!python/object:os.system", "&a [*a]", "*b", "0b2", "2001-99-99", "!!int x", "!!set {a}",
    "9" * 5000, "\x00", "\ud800", "? [a]\n: b", "<<: 3", "\t", "%", "---", "1e9", "-0.0", "0x1p3",
    "!!timestamp x", "!!float ''", "190:20:30", "!!opencv-matrix []", "[[[[[[1]]]]]]",
]  # fmt: skip


def load(data: bytes, name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        with contextlib.suppress(InputError):
            assert isinstance(load_rig(file, image_size_px=(480, 240)), StereoRig)


def test_the_unchanged_texts_load(tmp_path: Path) -> None:
    for name, text in TEXTS.items():
        (tmp_path / name).write_text(text)
        assert load_rig(tmp_path / name, image_size_px=(480, 240)).baseline_m > 0


@fuzz
@given(st.data())
def test_mutated_calibrations(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(TEXTS)))
    text = TEXTS[name]
    for _ in range(data.draw(st.integers(1, 3))):
        begin = data.draw(st.integers(0, len(text)))
        end = min(len(text), begin + data.draw(st.integers(0, 12)))
        piece = data.draw(st.one_of(st.sampled_from(HOSTILE), st.text(max_size=4)))
        text = text[:begin] + piece + text[end:]
    load(text.encode("utf-8", "surrogatepass"), name)


@fuzz
@given(st.data())
def test_hostile_values_in_place_of_numbers(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(TEXTS)))
    words = TEXTS[name].split(" ")
    place = data.draw(st.integers(0, len(words) - 1))
    words[place] = data.draw(st.sampled_from(HOSTILE)) + ("," if words[place].endswith(",") else "")
    load(" ".join(words).encode("utf-8", "surrogatepass"), name)


scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.dates()
)
keys = st.sampled_from(
    ["left", "right", "right_from_left", "cam0", "cam1", "T_BS", "K", "D", "R", "P", "M1", "M2",
     "T", "data", "resolution", "intrinsics", "camera_model", "distortion_model", "width_px",
     "image_width", "image_height", "translation_m", "quaternion_wxyz", "T_cn_cnm1", "roi"]
)  # fmt: skip
trees = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=5), st.dictionaries(st.one_of(keys, scalars), inner, max_size=6)
    ),
    max_leaves=20,
)


@fuzz
@given(trees)
def test_random_yaml_trees(tree: object) -> None:
    load(yaml.safe_dump(tree, allow_unicode=True).encode("utf-8", "replace"), "x.yaml")


@few
@given(st.binary(max_size=200), st.sampled_from(["x.yaml", "calib.txt"]))
def test_random_bytes_as_calibration(data: bytes, name: str) -> None:
    load(data, name)


def test_deep_nesting_and_bombs() -> None:
    load(b"[" * 50_000, "x.yaml")
    load(b"{a: " * 50_000, "x.yaml")
    bomb = "a0: &a0 [x, x]\n" + "".join(
        f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 60)
    )
    load((bomb + "right_from_left: *a59\n").encode(), "x.yaml")
    load((bomb + "cam0: {intrinsics: *a59}\n").encode(), "x.yaml")
    load(b"P0: " + b"1 " * 100_000, "calib.txt")
    load(b"#" * 300_000, "x.yaml")


JPEG = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (40, 56), np.uint8))[1]
PNG = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 56), np.uint8))[1]


@fuzz
@given(st.sampled_from([JPEG.tobytes(), PNG.tobytes()]), st.data())
def test_broken_pictures(picture: bytes, data: st.DataObject) -> None:
    changed = bytearray(picture[: data.draw(st.integers(0, len(picture)))])
    for _ in range(data.draw(st.integers(0, 4))):
        if changed:
            changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(PictureError):
        grey = decode_grey(bytes(changed), Path("x"))
        assert grey.dtype == np.uint8
        assert grey.ndim == 2


@few
@given(st.text(alphabet="0123456789.-+enaif, \n#", max_size=200))
def test_random_tables(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name in ("truth.txt", "data.csv"):
            file = Path(folder) / name
            file.write_text(text)
            with contextlib.suppress(InputError):
                read_truth(file)
            with contextlib.suppress(InputError):
                read_kitti_poses(file, [0, 1])


NAMES = [
    "image_0", "image_1", "image_2", "calib.txt", "times.txt", "poses.txt", "mav0", "cam0", "cam1",
    "data", "data.csv", "sensor.yaml", "left", "right", "left.png", "right.png", "000000.png",
    "a_0.jpg", "a_1.jpg", "rig.yaml", "left.yaml", "right.yaml", "images", "clip.avi", "x.tum",
    "\u0661.png", "truth_body_tum.txt", "recording.mcap", "a.mcap", "b.mcap.part",
]  # fmt: skip
CONTENTS = [
    b"", b"\xff\xd8", JPEG.tobytes(), PNG.tobytes(), OWN.encode(), KITTI.encode(), b"0\n", b"nan\n",
    b"#t,f\n1,a\n", b"1,\x00\n", b"1,../../data\n2,000000.png\n", b"1e999999999\n", b"\xff\xfe",
    b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01" + bytes(16) + b"\x02" + bytes(28) + b"\x89MCAP0\r\n",
]  # fmt: skip
Tree = st.recursive(
    st.sampled_from(CONTENTS),
    lambda inner: st.dictionaries(st.sampled_from(NAMES), inner, max_size=6),
    max_leaves=25,
)


def write_tree(path: Path, tree: object) -> None:
    if isinstance(tree, bytes):
        path.write_bytes(tree)
        return
    assert isinstance(tree, dict)
    path.mkdir()
    for name, inner in tree.items():
        write_tree(path / name, inner)


@few
@given(st.dictionaries(st.sampled_from(NAMES), Tree, max_size=8))
def test_random_folders(tree: dict[str, object]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_tree(Path(folder) / "r", tree)
        for path in (Path(folder) / "r", *(Path(folder) / "r" / name for name in tree)):
            with contextlib.suppress(InputError):
                recording = open_recording(path)
                assert sum(1 for _ in recording.frames()) == len(recording)
                recording.truth()


def test_hostile_paths() -> None:
    for path in ("", "\0", "a\0b", "x" * 5000, "\ud800"):
        with contextlib.suppress(InputError):
            open_recording(path)
        with contextlib.suppress(InputError):
            load_rig(path)
