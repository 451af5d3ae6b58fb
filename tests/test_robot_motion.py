# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs by name, odometry, joints and moving frames of MCAP files, ours and others'."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from synthetic import SyntheticRecording
from test_mcap import camera, foreign_bag, make_pairs, make_rig

from pilotage import Transform
from pilotage.errors import InputError
from pilotage.recordings import (
    BadFrame,
    SinglePicture,
    open_pictures,
    open_recording,
    read_joints,
    read_odometry,
)
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap import McapRecording
from pilotage.recordings.mcap_writer import McapWriter

STEP_NS = 20_000_000
EYE = np.eye(3, 4)
Names = dict[str, tuple[str, str]]


def sides(*names: str) -> Names:
    return {name.strip("_/"): (f"{name}left", f"{name}right") for name in names}


def write_pairs(file: Path, names: Names) -> None:
    """Write a pair of each, with a rig of its number."""
    with McapWriter(file) as writer:
        for number, (left, right) in enumerate(names.values()):
            writer.add_rig(make_rig(number), timestamp_ns=0, left=left, right=right)
            pictures = make_pairs(1, number)[0]
            writer.write_pair(
                timestamp_ns=0, left=pictures[0], right=pictures[1], cameras=(left, right)
            )


@pytest.mark.parametrize(
    ("names", "default"),
    [
        (sides("down_", "front_", "rear_"), "front"),
        (sides("down/", "forward/"), "forward"),
        (sides("down_"), "down"),
        ({"stereo": ("left", "right")}, "stereo"),
        ({"stereo": ("cam0", "cam1"), **sides("front_")}, "front"),
        ({"nose": ("nose/infra1", "nose/infra2")}, "nose"),
    ],
)
def test_pairs_have_names(names: Names, default: str, tmp_path: Path) -> None:
    write_pairs(tmp_path / "a.mcap", names)
    recording = open_recording(tmp_path / "a.mcap")
    assert isinstance(recording, McapRecording)
    assert set(recording.pairs) == set(names)
    assert recording.pair == default
    for number, name in enumerate(names):
        read = open_recording(tmp_path / "a.mcap", pair=name).rig.right_from_left
        assert (read.translation_m == make_rig(number).right_from_left.translation_m).all()


def test_unclear_and_unknown_pairs_are_told(
    tmp_path: Path, synthetic_kitti: SyntheticRecording
) -> None:
    write_pairs(tmp_path / "a.mcap", sides("a_", "b_"))
    with pytest.raises(InputError, match=r"2 stereo pairs \(a, b\).*--pair"):
        open_recording(tmp_path / "a.mcap")
    with pytest.raises(InputError, match="no stereo pair 'c'; there are: a, b"):
        open_recording(tmp_path / "a.mcap", pair="c")
    with pytest.raises(InputError, match="pair 'front': holds one stereo pair"):
        open_recording(synthetic_kitti.path, pair="front")


