# SPDX-License-Identifier: Apache-2.0
# Long: one format, from the exactness of its numbers to other tools' view of it.
"""Recordings in MCAP: exact, readable by other tools, and refused in clear words."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration import save_rig
from pilotage.errors import InputError, RunError
from pilotage.recordings import BadFrame, StereoFrame, open_recording
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap_writer import McapWriter, Pictures

WIDTH, HEIGHT = 64, 48
START_NS = 1_700_000_000_123_456_789
STEP_NS = 50_000_001
BROWN = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0123]
KANNALA_BRANDT = [-0.0129, 0.0211, -0.0304, 0.0101]


def camera(distortion: str, coefficients: list[float], seed: int) -> Camera:
    fx, fy, cx, cy = np.random.default_rng(seed).normal([60, 61, 31.4, 23.3], 0.3).tolist()
    return Camera(
        width_px=WIDTH, height_px=HEIGHT, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy,
        distortion=distortion, coefficients=coefficients,
    )  # fmt: skip


def make_rig(seed: int, *, lens: str = "brown", with_robot: bool = True) -> StereoRig:
    """Return a rig whose numbers need all their digits."""
    rng = np.random.default_rng(seed)
    coefficients = {"none": [], "brown": BROWN, "kannala_brandt": KANNALA_BRANDT}[lens]
    turn = Transform.exp(np.r_[np.zeros(3), rng.normal(0, 0.01, 3)])
    sits = Transform.exp(rng.normal(0, 0.7, 6))
    return StereoRig(
        left=camera(lens, coefficients, seed),
        right=camera(lens, coefficients, seed + 1),
        right_from_left=Transform(
            translation_m=[-0.11 + rng.normal(0, 1e-3), *rng.normal(0, 1e-3, 2)],
            quaternion_wxyz=turn.quaternion_wxyz.tolist(),
        ),
        robot_from_left=sits if with_robot else None,
        readout_s=rng.uniform(0.001, 0.03) if seed % 2 else 0.0,
    )


def make_pairs(count: int, seed: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return pictures of which the left ones pay to be packed and the right ones do not."""
    rng = np.random.default_rng(seed)
    shape = (HEIGHT, WIDTH)
    smooth = [
        cv2.GaussianBlur(rng.integers(0, 255, shape, np.uint8), (9, 9), 5) for _ in range(count)
    ]
    return [(left, rng.integers(0, 255, shape, np.uint8)) for left in smooth]


def times_ns(count: int) -> list[int]:
    return [START_NS + i * STEP_NS for i in range(count)]


def write_recording(
    file: Path, rig: StereoRig, count: int = 8, *, pictures: Pictures = "auto", body: str = "robot"
) -> list[Transform]:
    """Write pairs with truth, odometry, joints and moving frames; return the true poses."""
    rng = np.random.default_rng(5)
    poses = [Transform.exp(rng.normal(0, 1, 6)) for _ in range(count)]
    with McapWriter(file, pictures=pictures) as writer:
        writer.add_rig(rig, timestamp_ns=START_NS)
        for time_ns, (left, right), pose in zip(
            times_ns(count), make_pairs(count), poses, strict=True
        ):
            writer.write_pair(timestamp_ns=time_ns, left=left, right=right)
            writer.write_truth(timestamp_ns=time_ns, world_from_body=pose, body=body)
            writer.write_odometry(
                timestamp_ns=time_ns,
                odom_from_robot=pose,
                covariance=np.eye(6),
                twist=[1, 2, 3, 4, 5, 6],
            )
            writer.write_transforms({("odom", "robot"): pose}, timestamp_ns=time_ns)
            writer.write_joints(
                timestamp_ns=time_ns, positions_rad={"HeadYaw": 0.1, "HeadPitch": 2}
            )
    return poses


def numbers(transform: Transform | None) -> list[float]:
    assert transform is not None
    return [*transform.translation_m.tolist(), *transform.quaternion_wxyz.tolist()]


def camera_numbers(camera: Camera) -> list[object]:
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px", "distortion")
    return [*(getattr(camera, name) for name in names), *camera.coefficients]


