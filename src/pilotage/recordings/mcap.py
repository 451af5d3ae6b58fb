# SPDX-License-Identifier: Apache-2.0
"""MCAP files in the ROS 2 profile: our own, and stereo bags of other tools."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pilotage import StereoRig
from pilotage.calibration.files import load_rig
from pilotage.errors import InputError
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.frames import BadFrame, DecodeClock, Frames, Grey, StereoFrame, Truth
from pilotage.recordings.mcap_index import MessageFetcher, Topic, read_index
from pilotage.recordings.mcap_pictures import decode_message
from pilotage.recordings.mcap_records import DamageError
from pilotage.recordings.mcap_rig import ROBOT_FRAMES, read_frames, read_rig
from pilotage.recordings.mcap_writer import (
    BODY_KEY,
    LEFT,
    PART_SUFFIX,
    RIGHT,
    STATIC_TRANSFORMS_TOPIC,
    TRUTH_TOPIC,
)
from pilotage.recordings.pairs import PAIRS_CHECKED, SizeError, check_size, steady_times
from pilotage.recordings.pictures import PictureError

FILE_NAME = "recording.mcap"
# Cameras of a pair fire together; a small offset is the clock's, a larger one another picture.
PAIR_TOLERANCE_NS = 2_000_000
PICTURE_TOPIC = re.compile(r"(?P<camera>/.+?)/image(_raw|_mono|_color)?(?P<packed>/compressed)?")
# How the names of a left and a right camera end.
SIDE_WORDS = (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"))
NO_PARTNER = -1


class Cameras(NamedTuple):
    """Where the pictures of the pair are, and what the cameras are called: `/front_left`."""

    left: str
    right: str
    left_topic: Topic
    right_topic: Topic


class McapRecording:
    """Pairs matched by time stamp; a left picture without a right one is a bad frame."""

    looks_for = f"a ROS 2 recording .mcap, or a folder with {FILE_NAME}"

    def __init__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> None:
        self.name = path.resolve().name if path.is_dir() else path.stem
        self.path = path
        self._file = _find_file(path)
        self._topics = read_index(self._file)
        self._cameras = _find_cameras(self._topics, self._file)
        static = self._topics.get(STATIC_TRANSFORMS_TOPIC)
        self._frames = read_frames(self._file, static.first if static else ())
        self.rig, self._left_frame = self._read_rig(calibration)
        self._lefts, self._rights = _match(self._cameras, self._file)
        times_ns = np.array(self._cameras.left_topic.times_ns, np.int64)[self._lefts].tolist()
        self._times_ns = times_ns if rate_hz is None else steady_times(len(times_ns), rate_hz)
        self._clock = DecodeClock()
        self._check_first()

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by the name's end, of the file or of a folder's only one."""
        names = (".mcap", f".mcap{PART_SUFFIX}")
        return bool(path.name.endswith(names) and path.is_file()) or bool(_files(path))

    @property
    def decode_cpu_s(self) -> float:
        """Return the processor time reading and decoding has cost so far."""
        return self._clock.cpu_s

    def __len__(self) -> int:
        return len(self._lefts)

    def frames(self) -> Frames:
        """Return the pairs in order of their stamps, a few chunks in memory."""
        return Frames(self._generate(), self._clock)

    def truth(self) -> Truth | None:
        """Return the poses of /truth/pose, taken to the left camera by /tf_static."""
        topic = self._topics.get(TRUTH_TOPIC)
        if topic is None or not topic.times_ns:
            return None
        body_from_left = self._body_from_left(topic)
        for earlier, later in pairwise(topic.times_ns):
            if later <= earlier:
                raise InputError(
                    f"{self._file}: {TRUTH_TOPIC}: time {later} ns does not come after {earlier} "
                    "ns; remove the topic or sort its messages"
                )
        poses = np.empty((len(topic.times_ns), 4, 4))
        try:
            with MessageFetcher(self._file) as messages:
                for number, (_, data) in enumerate(messages.fetch_all(topic)):
                    pose = ros.read_message(data, ros.POSE).pose
                    poses[number] = ros.transform_of(pose.position, pose.orientation).matrix()
        except (ros.MessageError, DamageError, OSError) as error:
            raise InputError(f"{self._file}: {TRUTH_TOPIC}: {error}; record it again") from None
        world_from_left = poses if body_from_left is None else poses @ body_from_left
        return Truth(np.array(topic.times_ns, np.int64), world_from_left)

    def _body_from_left(self, topic: Topic) -> NDArray[np.float64] | None:
        """Return (4, 4), or None where the truth is of the left camera itself."""
        body = topic.metadata.get(BODY_KEY, "").lstrip("/")
        robot_from_left = self.rig.robot_from_left
        if body == self._left_frame or (not body and robot_from_left is None):
            return None
        if not body or body in ROBOT_FRAMES:
            found = robot_from_left
        else:
            found = self._frames.between(body, self._left_frame)
        if found is None:
            raise InputError(
                f"{self._file}: {TRUTH_TOPIC} is of {body!r}, and nothing says where "
                f"{self._left_frame!r} sits on it; give a calibration with robot_from_left"
            )
        return np.asarray(found.matrix(), np.float64)

    def _read_rig(self, calibration: Path | None) -> tuple[StereoRig, str]:
        left, right = (f"{camera}/camera_info" for camera in self._cameras[:2])
        infos = {name: self._topics[name].first[0] for name in (left, right) if self._has(name)}
        if calibration is not None:
            return load_rig(calibration), self._cameras.left.rpartition("/")[2]
        for name in (left, right):
            if name not in infos:
                raise InputError(f"{self._file}: has no {name}; give a calibration (--calibration)")
        return read_rig(self._file, infos, self._frames)

    def _has(self, info_topic: str) -> bool:
        topic = self._topics.get(info_topic)
        return topic is not None and bool(topic.first)

    def _check_first(self) -> None:
        """Raise InputError unless a pair can be read and has the calibrated size."""
        problems: list[PictureError] = []
        with MessageFetcher(self._file) as messages:
            for index in range(len(self)):
                try:
                    self._read_pair(messages, index)
                    return
                except PictureError as error:
                    problems.append(error)
                if sum(isinstance(p, SizeError) for p in problems) == PAIRS_CHECKED:
                    break
        first = next((p for p in problems if isinstance(p, SizeError)), problems[0])
        raise InputError(
            f"none of the first {len(problems)} pairs can be used: {first}; "
            "give the calibration of these pictures, or record again"
        )

    def _generate(self) -> Iterator[StereoFrame | BadFrame]:
        with MessageFetcher(self._file) as messages:
            for index, timestamp_ns in enumerate(self._times_ns):
                try:
                    left, right = self._read_pair(messages, index)
                except PictureError as error:
                    yield BadFrame(index, timestamp_ns, str(error))
                else:
                    yield StereoFrame(index, timestamp_ns, left, right)

    def _read_pair(self, messages: MessageFetcher, index: int) -> tuple[Grey, Grey]:
        left, right = int(self._lefts[index]), int(self._rights[index])
        topics = self._cameras.left_topic, self._cameras.right_topic
        if right == NO_PARTNER:
            time_ns = topics[0].times_ns[left]
            raise PictureError(f"{self._file}: {topics[0].name} at {time_ns} ns: has no partner")
        pictures = []
        cameras = (self.rig.left, self.rig.right)
        for topic, number, camera in zip(topics, (left, right), cameras, strict=True):
            place = f"{self._file}: {topic.name} at {topic.times_ns[number]} ns"
            try:
                data = messages.fetch(topic, number)
            except DamageError as error:
                raise PictureError(f"{place}: {error}") from None
            picture = decode_message(data, topic.type_name, place)
            check_size(picture, camera, place)
            pictures.append(picture)
        return pictures[0], pictures[1]


