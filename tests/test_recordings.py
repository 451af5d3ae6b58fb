# SPDX-License-Identifier: Apache-2.0
# Long: one contract, run over every format of recording.
"""One contract for every format of recording, and what broken recordings are told."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import cv2
import numpy as np
import pytest
from synthetic import SyntheticRecording

from pilotage.calibration import load_rig, save_rig
from pilotage.errors import InputError
from pilotage.recordings import BadFrame, StereoFrame, open_recording
from pilotage.recordings import recording as recording_module
from pilotage.recordings.kitti import KittiRecording
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.recordings.pictures import PictureError, decode_grey, natural_key

COUNT = 6


def pictures(recording: SyntheticRecording) -> list[tuple[np.ndarray, np.ndarray]]:
    files = zip(*(sorted((recording.path / f"image_{s}").iterdir()) for s in (0, 1)), strict=True)
    return [tuple(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) for f in pair) for pair in files][:COUNT]


def write_rig(recording: SyntheticRecording, file: Path) -> None:
    save_rig(load_rig(recording.path, image_size_px=(480, 240)), file)


def kitti_folder(source: SyntheticRecording, folder: Path) -> Path:
    for side in ("image_0", "image_1"):
        (folder / side).mkdir(parents=True)
        for file in sorted((source.path / side).iterdir())[:COUNT]:
            shutil.copy(file, folder / side)
    for name in ("times.txt", "poses.txt"):
        lines = (source.path / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(lines[:COUNT]))
    shutil.copy(source.path / "calib.txt", folder)
    return folder


def subfolders(source: SyntheticRecording, folder: Path) -> Path:
    for i, pair in enumerate(pictures(source)):
        for side, picture in zip(("left", "right"), pair, strict=True):
            (folder / side).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(
                str(folder / side / f"{side}{i + 7}.png"), picture
            )  # 7 .. 12: natural order
    write_rig(source, folder / "rig.yaml")
    return folder


def suffixes(source: SyntheticRecording, folder: Path) -> Path:
    (folder / "images").mkdir(parents=True)
    for i, pair in enumerate(pictures(source)):
        for side, picture in enumerate(pair):
            time_ns = 1_600_000_000_000_000_000 + i * 10**8
            cv2.imwrite(str(folder / "images" / f"{time_ns}_{side}.png"), picture)
    write_rig(source, folder / "rig.yaml")
    return folder


def side_by_side(source: SyntheticRecording, folder: Path) -> Path:
    folder.mkdir(parents=True)
    for i, pair in enumerate(pictures(source)):
        colour = cv2.cvtColor(np.hstack(pair), cv2.COLOR_GRAY2BGR)
        cv2.imwrite(str(folder / f"image{i + 7}.png"), colour)
    write_rig(source, folder / "rig.yaml")
    return folder


def video(source: SyntheticRecording, folder: Path) -> Path:
    folder.mkdir(parents=True)
    writer = cv2.VideoWriter(
        str(folder / "drive.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 10, (960, 240)
    )
    if not writer.isOpened():
        pytest.skip("this OpenCV cannot write FFV1 video")
    for pair in pictures(source):
        writer.write(cv2.cvtColor(np.hstack(pair), cv2.COLOR_GRAY2BGR))
    writer.release()
    write_rig(source, folder / "drive.yaml")
    return folder / "drive.avi"


def mcap(source: SyntheticRecording, folder: Path) -> Path:
    folder.mkdir(parents=True)
    rig = load_rig(source.path, image_size_px=(480, 240))
    with McapWriter(folder / "recording.mcap") as writer:
        writer.add_rig(rig, timestamp_ns=0)
        for i, (left, right) in enumerate(pictures(source)):
            writer.write_pair(timestamp_ns=i * 10**8, left=left, right=right)
    return folder


MAKERS = [kitti_folder, subfolders, suffixes, side_by_side, video, mcap]
Broken = Callable[[Path], None]


@pytest.mark.parametrize("make", MAKERS)
def test_every_format_gives_the_same_pictures(
    make: Callable[[SyntheticRecording, Path], Path],
    synthetic_kitti: SyntheticRecording,
    tmp_path: Path,
) -> None:
    recording = open_recording(make(synthetic_kitti, tmp_path / "r"))
    frames = list(recording.frames())
    assert len(recording) == len(frames) == COUNT
    largest = 1 if make is video else 0  # the codec's colour space costs a grey value
    for index, (frame, expected) in enumerate(zip(frames, pictures(synthetic_kitti), strict=True)):
        assert isinstance(frame, StereoFrame)
        assert frame.index == index
        for picture, wanted in zip((frame.left, frame.right), expected, strict=True):
            assert picture.dtype == np.uint8
            assert picture.flags.c_contiguous
            assert np.abs(picture.astype(int) - wanted).max() <= largest
    times_s = np.array([frame.timestamp_ns for frame in frames]) * 1e-9
    np.testing.assert_allclose(np.diff(times_s), 0.1, atol=1e-6)
    assert recording.rig.left.width_px == 480
    np.testing.assert_allclose(recording.rig.right_from_left.translation_m, [-0.2, 0, 0], atol=1e-9)
    assert recording.decode_cpu_s > 0
    assert len(list(recording.frames())) == COUNT  # a second pass starts anew


def test_kitti_truth_is_the_left_camera(synthetic_kitti: SyntheticRecording) -> None:
    truth = open_recording(synthetic_kitti.path).truth()
    assert truth is not None
    np.testing.assert_array_equal(truth.timestamps_ns, synthetic_kitti.timestamps_ns)
    np.testing.assert_allclose(truth.world_from_left, synthetic_kitti.world_from_left, atol=1e-9)


def test_euroc_truth_goes_from_body_to_left_camera(synthetic_euroc: SyntheticRecording) -> None:
    recording = open_recording(synthetic_euroc.path)
    assert [f.timestamp_ns for f in recording.frames()] == synthetic_euroc.timestamps_ns.tolist()
    truth = recording.truth()
    assert truth is not None
    relative = np.linalg.inv(truth.world_from_left[0]) @ truth.world_from_left
    np.testing.assert_allclose(relative, synthetic_euroc.world_from_left, atol=1e-9)
    right_from_left = recording.rig.right_from_left.matrix()
    np.testing.assert_allclose(right_from_left, synthetic_euroc.right_from_left, atol=1e-9)
    assert recording.rig.left.coefficients[:2] == pytest.approx([-0.28, 0.074])


def test_bare_euroc_layout_with_times_from_names(
    synthetic_euroc: SyntheticRecording, tmp_path: Path
) -> None:
    shutil.copytree(synthetic_euroc.path / "mav0", tmp_path / "bare")
    for camera in ("cam0", "cam1"):
        (tmp_path / "bare" / camera / "data.csv").unlink()
    frames = list(open_recording(tmp_path / "bare").frames())
    assert [f.timestamp_ns for f in frames] == synthetic_euroc.timestamps_ns.tolist()


def test_euroc_picture_without_partner_is_a_bad_frame(
    synthetic_euroc: SyntheticRecording, tmp_path: Path
) -> None:
    shutil.copytree(synthetic_euroc.path, tmp_path / "r")
    table = tmp_path / "r/mav0/cam1/data.csv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join(lines[:5] + lines[6:]))
    bad = [f for f in open_recording(tmp_path / "r").frames() if isinstance(f, BadFrame)]
    assert [f.index for f in bad] == [4]
    assert "no right picture" in bad[0].reason


def test_rate_replaces_times(synthetic_kitti: SyntheticRecording) -> None:
    frames = list(open_recording(synthetic_kitti.path, rate_hz=25).frames())
    assert [f.timestamp_ns for f in frames[:3]] == [0, 40_000_000, 80_000_000]


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda f: f.unlink() or f.symlink_to("absent"), "partner"),
        (lambda f: f.write_bytes(b""), "empty"),
        (lambda f: f.write_bytes(f.read_bytes()[:5000]), "cut short"),
        (lambda f: f.write_bytes(b"\x89PNG rubbish IEND"), "decoded"),
        (lambda f: cv2.imwrite(str(f), np.zeros((240, 300), np.uint8)), "300x240"),
    ],
)
def test_one_bad_picture_is_skipped_and_named(
    spoil: Broken, word: str, synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    folder = kitti_folder(synthetic_kitti, tmp_path / "r")
    spoil(folder / "image_1" / "000003.png")
    if word == "partner":
        with pytest.raises(InputError, match=r"000003.*partner"):
            open_recording(folder)
        return
    frames = list(open_recording(folder).frames())
    assert [f.index for f in frames if isinstance(f, BadFrame)] == [3]
    assert isinstance(frames[3], BadFrame)
    assert word in frames[3].reason
    assert "000003.png" in frames[3].reason


def test_bad_first_pictures_do_not_hide_the_rest(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    folder = kitti_folder(synthetic_kitti, tmp_path / "r")
    (folder / "image_0" / "000000.png").write_bytes(b"")
    cv2.imwrite(str(folder / "image_0" / "000001.png"), np.zeros((9, 9), np.uint8))
    kinds = [type(frame) for frame in open_recording(folder).frames()]
    assert kinds == [BadFrame, BadFrame, *[StereoFrame] * (COUNT - 2)]


def _spoil_all(folder: Path) -> None:
    for file in (folder / "image_0").iterdir():
        file.write_bytes(file.read_bytes()[:2000])


def _empty(folder: Path) -> None:
    for side in ("image_0", "image_1"):
        for file in (folder / side).iterdir():
            file.unlink()


def _halve_calibration(folder: Path) -> None:
    write_rig_size = (
        "left: {width_px: 240, height_px: 120, fx_px: 149, fy_px: 149, cx_px: 120, cy_px: 60}\n"
    )
    text = write_rig_size + write_rig_size.replace("left", "right")
    text += "right_from_left: {translation_m: [-0.2, 0, 0], quaternion_wxyz: [1, 0, 0, 0]}\n"
    (folder / "calib.yaml").write_text(text)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_spoil_all, ["can be read", "6"]),
        (_empty, ["holds no pictures"]),
        (lambda f: (f / "image_1" / "000005.png").unlink(), ["6 left and 5 right", "000005"]),
        (lambda f: (f / "calib.txt").unlink(), ["calib.txt", "does not exist"]),
        (lambda f: (f / "times.txt").write_text("0\n0.1\n"), ["times.txt", "2 times for 6 pairs"]),
        (
            lambda f: (f / "times.txt").write_text("0\n1\n2\n1.5\n4\n5\n"),
            ["times.txt", "time 4", "1.5"],
        ),
        (lambda f: (f / "times.txt").write_text("0\nnan\n2\n3\n4\n5\n"), ["times.txt:2", "nan"]),
    ],
)
def test_broken_recordings_name_file_and_value(
    spoil: Broken, words: list[str], synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    folder = kitti_folder(synthetic_kitti, tmp_path / "r")
    spoil(folder)
    with pytest.raises(InputError) as error:
        open_recording(folder)
    for word in words:
        assert word in str(error.value)


def test_calibration_of_another_size_is_refused(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    folder = kitti_folder(synthetic_kitti, tmp_path / "r")
    _halve_calibration(folder)
    with pytest.raises(InputError, match="480x240 px, the calibration is for 240x120"):
        open_recording(folder, calibration=folder / "calib.yaml")


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_rate_is_refused(rate_hz: float, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rate_hz"):
        open_recording(tmp_path, rate_hz=rate_hz)


def test_unknown_folder_says_what_was_looked_for(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(InputError, match=r"KITTI.*EuRoC.*side-by-side"):
        open_recording(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        open_recording(tmp_path / "absent")


def test_outside_packages_add_formats(
    synthetic_kitti: SyntheticRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Outside(KittiRecording):
        looks_for = "a folder named outside"

        @staticmethod
        def recognises(path: Path) -> bool:
            return path.name == "outside"

    (tmp_path / "outside").symlink_to(synthetic_kitti.path)
    point = EntryPoint("outside", "unused:unused", recording_module.ENTRY_POINTS)
    monkeypatch.setattr(recording_module, "FORMATS", {})
    monkeypatch.setattr(recording_module, "entry_points", lambda group: [point])
    monkeypatch.setattr(EntryPoint, "load", lambda self: Outside)
    assert isinstance(open_recording(tmp_path / "outside"), Outside)
    with pytest.raises(InputError, match="a folder named outside"):
        open_recording(synthetic_kitti.path)


def test_pictures_without_calibration_ask_for_one(
    synthetic_kitti: SyntheticRecording, tmp_path: Path
) -> None:
    folder = side_by_side(synthetic_kitti, tmp_path / "r")
    (folder / "rig.yaml").unlink()
    with pytest.raises(InputError, match="no calibration"):
        open_recording(folder)


def test_broken_truth_is_named(synthetic_kitti: SyntheticRecording, tmp_path: Path) -> None:
    folder = kitti_folder(synthetic_kitti, tmp_path / "r")
    (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 nan\n" * COUNT)
    with pytest.raises(InputError, match=r"poses.txt:1"):
        open_recording(folder).truth()


def test_names_sort_as_numbers() -> None:
    names = ["image10.png", "image2.png", "image1.png", "image02.png"]
    ordered = sorted((Path(name) for name in names), key=natural_key)
    assert ordered[0].name == "image1.png"
    assert ordered[-1].name == "image10.png"


def test_sixteen_bits_and_colour_become_grey_of_eight() -> None:
    grey = np.tile(np.arange(256, dtype=np.uint16) * 257, (8, 1))
    data = cv2.imencode(".png", grey)[1].tobytes()
    np.testing.assert_array_equal(decode_grey(data, Path("x.png")), grey // 257)
    colour = np.zeros((4, 4, 3), np.uint8)
    colour[..., 1] = 200
    data = cv2.imencode(".png", colour)[1].tobytes()
    np.testing.assert_array_equal(decode_grey(data, Path("x.png")), round(0.587 * 200))


def test_rotation_in_exif_is_ignored() -> None:
    data = cv2.imencode(".jpg", np.zeros((16, 48), np.uint8))[1].tobytes()
    orientation = bytes.fromhex("4d4d002a00000008000101120003000000010006000000000000")
    segment = b"Exif\0\0" + orientation
    exif = b"\xff\xe1" + (len(segment) + 2).to_bytes(2, "big") + segment
    assert decode_grey(data[:2] + exif + data[2:], Path("x.jpg")).shape == (16, 48)


@pytest.mark.parametrize("kept", [0.3, 0.9, 0.999])
def test_cut_jpeg_is_noticed(kept: float) -> None:
    rng = np.random.default_rng(0)
    data = cv2.imencode(".jpg", rng.integers(0, 255, (64, 64), np.uint8))[1].tobytes()
    with pytest.raises(PictureError, match="cut short"):
        decode_grey(data[: int(kept * len(data))], Path("x.jpg"))
    assert decode_grey(data + b"\0" * 100, Path("x.jpg")).shape == (64, 64)


@pytest.mark.parametrize(
    ("name", "count", "size_px", "poses"),
    [
        ("kitti_a", 51, (1226, 370), 51),
        ("kitti_b", 51, (1241, 376), 51),
        ("kitti_c", 99, (1242, 375), 99),
        ("euroc_a", 160, (752, 480), 1990),
        ("euroc_still", 60, (752, 480), 80),
        ("euroc_keyframes", 100, (752, 480), 2895),
        ("zed_steps", 8, (672, 376), 0),
    ],
)
def test_real_recordings_open(
    name: str, count: int, size_px: tuple[int, int], poses: int, data_folder: Path
) -> None:
    configs = Path(__file__).resolve().parents[1] / "configs"
    calibration = configs / "zed_steps.yaml" if name == "zed_steps" else None
    recording = open_recording(data_folder / name, calibration=calibration)
    assert len(recording) == count
    frame = next(iter(recording.frames()))
    assert isinstance(frame, StereoFrame)
    assert frame.left.shape == size_px[::-1]
    truth = recording.truth()
    assert (0 if truth is None else len(truth.timestamps_ns)) == poses