@pytest.mark.parametrize("lens", ["none", "brown", "kannala_brandt"])
@pytest.mark.parametrize("seed", range(4))
def test_calibration_comes_back_to_the_last_bit(lens: str, seed: int, tmp_path: Path) -> None:
    rig = make_rig(seed, lens=lens, with_robot=bool(seed % 2))
    write_recording(tmp_path / "a.mcap", rig, 1)
    read = open_recording(tmp_path / "a.mcap").rig
    assert numbers(read.right_from_left) == numbers(rig.right_from_left)
    assert camera_numbers(read.left) == camera_numbers(rig.left)
    assert camera_numbers(read.right) == camera_numbers(rig.right)
    assert read.readout_s == rig.readout_s
    if seed % 2:
        assert numbers(read.robot_from_left) == numbers(rig.robot_from_left)
    else:
        assert read.robot_from_left is None


@pytest.mark.parametrize("pictures", ["auto", "png", "raw"])
def test_pictures_and_times_come_back_the_same(pictures: Pictures, tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", make_rig(0), pictures=pictures)
    recording = open_recording(tmp_path / "a.mcap")
    for _ in range(2):  # a second pass starts anew
        frames = list(recording.frames())
        assert [frame.timestamp_ns for frame in frames] == times_ns(8)
        for frame, (left, right) in zip(frames, make_pairs(8), strict=True):
            assert isinstance(frame, StereoFrame)
            np.testing.assert_array_equal(frame.left, left)
            np.testing.assert_array_equal(frame.right, right)
    assert len(recording) == 8
    assert recording.name == "a"
    assert recording.decode_cpu_s > 0


def test_png_is_taken_where_it_pays(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.mcap", make_rig(0))
    with Reader(tmp_path / "a.mcap") as bag:
        topics = {connection.topic for connection in bag.connections}
    assert "/front_left/image_raw/compressed" in topics
    assert "/front_right/image_raw" in topics


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8"])
@pytest.mark.parametrize("pictures", ["png", "raw"])
def test_colour_becomes_the_same_grey(encoding: str, pictures: Pictures, tmp_path: Path) -> None:
    colour = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY if encoding == "bgr8" else cv2.COLOR_RGB2GRAY)
    with McapWriter(tmp_path / "a.mcap", pictures=pictures) as writer:
        writer.add_rig(make_rig(0), timestamp_ns=0)
        for name in ("front_left", "front_right"):
            writer.write_picture(name, timestamp_ns=0, picture=colour, encoding=encoding)
    frame = next(iter(open_recording(tmp_path / "a.mcap").frames()))
    assert isinstance(frame, StereoFrame)
    np.testing.assert_array_equal(frame.left, grey)


@pytest.mark.parametrize("body", ["robot", "front_left", "front_right"])
def test_truth_is_of_the_left_camera(body: str, tmp_path: Path) -> None:
    rig = make_rig(3)
    poses = write_recording(tmp_path / "a.mcap", rig, body=body)
    truth = open_recording(tmp_path / "a.mcap").truth()
    assert truth is not None
    assert truth.timestamps_ns.tolist() == times_ns(8)
    assert rig.robot_from_left is not None
    body_from_left = {
        "robot": rig.robot_from_left, "front_left": Transform(), "front_right": rig.right_from_left
    }[body]  # fmt: skip
    for matrix, pose in zip(truth.world_from_left, poses, strict=True):
        np.testing.assert_allclose(matrix, (pose @ body_from_left).matrix(), atol=1e-14)
        if body == "front_left":
            np.testing.assert_array_equal(matrix, pose.matrix())


def test_truth_of_nobody_is_the_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    poses = write_recording(tmp_path / "a.mcap", make_rig(3), 2)
    monkeypatch.setattr("pilotage.recordings.mcap.BODY_KEY", "something else")
    recording = open_recording(tmp_path / "a.mcap")
    truth = recording.truth()
    assert truth is not None
    assert recording.rig.robot_from_left is not None
    world_from_left = (poses[1] @ recording.rig.robot_from_left).matrix()
    np.testing.assert_allclose(truth.world_from_left[1], world_from_left, atol=1e-14)


@pytest.mark.parametrize(("w", "is_one"), [(1.009, True), (0.98, False), (float("nan"), False)])
def test_quaternions_of_few_digits_are_taken(w: float, is_one: bool) -> None:
    vector, quaternion = SimpleNamespace(x=1, y=2, z=3), SimpleNamespace(w=w, x=0, y=0, z=0)
    if is_one:
        transform = ros.transform_of(vector, quaternion)
        assert numbers(transform) == [1, 2, 3, 1, 0, 0, 0]
    else:
        with pytest.raises(ros.MessageError, match="no transform"):
            ros.transform_of(vector, quaternion)


def test_a_rover_with_two_rigs(tmp_path: Path) -> None:
    front, down = make_rig(1), make_rig(2)
    names = ("down_left", "down_right")
    (left, right), (other_left, other_right) = make_pairs(2)
    for file, has_front in (("both.mcap", True), ("down.mcap", False)):
        with McapWriter(tmp_path / file) as writer:
            if has_front:
                writer.add_rig(front, timestamp_ns=0)
            writer.add_rig(down, timestamp_ns=0, left=names[0], right=names[1])
            if has_front:
                writer.write_pair(timestamp_ns=0, left=left, right=right)
            writer.write_pair(timestamp_ns=0, left=other_left, right=other_right, cameras=names)
            writer.flush()
        recording = open_recording(tmp_path / file)
        rig, picture = (front, left) if has_front else (down, other_left)
        frame = next(iter(recording.frames()))
        assert isinstance(frame, StereoFrame)
        np.testing.assert_array_equal(frame.left, picture)
        assert numbers(recording.rig.right_from_left) == numbers(rig.right_from_left)
        assert numbers(recording.rig.robot_from_left) == numbers(rig.robot_from_left)


def test_a_recording_without_truth(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap") as writer:
        writer.add_rig(make_rig(0), timestamp_ns=0)
        writer.write_pair(timestamp_ns=0, left=make_pairs(1)[0][0], right=make_pairs(1)[0][1])
    assert open_recording(tmp_path / "a.mcap").truth() is None


def test_chunks_are_small_and_whole(tmp_path: Path) -> None:
    large = Camera(width_px=1300, height_px=1000, fx_px=900, fy_px=900, cx_px=650, cy_px=500)
    noise = np.random.default_rng(0).integers(0, 255, (1000, 1300), np.uint8)
    with McapWriter(tmp_path / "a.mcap", pictures="raw") as writer:
        writer.add_camera("top", large)
        writer.add_rig(make_rig(0), timestamp_ns=0)
        for i in range(300):
            left, right = make_pairs(1, i)[0]
            writer.write_pair(timestamp_ns=i * 5_000_000, left=left, right=right)
            if i == 150:
                writer.write_picture("top", timestamp_ns=i * 5_000_000, picture=noise)
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        assert summary is not None
        large_chunks = [c for c in summary.chunk_indexes if c.chunk_length > 1_000_000]
        assert [c.uncompressed_size - noise.size < 200 for c in large_chunks] == [True]
        assert len(summary.chunk_indexes) >= 4
        assert summary.statistics is not None
        assert summary.statistics.message_count == 300 * 4 + 3
        spans_ns = [c.message_end_time - c.message_start_time for c in summary.chunk_indexes]
        assert max(spans_ns) <= 1_000_000_000
        messages = [(m.log_time, m.channel_id) for _, _, m in reader.iter_messages()]
    assert len(messages) == 1203
    with (tmp_path / "a.mcap").open("rb") as file:  # the data section's checksum, too
        assert sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages()) == 1203


def test_other_tools_read_every_message(tmp_path: Path) -> None:
    poses = write_recording(tmp_path / "a.mcap", make_rig(0))
    with AnyReader([tmp_path / "a.mcap"]) as bag:  # with the definitions in the file
        seen: dict[str, list[tuple[int, object]]] = {}
        for connection, time_ns, data in bag.messages():
            message = bag.deserialize(data, connection.msgtype)
            seen.setdefault(connection.topic, []).append((time_ns, message))
    assert {topic: len(messages) for topic, messages in seen.items()} == {
        "/tf_static": 1, "/tf": 8, "/odom": 8, "/truth/pose": 8, "/joint_states": 8,
        "/front_left/camera_info": 8, "/front_right/camera_info": 8,
        "/front_left/image_raw/compressed": 8, "/front_right/image_raw": 8,
    }  # fmt: skip
    time, odometry = seen["/odom"][3]
    assert (time, odometry.child_frame_id) == (START_NS + 3 * STEP_NS, "robot")
    assert odometry.pose.pose.position.x == poses[3].translation_m[0]
    assert odometry.twist.twist.angular.z == 6
    assert seen["/joint_states"][0][1].position.tolist() == [0.1, 2]
    right = seen["/front_right/camera_info"][0][1]
    baseline_m = np.linalg.norm(make_rig(0).right_from_left.translation_m)
    assert -right.p[3] / right.p[0] == pytest.approx(baseline_m)
    with Reader(tmp_path / "a.mcap") as bag:
        latched = [c.ext.offered_qos_profiles for c in bag.connections if c.topic == "/tf_static"]
    assert latched[0][0].durability.name == "TRANSIENT_LOCAL"


def foreign_bag(
    file: Path,
    *,
    cameras: tuple[str, ...] = ("/stereo/left", "/stereo/right"),
    compression: CompressionType = CompressionType.LZ4,
    right_late_ns: int = 0,
    has_info: bool = True,
) -> None:
    """Write a bag by the library's own writer, one unchunked where `compression` is NONE."""
    chunked = compression is not CompressionType.NONE
    with file.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked)
        writer.start(profile="ros2", library="another tool")
        schemas = {
            name: writer.register_schema(name, "ros2msg", ros.schema(1, name).data)
            for name in (ros.IMAGE, ros.CAMERA_INFO)
        }
        turn = np.eye(3)
        for side, name in enumerate(cameras):
            lens = camera("brown", BROWN, side)
            p = np.array([[60.0, 0, 31, -60 * 0.12 * side], [0, 60, 23, 0], [0, 0, 1, 0]])
            topics = [(f"{name}/image_raw", ros.IMAGE), (f"{name}/camera_info", ros.CAMERA_INFO)]
            image, info = (writer.register_channel(t, "cdr", schemas[s]) for t, s in topics)
            for i, time_ns in enumerate(times_ns(6)):
                stamp_ns = time_ns + side * right_late_ns
                data = ros.image("eye", stamp_ns, "mono8", make_pairs(6)[i][side % 2])
                writer.add_message(image, stamp_ns + 7_000_000, data, stamp_ns)
                if has_info:
                    data = ros.camera_info("eye", stamp_ns, lens, turn, p)
                    writer.add_message(info, stamp_ns + 7_000_000, data, stamp_ns)
        writer.finish()