def test_odometry_comes_back_as_it_was(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses = [Transform.exp(twist) for twist in rng.normal(0, 1, (9, 6))]
    covariance, twists = rng.normal(0, 1, (6, 6)), rng.normal(0, 1, (9, 6))
    with McapWriter(tmp_path / "a.mcap") as writer:
        for i, (pose, twist) in enumerate(zip(poses, twists.tolist(), strict=True)):
            writer.write_odometry(
                timestamp_ns=i * STEP_NS + 1,
                odom_from_robot=pose,
                covariance=covariance,
                twist=twist,
            )
    read = read_odometry(tmp_path / "a.mcap")
    assert read is not None
    assert read.timestamps_ns.tolist() == [i * STEP_NS + 1 for i in range(9)]
    np.testing.assert_allclose(read.odom_from_robot, [pose.matrix() for pose in poses], atol=1e-15)
    np.testing.assert_array_equal(read.covariances, [covariance] * 9)
    np.testing.assert_array_equal(read.twists, twists)


def test_joints_come_back_and_what_is_not_told_is_nan(tmp_path: Path) -> None:
    told = [{"HeadYaw": 0.1, "HeadPitch": -0.2}, {"HeadYaw": 0.3}, {"LKneePitch": 1.5}]
    with McapWriter(tmp_path / "a.mcap") as writer:
        for i, angles in enumerate(told):
            writer.write_joints(timestamp_ns=i * STEP_NS + 1, positions_rad=angles)
    read = read_joints(tmp_path / "a.mcap")
    assert read is not None
    assert read.names == ("HeadYaw", "HeadPitch", "LKneePitch")
    nan = np.nan
    np.testing.assert_array_equal(
        read.positions_rad, [[0.1, -0.2, nan], [0.3, nan, nan], [nan, nan, 1.5]]
    )
    np.testing.assert_array_equal(read.of("HeadPitch"), [-0.2, nan, nan])
    with pytest.raises(InputError, match=r"'RKneePitch'.*there are: HeadYaw"):
        read.of("RKneePitch")


def test_where_there_is_none_none_is_returned(
    tmp_path: Path, synthetic_kitti: SyntheticRecording
) -> None:
    write_pairs(tmp_path / "a.mcap", sides("front_"))
    for path in (tmp_path / "a.mcap", synthetic_kitti.path):
        assert read_odometry(path) is None
        assert read_joints(path) is None
    for read in (read_odometry, read_joints, open_pictures):
        with pytest.raises(InputError, match="does not exist"):
            read(tmp_path / "b.mcap")
    with pytest.raises(InputError, match="no pictures"):
        open_pictures(synthetic_kitti.path)


def write_messages(file: Path, messages: list[tuple[str, str, int, bytes]]) -> None:
    """Write topic, type, log time and data of each, as another tool would."""
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="another tool")
        channels: dict[str, int] = {}
        for topic, type_name, time_ns, data in messages:
            if topic not in channels:
                text = ros.schema(1, type_name).data
                schema = writer.register_schema(type_name, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()


def odometry(time_ns: int) -> bytes:
    return ros.odometry(("odom", "base_link"), time_ns, Transform(), np.eye(6), [0.0] * 6)


def test_of_several_topics_one_is_named(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    topics = ["/wheel/odometry", "/visual/odometry"]
    write_messages(file, [(topic, ros.ODOMETRY, 5, odometry(5)) for topic in topics])
    with pytest.raises(InputError, match=r"several topics.*/visual/odometry, /wheel/odometry"):
        read_odometry(file)
    with pytest.raises(InputError, match=r"no nav_msgs/msg/Odometry on /odom; name a topic"):
        read_odometry(file, topic="/odom")
    assert read_odometry(file, topic="/wheel/odometry") is not None
    write_messages(file, [(topics[0], ros.ODOMETRY, 5, odometry(5))])
    read = read_odometry(file)
    assert read is not None
    assert read.timestamps_ns.tolist() == [5]


@pytest.mark.parametrize(
    ("times_ns", "data", "words"),
    [
        ([5, 5], None, "time 5 ns does not come after 5 ns"),
        ([5], b"\0\1\0\0", "no nav_msgs"),
    ],
)
def test_broken_odometry_is_told(
    times_ns: list[int], data: bytes | None, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.mcap"
    messages = [("/odom", ros.ODOMETRY, t, odometry(t) if data is None else data) for t in times_ns]
    write_messages(file, messages)
    with pytest.raises(InputError, match=words):
        read_odometry(file)


def all_of(path: str | Path) -> None:
    """Read all there is; nothing but InputError may come of it."""
    with contextlib.suppress(InputError):
        recording = open_pictures(path)
        assert sum(1 for _ in recording.pictures()) == len(recording)
        recording.truth("top")
    for read in (read_odometry, read_joints):
        with contextlib.suppress(InputError):
            read(path)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_messages_are_told_and_nothing_else(data: st.DataObject) -> None:
    pose = Transform.exp(np.full(6, 0.3))
    known, picture = camera("none", [], 0), make_pairs(1)[0][0]
    messages = [
        ("/top/camera_info", ros.CAMERA_INFO, 5, ros.camera_info("top", 5, known, np.eye(3), EYE)),
        ("/top/image_raw", ros.IMAGE, 5, ros.image("top", 5, "mono8", picture)),
        ("/tf_static", ros.TRANSFORMS, 5, ros.transforms(5, {("head", "top"): pose})),
        ("/tf", ros.TRANSFORMS, 5, ros.transforms(5, {("torso", "head"): pose})),
        ("/joint_states", ros.JOINTS, 5, ros.joints(5, {"HeadYaw": 1.0, "HeadPitch": 2.0})),
        ("/odom", ros.ODOMETRY, 5, odometry(5)),
        ("/truth/top", ros.POSE, 5, ros.pose("world", 5, pose)),
    ]
    number = data.draw(st.integers(0, len(messages) - 1))
    topic, type_name, time_ns, content = messages[number]
    changed = bytearray(content[: data.draw(st.integers(0, len(content)))] or content)
    for _ in range(data.draw(st.integers(0, 3))):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    messages[number] = (topic, type_name, time_ns, bytes(changed))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.mcap"
        write_messages(file, messages)
        all_of(file)


@pytest.mark.parametrize("path", ["", "\0", "x" * 5000, "\ud800"])
def test_hostile_paths(path: str) -> None:
    all_of(path)


def write_head(file: Path, *, joints_ns: list[int]) -> None:
    """Write ten pictures of a head's camera, and its joint and frame at these times."""
    picture = make_pairs(1)[0][0]
    with McapWriter(file) as writer:
        writer.add_camera("top", camera("none", [], 0))
        seat = Transform(translation_m=[0.0, 0.0, 0.1])
        writer.add_static_transforms({("head", "top"): seat}, timestamp_ns=0)
        for i in range(10):
            writer.write_picture("top", timestamp_ns=(1 + i) * 10 * STEP_NS, picture=picture)
        for time_ns in joints_ns:
            angle = time_ns * 1e-9
            turned = Transform.exp(np.array([0, 0, 0, 0, 0, angle]))
            writer.write_joints(timestamp_ns=time_ns, positions_rad={"HeadYaw": angle})
            writer.write_transforms({("torso", "head"): turned}, timestamp_ns=time_ns)


def test_a_picture_brings_what_was_told_near_its_time(tmp_path: Path) -> None:
    told_ns = [10 * STEP_NS + 4_000_000, 10 * STEP_NS - 2_000_000, 30 * STEP_NS, 31 * STEP_NS]
    write_head(tmp_path / "a.mcap", joints_ns=sorted(told_ns))
    recording = open_pictures(tmp_path / "a.mcap")
    assert len(recording) == 10
    assert recording.truth("top") is None
    for _ in range(2):  # a second pass starts anew
        pictures = [p for p in recording.pictures() if isinstance(p, SinglePicture)]
        assert [p.index for p in pictures] == list(range(10))
        angles = [p.joints_rad.get("HeadYaw") for p in pictures]
        assert angles == pytest.approx([0.198, None, 0.6, *[None] * 7])
        for picture, angle in zip(pictures, angles, strict=True):
            assert (picture.torso_from_camera is None) == (angle is None)
            assert picture.robot_from_camera is None
            assert picture.odom_from_robot is None
            assert picture.is_moving is None
        turned = pictures[2].torso_from_camera
        assert turned is not None
        np.testing.assert_allclose(turned.log()[5], 0.6)
        np.testing.assert_allclose(turned.translation_m, [0, 0, 0.1])


def test_a_picture_that_cannot_be_read_is_a_bad_frame(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    turn, projection = np.eye(3), np.eye(3, 4)
    known = camera("none", [], 0)
    info = ros.camera_info("top", 5, known, turn, projection)
    picture = make_pairs(1)[0][0]
    pictures = [picture, picture[:9], picture]
    messages = [("/top/camera_info", ros.CAMERA_INFO, 5, info)]
    messages += [
        ("/top/image_raw", ros.IMAGE, 5 + i, ros.image("top", 5 + i, "mono8", seen))
        for i, seen in enumerate(pictures)
    ]
    write_messages(file, messages)
    read = list(open_pictures(file).pictures())
    assert [isinstance(p, BadFrame) for p in read] == [False, True, False]
    assert isinstance(read[1], BadFrame)
    assert "/top/image_raw at 6 ns" in read[1].reason


def test_pictures_without_calibration_are_refused(tmp_path: Path) -> None:
    foreign_bag(tmp_path / "a.mcap", has_info=False)
    with pytest.raises(InputError, match="no camera with pictures and camera_info"):
        open_pictures(tmp_path / "a.mcap")
