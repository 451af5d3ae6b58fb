# SPDX-License-Identifier: Apache-2.0
"""Pilotage's own recordings, written: MCAP in the ROS 2 profile (docs/recordings.md)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple, Self

import cv2
import numpy as np
from mcap.records import Channel, Message, Metadata
from numpy.typing import NDArray

from pilotage import Camera, StereoRig, Transform, __version__
from pilotage.atomic_files import GrowingFile, write_error
from pilotage.calibration.rig import READOUT
from pilotage.errors import InputError, RunError
from pilotage.recordings import ros_messages as ros
from pilotage.recordings.mcap_container import ContainerWriter
from pilotage.recordings.mcap_stereo import rectification, stereo_transforms

Pictures = Literal["auto", "png", "raw"]

PART_SUFFIX = ".part"
LEFT, RIGHT, ROBOT, WORLD = "front_left", "front_right", "robot", "world"
STATIC_TRANSFORMS_TOPIC, TRANSFORMS_TOPIC = "/tf_static", "/tf"
ODOMETRY_TOPIC, TRUTH_TOPIC, JOINTS_TOPIC = "/odom", "/truth/pose", "/joint_states"
BODY_KEY = "child_frame_id"  # of the truth's channel: whose poses these are
# Decoding costs time with every replay: PNG only where it saves this share of the picture.
WORTH_PNG = 0.8
PNG_LEVEL = [cv2.IMWRITE_PNG_COMPRESSION, 1]
# Static transforms are said once and must reach who listens later.
LATCHED = (
    "- history: keep_last\n  depth: 1\n  reliability: reliable\n  durability: transient_local\n"
    "  deadline: {sec: 9223372036, nsec: 854775807}\n"
    "  lifespan: {sec: 9223372036, nsec: 854775807}\n  liveliness: automatic\n"
    "  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}\n"
    "  avoid_ros_namespace_conventions: false\n"
)


class _Known(NamedTuple):
    """A camera as CameraInfo has it: its lens, R (3, 3) and P (3, 4); and its shutter."""

    camera: Camera
    turn: NDArray[np.float64]
    projection: NDArray[np.float64]
    readout_s: float = 0.0


class McapWriter:
    """A recording being written. `with` opens `<path>.part`; leaving without an error names it.

    After an error, a kill or a full disk the `.part` stays: `pilotage recover` makes it whole.
    Entering raises InputError where either exists, every write RunError naming the file.
    `pictures` is lossless in any case: "auto" takes PNG for the cameras where that pays.
    """

    def __init__(self, path: Path, *, pictures: Pictures = "auto") -> None:
        self.path = path
        self.part = path.with_name(path.name + PART_SUFFIX)
        self._file = GrowingFile(self.part, exclusive=True)
        self._container = ContainerWriter(self._file, library=f"pilotage {__version__}")
        self._pictures = pictures
        self._uses_png: dict[str, bool] = {}
        self._channels: dict[str, Channel] = {}
        self._schema_ids: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        self._statics: dict[tuple[str, str], Transform] = {}
        self._cameras: dict[str, _Known] = {}
        self.is_ours = False  # whether the `.part` was begun here

    def __enter__(self) -> Self:
        check_mcap_name(self.path)
        for file in (self.path, self.part):
            if file.exists():
                others = "remove it or run `pilotage recover` on it"
                remedy = f", {others}" if file == self.part else " or remove it"
                raise InputError(f"{file} exists; choose another name{remedy}")
        self._file.open()
        self.is_ours = True
        try:
            self._container.start()
        except BaseException:  # nothing in it that is worth keeping
            self._file.close()
            with contextlib.suppress(OSError):
                self.part.unlink()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                self._container.finish()
                self._file.sync()
            else:
                with contextlib.suppress(RunError):
                    self._container.flush()
        finally:
            self._file.close()
        if error is None:
            try:
                self.part.rename(self.path)
            except OSError as fault:
                raise write_error(self.path, fault) from fault

    def write_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Say something of the whole recording: with what it was simulated."""
        self._container.add_metadata(Metadata(name=name, metadata=dict(values)))

    def add_rig(
        self, rig: StereoRig, *, timestamp_ns: int, left: str = LEFT, right: str = RIGHT
    ) -> None:
        """Say how a stereo pair is built; its two cameras' pictures may follow."""
        for name, camera, (turn, projection) in zip(
            (left, right), (rig.left, rig.right), rectification(rig), strict=True
        ):
            self._cameras[name] = _Known(camera, turn, projection, rig.readout_s)
        statics = stereo_transforms(rig.right_from_left, left, right)
        if rig.robot_from_left is not None:
            statics = {(ROBOT, left): rig.robot_from_left, **statics}
        self.add_static_transforms(statics, timestamp_ns=timestamp_ns)

    def add_camera(self, name: str, camera: Camera) -> None:
        """Say how a single camera is built, say `top` of a humanoid; its pictures may follow."""
        k = [[camera.fx_px, 0, camera.cx_px, 0], [0, camera.fy_px, camera.cy_px, 0], [0, 0, 1, 0]]
        self._cameras[name] = _Known(camera, np.eye(3), np.array(k))

    def add_static_transforms(
        self, parent_from_child: Mapping[tuple[str, str], Transform], *, timestamp_ns: int
    ) -> None:
        """Say how frames sit on each other for good, by (parent, child)."""
        self._statics |= parent_from_child
        # All of them each time: who listens late gets the last message alone.
        data = ros.transforms(timestamp_ns, self._statics)
        quality = {"offered_qos_profiles": LATCHED}
        self._write(STATIC_TRANSFORMS_TOPIC, ros.TRANSFORMS, timestamp_ns, data, **quality)

    def write_pair(
        self,
        *,
        timestamp_ns: int,
        left: NDArray[np.uint8],
        right: NDArray[np.uint8],
        cameras: tuple[str, str] = (LEFT, RIGHT),
    ) -> None:
        """Write the grey pictures that the two cameras of a rig took at once."""
        for name, picture in zip(cameras, (left, right), strict=True):
            self.write_picture(name, timestamp_ns=timestamp_ns, picture=picture)

    def write_picture(
        self,
        camera: str,
        *,
        timestamp_ns: int,
        picture: NDArray[np.uint8],
        encoding: Literal["mono8", "rgb8", "bgr8"] | None = None,
    ) -> None:
        """Write a picture, (height, width) mono8 or (height, width, 3) rgb8 or bgr8, and the
        calibration of its camera; ValueError where the picture does not fit either.
        """
        encoding = encoding or "mono8"
        wanted: tuple[int, ...] = () if encoding == "mono8" else (3,)
        if picture.dtype != np.uint8 or picture.shape[2:] != wanted or picture.size == 0:
            raise ValueError(f"a picture {picture.shape} of {picture.dtype} is no {encoding}")
        if camera not in self._cameras:
            raise ValueError(f"camera {camera!r} is not known; add_rig or add_camera comes first")
        known = self._cameras[camera]
        width_px, height_px = known.camera.width_px, known.camera.height_px
        if picture.shape[:2] != (height_px, width_px):
            raise ValueError(
                f"a picture {picture.shape[1]}x{picture.shape[0]} px of {camera}, calibrated for "
                f"{width_px}x{height_px}"
            )
        info = ros.camera_info(camera, timestamp_ns, known.camera, known.turn, known.projection)
        # CameraInfo has no field for it.
        shutter = {READOUT: repr(known.readout_s)} if known.readout_s else {}
        self._write(f"/{camera}/camera_info", ros.CAMERA_INFO, timestamp_ns, info, **shutter)
        self._write_pixels(camera, timestamp_ns, picture, encoding)

    def write_transforms(
        self, parent_from_child: Mapping[tuple[str, str], Transform], *, timestamp_ns: int
    ) -> None:
        """Write how frames sit on each other at a moment, by (parent, child)."""
        data = ros.transforms(timestamp_ns, parent_from_child)
        self._write(TRANSFORMS_TOPIC, ros.TRANSFORMS, timestamp_ns, data)

    def write_odometry(
        self,
        *,
        timestamp_ns: int,
        odom_from_robot: Transform,
        covariance: NDArray[np.float64] | None = None,
        twist: Sequence[float] = (0.0,) * 6,
    ) -> None:
        """Write the robot's own odometry: pose, (6, 6) covariance of x y z rx ry rz (m, rad), and
        twist in the robot's axes (m/s, rad/s).
        """
        given = np.zeros((6, 6)) if covariance is None else covariance
        data = ros.odometry(("odom", ROBOT), timestamp_ns, odom_from_robot, given, twist)
        self._write(ODOMETRY_TOPIC, ros.ODOMETRY, timestamp_ns, data)

    def write_truth(
        self, *, timestamp_ns: int, world_from_body: Transform, body: str = ROBOT
    ) -> None:
        """Write a true pose of `body`, one frame throughout: the robot or the left camera."""
        known = self._channels.get(TRUTH_TOPIC)
        if known is not None and known.metadata[BODY_KEY] != body:
            raise ValueError(f"truth of {body!r} after truth of {known.metadata[BODY_KEY]!r}")
        data = ros.pose(WORLD, timestamp_ns, world_from_body)
        self._write(TRUTH_TOPIC, ros.POSE, timestamp_ns, data, **{BODY_KEY: body})

    def write_frame_truth(
        self, frame: str, *, timestamp_ns: int, world_from_frame: Transform
    ) -> None:
        """Write a true pose of a further frame, say a camera on a head, on /truth/<frame>."""
        data = ros.pose(WORLD, timestamp_ns, world_from_frame)
        self._write(frame_truth_topic(frame), ros.POSE, timestamp_ns, data, **{BODY_KEY: frame})

    def write_joints(self, *, timestamp_ns: int, positions_rad: Mapping[str, float]) -> None:
        """Write joint angles by name, say of a humanoid's head."""
        data = ros.joints(timestamp_ns, positions_rad)
        self._write(JOINTS_TOPIC, ros.JOINTS, timestamp_ns, data)

    def flush(self) -> None:
        """Hand all there is to the system, before a pause say: a kill loses nothing of it then."""
        self._container.flush()

    def _write_pixels(
        self, camera: str, timestamp_ns: int, picture: NDArray[np.uint8], encoding: str
    ) -> None:
        topic = f"/{camera}/image_raw"
        if self._uses_png.get(camera, self._pictures != "raw"):
            # PNG holds its colours in one order, and OpenCV takes them as BGR.
            ordered = picture[..., ::-1] if encoding == "rgb8" else picture
            png = cv2.imencode(".png", np.ascontiguousarray(ordered), PNG_LEVEL)[1].reshape(-1)
            pays = self._pictures == "png" or png.size < WORTH_PNG * picture.size
            if self._uses_png.setdefault(camera, pays):
                # As image_transport names it.
                name = f"{encoding}; png compressed {'' if encoding == 'mono8' else 'bgr8'}"
                data = ros.compressed_image(camera, timestamp_ns, name, np.asarray(png, np.uint8))
                self._write(f"{topic}/compressed", ros.COMPRESSED_IMAGE, timestamp_ns, data)
                return
        self._uses_png.setdefault(camera, False)
        data = ros.image(camera, timestamp_ns, encoding, picture)
        self._write(topic, ros.IMAGE, timestamp_ns, data)

    def _write(
        self, topic: str, type_name: str, timestamp_ns: int, data: bytes, **metadata: str
    ) -> None:
        channel = self._channels.get(topic) or self._new_channel(topic, type_name, metadata)
        number = self._sequences.get(topic, 0)
        self._sequences[topic] = number + 1
        time_ns = ros.check_time(timestamp_ns)
        self._container.add_message(
            Message(
                channel_id=channel.id, sequence=number & 0xFFFFFFFF, log_time=time_ns,
                publish_time=time_ns, data=data,
            )
        )  # fmt: skip

    def _new_channel(self, topic: str, type_name: str, metadata: dict[str, str]) -> Channel:
        if type_name not in self._schema_ids:
            self._schema_ids[type_name] = len(self._schema_ids) + 1
            self._container.add_schema(ros.schema(self._schema_ids[type_name], type_name))
        channel = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding="cdr",
            schema_id=self._schema_ids[type_name],
            metadata={"topic_type_hash": ros.type_hash(type_name), **metadata},
        )  # fmt: skip
        self._channels[topic] = channel
        self._container.add_channel(channel)
        return channel


def frame_truth_topic(frame: str) -> str:
    """Return the topic with the true poses of a frame other than that of /truth/pose."""
    return f"/truth/{frame}"


def check_mcap_name(path: Path) -> None:
    """Raise InputError unless the name is one by which a recording is recognised."""
    if path.suffix != ".mcap":
        raise InputError(f"{path}: a recording's name must end in .mcap; rename it")