@pytest.mark.parametrize("compression", list(CompressionType))
def test_bags_of_other_tools(compression: CompressionType, tmp_path: Path) -> None:
    foreign_bag(tmp_path / "bag_0.mcap", compression=compression, right_late_ns=1_000_000)
    recording = open_recording(tmp_path)  # the folder's only .mcap
    frames = list(recording.frames())
    assert [frame.timestamp_ns for frame in frames] == times_ns(6)  # by stamp, not by arrival
    for frame, (left, right) in zip(frames, make_pairs(6), strict=True):
        assert isinstance(frame, StereoFrame)
        np.testing.assert_array_equal(frame.left, left)
        np.testing.assert_array_equal(frame.right, right)
    # Without /tf_static the place of the right camera comes from P.
    np.testing.assert_allclose(recording.rig.right_from_left.translation_m, [-0.12, 0, 0])
    assert recording.truth() is None


def test_a_picture_without_partner_is_a_bad_frame(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "recording.mcap") as writer:
        writer.add_rig(make_rig(0), timestamp_ns=0)
        for i, (left, right) in enumerate(make_pairs(4)):
            writer.write_picture("front_left", timestamp_ns=i * STEP_NS, picture=left)
            if i != 2:
                writer.write_picture("front_right", timestamp_ns=i * STEP_NS, picture=right)
    frames = list(open_recording(tmp_path).frames())
    assert [f.index for f in frames if isinstance(f, BadFrame)] == [2]
    assert isinstance(frames[2], BadFrame)
    assert "front_left/image_raw" in frames[2].reason
    assert "partner" in frames[2].reason


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f: f.write_bytes(b""), ["MCAP"]),
        (lambda f: f.write_bytes(os.urandom(100)), ["MCAP", "recover"]),
        (lambda f: foreign_bag(f, cameras=("/a/left", "/b/right")), ["0 stereo pairs", "/a/left"]),
        (lambda f: foreign_bag(f, cameras=("/left",)), ["0 stereo pairs", "front_left"]),
        (lambda f: foreign_bag(f, has_info=False), ["camera_info", "--calibration"]),
        (lambda f: foreign_bag(f, right_late_ns=3_000_000), ["6 left and 6 right", "same time"]),
        (
            lambda f: foreign_bag(f, cameras=("/a_left", "/a_right", "/b_left", "/b_right")),
            ["2 stereo pairs"],
        ),
    ],
)
def test_what_cannot_be_used_is_told(
    make: Callable[[Path], None], words: list[str], tmp_path: Path
) -> None:
    make(tmp_path / "a.mcap")
    with pytest.raises(InputError) as error:
        open_recording(tmp_path / "a.mcap")
    for word in ["a.mcap", *words]:
        assert word in str(error.value)


