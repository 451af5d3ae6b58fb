# SPDX-License-Identifier: Apache-2.0
"""MCAP files in the ROS 2 profile: our own, and stereo bags of other tools."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotage import StereoRig
from pilotage.calibration.files import load_rig
from pilotage.calibration.rig import READOUT
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame, DecodeClock, Frames, Grey, StereoFrame, Truth
from pilotage.recordings.mcap_index import (
    FILE_NAME,
    MessageFetcher,
    Topic,
    find_file,
    is_mcap,
    read_index,
    read_metadata,
)
from pilotage.recordings.mcap_motion import read_poses
from pilotage.recordings.mcap_pairs import (
    NO_PARTNER,
    choose_pair,
    find_pairs,
    match_pictures,
    silent_pairs,
)
from pilotage.recordings.mcap_pictures import decode_message
from pilotage.recordings.mcap_records import DamageError
from pilotage.recordings.mcap_rig import ROBOT_FRAMES, read_frames, read_rig
from pilotage.recordings.mcap_writer import (
    BODY_KEY,
    STATIC_TRANSFORMS_TOPIC,
    TRUTH_TOPIC,
)
from pilotage.recordings.pairs import PAIRS_CHECKED, SizeError, check_size, steady_times
from pilotage.recordings.pictures import PictureError
from pilotage.recordings.recording import OpenedPairs, Recording


class McapRecording:
    """Pairs matched by time stamp; a left picture without a right one is a bad frame.

    `pairs` names the stereo pairs of the file, `pair` the one that is read.
    """

    looks_for = f"a ROS 2 recording .mcap, or a folder with {FILE_NAME}"

    def __init__(
        self,
        path: Path,
        calibration: Path | None,
        rate_hz: float | None,
        pair: str | None = None,
        topics: dict[str, Topic] | None = None,
    ) -> None:
        self.name = path.resolve().name if path.is_dir() else path.stem
        self.path = path
        self._file = find_file(path)
        self._topics = read_index(self._file) if topics is None else topics
        pairs = find_pairs(self._topics)
        self.pairs = tuple(pairs)
        self.pair = choose_pair(self._topics, pair, self._file)
        self._cameras = pairs[self.pair]
        static = self._topics.get(STATIC_TRANSFORMS_TOPIC)
        self._frames = read_frames(self._file, static.first if static else ())
        self.rig, self._left_frame = self._read_rig(calibration)
        self._lefts, self._rights = match_pictures(self._cameras, self._file)
        times_ns = np.array(self._cameras.left_topic.times_ns, np.int64)[self._lefts].tolist()
        self._times_ns = times_ns if rate_hz is None else steady_times(len(times_ns), rate_hz)
        self._clock = DecodeClock()
        self._check_first()

    @classmethod
    def open_pair(
        cls, path: Path, calibration: Path | None, rate_hz: float | None, pair: str
    ) -> McapRecording:
        """Open the stereo pair of that name; InputError lists those there are."""
        return cls(path, calibration, rate_hz, pair)

    @classmethod
    def open_pairs(cls, path: Path, calibration: Path | None, rate_hz: float | None) -> OpenedPairs:
        """Open every stereo pair that can be used, the file read once."""
        topics = read_index(find_file(path))
        names = (choose_pair(topics, None, path, may_guess=True), *find_pairs(topics))
        sound: dict[str, Recording] = {}
        left_out = silent_pairs(topics)
        for name in dict.fromkeys(names):
            try:
                sound[name] = cls(path, calibration, rate_hz, name, topics)
            except InputError as error:
                left_out[name] = str(error)
        return OpenedPairs(sound, left_out)

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by the name's end, of the file or of a folder's only one."""
        return is_mcap(path)

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
        poses = read_poses(self._file, topic)
        world_from_left = poses.poses if body_from_left is None else poses.poses @ body_from_left
        return Truth(poses.timestamps_ns, world_from_left)

    def metadata(self, name: str) -> dict[str, str] | None:
        """Return what the file says of itself under that name; None where it says nothing."""
        return read_metadata(self._file, name)

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
            return load_rig(calibration, pair=self.pair), self._cameras.left.rpartition("/")[2]
        for name in (left, right):
            if name not in infos:
                raise InputError(f"{self._file}: has no {name}; give a calibration (--calibration)")
        shutters = {name: self._topics[name].metadata.get(READOUT, "") for name in infos}
        return read_rig(self._file, infos, self._frames, shutters)

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
