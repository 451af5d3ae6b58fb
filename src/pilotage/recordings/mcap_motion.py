# SPDX-License-Identifier: Apache-2.0
"""Poses, odometry, joints and moving frames of an MCAP file, as arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pilotage import Transform
from pilotage.errors import InputError
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap_index import MessageFetcher, Topic
from pilotage.recordings.mcap_records import DamageError
from pilotage.recordings.motion import FramePoses, JointAngles, OdometryPoses

Value = TypeVar("Value")


def find_topic(
    topics: Mapping[str, Topic], type_name: str, usual: str, wanted: str | None, file: Path
) -> Topic | None:
    """Return the topic of that type called `wanted`, else as `usual`, else the only one.

    None where there is none; InputError where the wanted one is not there, or it is not clear
    which of several is meant.
    """
    found = {t.name: t for t in topics.values() if t.type_name == type_name and t.times_ns}
    name = wanted or (usual if usual in found else None)
    if name is None and len(found) <= 1:
        return next(iter(found.values()), None)
    if name not in found:
        there = ", ".join(sorted(found)) or "none"
        meant = f"no {type_name} on {name}" if name else f"several topics of {type_name}"
        raise InputError(f"{file}: holds {meant}; name a topic, there are: {there}")
    return found[name]


def read_poses(file: Path, topic: Topic) -> FramePoses:
    """Return the poses of a topic of PoseStamped; InputError where one is none."""
    poses = np.empty((len(topic.times_ns), 4, 4))
    for number, pose in enumerate(_read(file, topic, _pose_of_stamped)):
        poses[number] = pose.matrix()
    return FramePoses(_rising_times(file, topic), poses)


def read_odometry(file: Path, topic: Topic) -> OdometryPoses:
    """Return all of a topic of Odometry; InputError where one is none."""
    count = len(topic.times_ns)
    poses, covariances, twists = np.empty((count, 4, 4)), np.empty((count, 6, 6)), []
    for number, message in enumerate(_read(file, topic, _odometry)):
        pose, covariance, twist = message
        poses[number], covariances[number] = pose.matrix(), covariance
        twists.append(twist)
    times_ns = _rising_times(file, topic)
    return OdometryPoses(times_ns, poses, covariances, np.array(twists).reshape(count, 6))


def read_joints(file: Path, topic: Topic) -> JointAngles:
    """Return all of a topic of JointState; InputError where one is none."""
    states = list(_read(file, topic, _joints))
    names = tuple(dict.fromkeys(name for state in states for name in state))
    angles = [[state.get(name, np.nan) for name in names] for state in states]
    times_ns = _rising_times(file, topic)
    return JointAngles(times_ns, names, np.array(angles).reshape(len(states), len(names)))


def read_transforms(file: Path, topic: Topic) -> dict[tuple[str, str], list[tuple[int, Transform]]]:
    """Return time (ns) and parent_from_child of all transforms of a topic, by (parent, child)."""
    moving: dict[tuple[str, str], list[tuple[int, Transform]]] = {}
    for transforms in _read(file, topic, _transforms):
        for frames, time_ns, transform in transforms:
            moving.setdefault(frames, []).append((time_ns, transform))
    return {frames: sorted(told, key=lambda entry: entry[0]) for frames, told in moving.items()}


def _read(file: Path, topic: Topic, parse: Callable[[Any], Value]) -> list[Value]:
    """Return what `parse` makes of each message; InputError names file and topic."""
    try:
        with MessageFetcher(file) as messages:
            return [
                parse(ros.read_message(data, topic.type_name))
                for _, data in messages.fetch_all(topic)
            ]
    except (ros.MessageError, DamageError, OSError) as error:
        raise InputError(f"{file}: {topic.name}: {error}; record it again") from None


def _rising_times(file: Path, topic: Topic) -> Any:
    """Return the times (N,) int64; InputError where one does not rise."""
    for earlier, later in pairwise(topic.times_ns):
        if later <= earlier:
            raise InputError(
                f"{file}: {topic.name}: time {later} ns does not come after {earlier} "
                "ns; remove the topic or sort its messages"
            )
    return np.array(topic.times_ns, np.int64)


def _pose_of_stamped(message: Any) -> Transform:
    return ros.transform_of(message.pose.position, message.pose.orientation)


def _odometry(message: Any) -> tuple[Transform, Any, list[float]]:
    pose = message.pose.pose
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    twist = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
    covariance = np.asarray(message.pose.covariance, np.float64).reshape(6, 6)
    return ros.transform_of(pose.position, pose.orientation), covariance, twist


def _joints(message: Any) -> dict[str, float]:
    names, angles = list(message.name), message.position.tolist()
    if len(angles) != len(names):
        raise ros.MessageError(f"{len(names)} joints and {len(angles)} positions")
    return dict(zip(names, angles, strict=True))


def _transforms(message: Any) -> list[tuple[tuple[str, str], int, Transform]]:
    told = []
    for stamped in message.transforms:
        stamp = stamped.header.stamp
        frames = stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/")
        transform = ros.transform_of(stamped.transform.translation, stamped.transform.rotation)
        told.append((frames, stamp.sec * ros.NS_PER_S + stamp.nanosec, transform))
    return told
