# SPDX-License-Identifier: Apache-2.0
"""Single pictures of an MCAP file, and where their cameras were by the robot's own account."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pilotage import Camera, Transform
from pilotage.errors import InputError
from pilotage.recordings import mcap_motion
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.frames import BadFrame
from pilotage.recordings.mcap_index import MessageFetcher, Topic, find_file, read_index
from pilotage.recordings.mcap_pairs import picture_topics
from pilotage.recordings.mcap_pictures import decode_message
from pilotage.recordings.mcap_records import DamageError
from pilotage.recordings.mcap_rig import ROBOT_FRAMES, FrameTree, camera_of, read_frames, read_info
from pilotage.recordings.mcap_writer import (
    BODY_KEY,
    JOINTS_TOPIC,
    ODOMETRY_TOPIC,
    STATIC_TRANSFORMS_TOPIC,
    TRANSFORMS_TOPIC,
    TRUTH_TOPIC,
    frame_truth_topic,
)
from pilotage.recordings.motion import FramePoses, nearest
from pilotage.recordings.pairs import check_size
from pilotage.recordings.pictures import PictureError
from pilotage.recordings.single import SinglePicture

TORSO = "torso"
# What was said of joints and odometry further off than this is of another moment.
WITHIN_NS = 100_000_000
MOVING_M_S, MOVING_RAD_S = 1e-3, 1e-3


class _Place(NamedTuple):
    """Where a picture is: its time, its camera, the topic and the number of its message."""

    timestamp_ns: int
    camera: str
    topic: Topic
    number: int


class McapPictures:
    """A `PictureRecording` of an MCAP file in the ROS 2 profile."""

    def __init__(self, path: Path) -> None:
        self.name = path.resolve().name if path.is_dir() else path.stem
        self.path = path
        self._file = find_file(path)
        self._topics = read_index(self._file)
        self._frame_of: dict[str, str] = {}
        self._places: list[_Place] = []
        self.cameras: Mapping[str, Camera] = {
            name.strip("/"): self._add_camera(name, topic)
            for name, topic in picture_topics(self._topics).items()
            if self._has_calibration(name)
        }
        if not self.cameras:
            raise InputError(f"{self._file}: holds no camera with pictures and camera_info")
        self._places.sort(key=lambda place: (place.timestamp_ns, place.camera))
        self._account = _Account(self._file, self._topics)

    def __len__(self) -> int:
        return len(self._places)

    def pictures(self) -> Iterator[SinglePicture | BadFrame]:
        """Return the pictures in order of time, a few chunks in memory."""
        with MessageFetcher(self._file) as messages:
            for index, place in enumerate(self._places):
                try:
                    yield self._read(messages, index, place)
                except PictureError as error:
                    yield BadFrame(index, place.timestamp_ns, str(error))

    def truth(self, frame: str) -> FramePoses | None:
        """Return the poses of /truth/<frame>, or of /truth/pose where those are of the frame."""
        topic = self._topics.get(frame_truth_topic(frame))
        main = self._topics.get(TRUTH_TOPIC)
        if topic is None and main is not None and main.metadata.get(BODY_KEY) == frame:
            topic = main
        if topic is None or not topic.times_ns:
            return None
        return mcap_motion.read_poses(self._file, topic)

    def _has_calibration(self, name: str) -> bool:
        info = self._topics.get(f"{name}/camera_info")
        return info is not None and bool(info.first)

    def _add_camera(self, name: str, topic: Topic) -> Camera:
        info = self._topics[f"{name}/camera_info"]
        section, frame = read_info(self._file, info.name, info.first[0])
        camera = name.strip("/")
        self._frame_of[camera] = frame
        places = enumerate(topic.times_ns)
        self._places += [_Place(time_ns, camera, topic, number) for number, time_ns in places]
        return camera_of(section)

    def _read(self, messages: MessageFetcher, index: int, place: _Place) -> SinglePicture:
        where = f"{self._file}: {place.topic.name} at {place.timestamp_ns} ns"
        try:
            data = messages.fetch(place.topic, place.number)
        except DamageError as error:
            raise PictureError(f"{where}: {error}") from None
        picture = decode_message(data, place.topic.type_name, where)
        check_size(picture, self.cameras[place.camera], where)
        account, now_ns = self._account, place.timestamp_ns
        frames, frame = account.frames(now_ns), self._frame_of[place.camera]
        robot_from_camera = (frames.between(robot, frame) for robot in ROBOT_FRAMES)
        odom_from_robot, is_moving = account.odometry(now_ns)
        return SinglePicture(
            index=index,
            timestamp_ns=now_ns,
            camera=place.camera,
            picture=picture,
            joints_rad=account.joints(now_ns),
            robot_from_camera=next((pose for pose in robot_from_camera if pose is not None), None),
            torso_from_camera=frames.between(TORSO, frame),
            odom_from_robot=odom_from_robot,
            is_moving=is_moving,
        )


class _Account:
    """What the robot said of itself, at any time of the recording."""

    def __init__(self, file: Path, topics: dict[str, Topic]) -> None:
        static, moving = topics.get(STATIC_TRANSFORMS_TOPIC), topics.get(TRANSFORMS_TOPIC)
        self._statics = read_frames(file, static.first if static else ())
        told = mcap_motion.read_transforms(file, moving) if moving else {}
        self._moving = {
            frames: (np.array([time_ns for time_ns, _ in said], np.int64), [t for _, t in said])
            for frames, said in told.items()
        }
        odometry = mcap_motion.find_topic(topics, ros.ODOMETRY, ODOMETRY_TOPIC, None, file)
        joints = mcap_motion.find_topic(topics, ros.JOINTS, JOINTS_TOPIC, None, file)
        self._odometry = mcap_motion.read_odometry(file, odometry) if odometry else None
        self._joints = mcap_motion.read_joints(file, joints) if joints else None

    def frames(self, time_ns: int) -> FrameTree:
        """Return how the frames sat on each other then, but for the robot's way."""
        tree = self._statics.copy()
        for (parent, child), (times_ns, transforms) in self._moving.items():
            index = nearest(times_ns, time_ns, within_ns=WITHIN_NS)
            if index is not None:
                tree.add(parent, child, transforms[index])
        return tree

    def odometry(self, time_ns: int) -> tuple[Transform | None, bool | None]:
        """Return odom_from_robot, and whether it believed to be moving."""
        told = self._odometry
        index = None if told is None else nearest(told.timestamps_ns, time_ns, within_ns=WITHIN_NS)
        if told is None or index is None:
            return None, None
        twist = np.abs(told.twists[index])
        is_moving = bool(twist[:3].max() > MOVING_M_S or twist[3:].max() > MOVING_RAD_S)
        return Transform.from_matrix(told.odom_from_robot[index]), is_moving

    def joints(self, time_ns: int) -> dict[str, float]:
        """Return the joints' angles, rad, by name."""
        told = self._joints
        index = None if told is None else nearest(told.timestamps_ns, time_ns, within_ns=WITHIN_NS)
        if told is None or index is None:
            return {}
        angles = zip(told.names, told.positions_rad[index].tolist(), strict=True)
        return {name: angle for name, angle in angles if not np.isnan(angle)}