def _files(path: Path) -> list[Path]:
    """Return a folder's recording, or all it holds where none has the usual name."""
    if not path.is_dir():
        return []
    usual = path / FILE_NAME
    return [usual] if usual.is_file() else sorted(f for f in path.glob("*.mcap") if f.is_file())


def _find_file(path: Path) -> Path:
    files = [path] if path.is_file() else _files(path)
    if len(files) != 1:
        raise InputError(f"{path}: holds {len(files)} .mcap files; name one of them")
    if files[0].name.endswith(PART_SUFFIX):
        raise InputError(f"{files[0]}: was never finished; `pilotage recover` makes it whole")
    return files[0]


def _find_cameras(topics: dict[str, Topic], file: Path) -> Cameras:
    """Return front_left and front_right, or the only two cameras named left and right."""
    pictures: dict[str, Topic] = {}
    for name in sorted(topics):  # a camera's plain pictures come before its compressed ones
        match = PICTURE_TOPIC.fullmatch(name)
        wanted = ros.IMAGE if match and not match["packed"] else ros.COMPRESSED_IMAGE
        if match and topics[name].type_name == wanted and topics[name].times_ns:
            pictures.setdefault(match["camera"], topics[name])
    pairs = [(f"/{LEFT}", f"/{RIGHT}")] if {f"/{LEFT}", f"/{RIGHT}"} <= pictures.keys() else []
    pairs = pairs or [
        (camera, partner)
        for camera in pictures
        for left, right in SIDE_WORDS
        if camera.endswith(left)
        and (partner := camera.removesuffix(left) + right) in pictures
        and _have_common_time(pictures[camera], pictures[partner])
    ]
    if len(pairs) != 1:
        found = ", ".join(pictures) or "none"
        raise InputError(
            f"{file}: holds {len(pairs)} stereo pairs, one is needed: cameras named /{LEFT} and "
            f"/{RIGHT}, or two that end in left and right; with pictures are: {found}"
        )
    left, right = pairs[0]
    return Cameras(left, right, pictures[left], pictures[right])


def _have_common_time(left: Topic, right: Topic) -> bool:
    return bool(min(left.times_ns) <= max(right.times_ns)) and bool(
        min(right.times_ns) <= max(left.times_ns)
    )


def _match(cameras: Cameras, file: Path) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the left pictures in order of time, each time once, and the right one of each."""
    left_ns, lefts = np.unique(np.array(cameras.left_topic.times_ns, np.int64), return_index=True)
    right_ns, rights = np.unique(
        np.array(cameras.right_topic.times_ns, np.int64), return_index=True
    )
    after = np.clip(np.searchsorted(right_ns, left_ns), 0, len(right_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(right_ns[before] - left_ns) < np.abs(right_ns[after] - left_ns)
    nearest = np.where(is_before, before, after)
    is_near = np.abs(right_ns[nearest] - left_ns) <= PAIR_TOLERANCE_NS
    if not is_near.any():
        raise InputError(
            f"{file}: none of {len(lefts)} left and {len(rights)} right pictures are of the same "
            f"time; left starts at {left_ns[0]} ns, right at {right_ns[0]} ns"
        )
    return lefts, np.where(is_near, rights[nearest], NO_PARTNER)