def test_a_calibration_can_be_given(tmp_path: Path) -> None:
    foreign_bag(tmp_path / "a.mcap", has_info=False)
    save_rig(make_rig(2), tmp_path / "rig.yaml")
    recording = open_recording(tmp_path / "a.mcap", calibration=tmp_path / "rig.yaml", rate_hz=10)
    assert numbers(recording.rig.right_from_left) == numbers(make_rig(2).right_from_left)
    assert [f.timestamp_ns for f in recording.frames()][:2] == [0, 100_000_000]


def test_nothing_half_written_looks_whole(tmp_path: Path) -> None:
    def fail() -> None:
        with McapWriter(tmp_path / "a.mcap") as writer:
            writer.add_rig(make_rig(0), timestamp_ns=0)
            left, right = make_pairs(1)[0]
            writer.write_pair(timestamp_ns=0, left=left, right=right)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap.part"]
    with pytest.raises(InputError, match=r"a\.mcap\.part.*pilotage recover"):
        open_recording(tmp_path / "a.mcap.part")
    with (
        pytest.raises(InputError, match=r"a\.mcap\.part exists.*recover"),
        McapWriter(tmp_path / "a.mcap"),
    ):
        pass


def test_existing_files_and_other_names_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    for name, word in (("a.mcap", "exists"), ("a.bag", "end in .mcap")):
        with pytest.raises(InputError, match=word), McapWriter(tmp_path / name):
            pass
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"
    with (
        pytest.raises(RunError, match=r"absent/a\.mcap"),
        McapWriter(tmp_path / "absent" / "a.mcap"),
    ):
        pass


def test_wrong_calls_are_told(tmp_path: Path) -> None:
    left, right = make_pairs(1)[0]
    with McapWriter(tmp_path / "a.mcap") as writer:
        with pytest.raises(ValueError, match="add_rig"):
            writer.write_pair(timestamp_ns=0, left=left, right=right)
        writer.add_rig(make_rig(0), timestamp_ns=0)
        with pytest.raises(ValueError, match="64x48"):
            writer.write_pair(timestamp_ns=0, left=left[:, :9], right=right)
        with pytest.raises(ValueError, match="mono8"):
            writer.write_pair(timestamp_ns=0, left=np.dstack([left] * 3), right=right)
        with pytest.raises(InputError, match="2038"):
            writer.write_pair(timestamp_ns=2**62, left=left, right=right)
        writer.write_truth(timestamp_ns=0, world_from_body=Transform())
        with pytest.raises(ValueError, match="truth of 'front_left' after truth of 'robot'"):
            writer.write_truth(timestamp_ns=0, world_from_body=Transform(), body="front_left")
