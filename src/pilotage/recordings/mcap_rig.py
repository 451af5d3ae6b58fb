# SPDX-License-Identifier: Apache-2.0
"""The stereo rig of a ROS 2 recording: CameraInfo for each camera, /tf_static for their places."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pilotage import Camera, StereoRig, Transform
from pilotage.calibration.document import Section
from pilotage.calibration.rig import READOUT, check_size, make_camera, make_rig, read_lens
from pilotage.calibration.ros import read_ros, refuse_cropping
from pilotage.errors import InputError
from pilotage.recordings import ros_messages as ros

# What the robot's frame is called, ours first; its origin is on the ground.
ROBOT_FRAMES = ("robot", "base_footprint", "base_link")
IDENTITY_WXYZ = [1.0, 0.0, 0.0, 0.0]


class FrameTree:
    """Frames and how they sit on each other for good."""

    def __init__(self) -> None:
        self._neighbours: dict[str, dict[str, Transform]] = {}

    def add(self, parent: str, child: str, parent_from_child: Transform) -> None:
        """Put `child` where it sits on `parent`; said again, the last word counts."""
        self._neighbours.setdefault(child, {})[parent] = parent_from_child
        self._neighbours.setdefault(parent, {})[child] = parent_from_child.inverse()

    def copy(self) -> FrameTree:
        """Return the same frames, to add to."""
        tree = FrameTree()
        tree._neighbours = {frame: dict(near) for frame, near in self._neighbours.items()}
        return tree

    def between(self, b: str, a: str) -> Transform | None:
        """Return `b_from_a` along the shortest way, None where there is none."""
        reached: dict[str, Transform] = {a: Transform()}
        waiting = deque([a])
        while waiting and b not in reached:
            here = waiting.popleft()
            for there, there_from_here in self._neighbours.get(here, {}).items():
                if there not in reached:
                    reached[there] = compose(there_from_here, reached[here])
                    waiting.append(there)
        return reached.get(b)


def compose(c_from_b: Transform, b_from_a: Transform) -> Transform:
    """Return `c_from_a`, to the last bit where one of the two only turns or only moves.

    The product itself normalises anew, which costs the last digit.
    """
    if c_from_b.quaternion_wxyz.tolist() == IDENTITY_WXYZ:
        moved_m = (c_from_b.translation_m + b_from_a.translation_m).tolist()
        quaternion = b_from_a.quaternion_wxyz.tolist()
        return Transform(translation_m=moved_m, quaternion_wxyz=quaternion)
    if b_from_a.quaternion_wxyz.tolist() == IDENTITY_WXYZ:
        moved_m = (c_from_b @ b_from_a.translation_m).tolist()
        quaternion = c_from_b.quaternion_wxyz.tolist()
        return Transform(translation_m=moved_m, quaternion_wxyz=quaternion)
    return c_from_b @ b_from_a


def read_frames(path: Path, messages: Iterable[bytes]) -> FrameTree:
    """Return the frames of the TFMessages of /tf_static; InputError where one is none."""
    tree = FrameTree()
    for data in messages:
        try:
            for stamped in ros.read_message(data, ros.TRANSFORMS).transforms:
                turn = stamped.transform
                parent_from_child = ros.transform_of(turn.translation, turn.rotation)
                parent, child = stamped.header.frame_id, stamped.child_frame_id
                tree.add(parent.lstrip("/"), child.lstrip("/"), parent_from_child)
        except ros.MessageError as error:
            raise InputError(
                f"{path}: /tf_static: {error}; give a calibration (--calibration)"
            ) from None
    return tree


def read_rig(
    path: Path, infos: dict[str, bytes], frames: FrameTree, shutters: dict[str, str]
) -> tuple[StereoRig, str]:
    """Return the rig of the left and right CameraInfo, by topic, and the left camera's frame.

    `shutters` is what the topics say of a rolling shutter's readout, seconds; empty: nothing.
    Where /tf_static says nothing of both cameras' frames, R and P of the CameraInfos do.
    """
    (left, left_frame), (right, right_frame) = (
        read_info(path, topic, data) for topic, data in infos.items()
    )
    right_from_left = frames.between(right_frame, left_frame)
    if right_from_left is None or left_frame == right_frame:
        rig = read_ros(left, right)
        right_from_left = rig.right_from_left
    found = (frames.between(robot, left_frame) for robot in ROBOT_FRAMES)
    robot_from_left = next((transform for transform in found if transform is not None), None)
    rig = make_rig(
        path,
        camera_of(left),
        camera_of(right),
        right_from_left,
        robot_from_left,
        readout_s=_readout_s(path, shutters),
    )
    return rig, left_frame


def _readout_s(path: Path, shutters: dict[str, str]) -> float:
    """Return what two cameras' topics agree on; InputError where they do not."""
    said = sorted(set(shutters.values()))
    if len(said) > 1:
        raise InputError(
            f"{path}: {READOUT} of {', '.join(shutters)}: {said}; both cameras of a pair must have "
            "the same shutter; give a calibration (--calibration)"
        )
    try:
        return float(said[0] or 0.0)
    except ValueError:
        raise InputError(f"{path}: {READOUT} = {said[0]!r}: must be seconds") from None


def read_info(path: Path, topic: str, data: bytes) -> tuple[Section, str]:
    """Return a CameraInfo as a calibration file's section, and its frame."""
    try:
        info = ros.read_message(data, ros.CAMERA_INFO)
    except ros.MessageError as error:
        raise InputError(f"{path}: {topic}: {error}; give a calibration (--calibration)") from None
    return Section(path, topic, _values(info)), info.header.frame_id.lstrip("/") or topic


def _values(info: Any) -> dict[str, Any]:
    roi = {"x_offset": info.roi.x_offset, "y_offset": info.roi.y_offset}
    return {
        "width": info.width, "height": info.height, "distortion_model": info.distortion_model,
        "K": info.k.tolist(), "D": info.d.tolist(), "R": info.r.tolist(), "P": info.p.tolist(),
        "binning_x": info.binning_x, "binning_y": info.binning_y, "roi": roi,
    }  # fmt: skip


def camera_of(section: Section) -> Camera:
    """Return the camera of a CameraInfo; InputError where it is cropped or no sound one."""
    refuse_cropping(section)
    size_px = check_size(section, section.number("width"), section.number("height"))
    k = section.matrix("K", 3, 3)
    lens = read_lens(section, "distortion_model", "D")
    return make_camera(section, size_px, [k[0, 0], k[1, 1], k[0, 2], k[1, 2]], lens)
