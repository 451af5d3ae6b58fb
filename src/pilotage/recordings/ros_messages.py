# SPDX-License-Identifier: Apache-2.0
"""ROS 2 messages as bytes (CDR) and back, by the message definitions of rosbags."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray

from pilotage import Camera, Transform
from pilotage.errors import InputError

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
JOINTS = "sensor_msgs/msg/JointState"

NS_PER_S = 1_000_000_000
LATEST_NS = 2**31 * NS_PER_S  # a stamp's seconds are an int32: until 2038
ROUNDED = 1e-6  # a quaternion further off was printed with few digits, and is normalised
LARGEST_M = 1e12  # beyond any way; guards later arithmetic
HEADER_BYTES = 12  # encapsulation, seconds, nanoseconds
LENSES = {"none": "plumb_bob", "brown": "plumb_bob", "kannala_brandt": "equidistant"}


class MessageError(Exception):
    """Why bytes are no message of their type."""


@cache
def typestore() -> Any:
    """Return the message types of ROS 2 Jazzy, supported until 2029."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def schema(schema_id: int, type_name: str) -> Schema:
    """Return the definition of a message type and all it is made of, so that any tool reads it."""
    text, _ = typestore().generate_msgdef(type_name, ros_version=2)
    return Schema(id=schema_id, name=type_name, encoding="ros2msg", data=text.encode())


def type_hash(type_name: str) -> str:
    """Return the hash by which ROS 2 tells versions of a type apart."""
    return str(typestore().hash_rihs01(type_name))


def check_time(timestamp_ns: int) -> int:
    """Return a time that a stamp can hold; InputError otherwise."""
    if not 0 <= timestamp_ns < LATEST_NS:
        raise InputError(
            f"time {timestamp_ns} ns: ROS stamps reach from 0 to {LATEST_NS} ns (the year 2038); "
            "give the pictures other times (--rate-hz)"
        )
    return int(timestamp_ns)


def image(frame: str, timestamp_ns: int, encoding: str, picture: NDArray[np.uint8]) -> bytes:
    """Return an Image of a (height, width) or (height, width, 3) picture."""
    height, width = picture.shape[:2]
    return _to_cdr(
        _new(
            IMAGE, header=_header(frame, timestamp_ns), height=height, width=width,
            encoding=encoding, is_bigendian=0, step=width * picture[0, 0].size,
            data=np.ascontiguousarray(picture).reshape(-1),
        )
    )  # fmt: skip


def compressed_image(frame: str, timestamp_ns: int, format_: str, data: NDArray[np.uint8]) -> bytes:
    """Return a CompressedImage of a picture file's bytes."""
    header = _header(frame, timestamp_ns)
    return _to_cdr(_new(COMPRESSED_IMAGE, header=header, format=format_, data=data))


def camera_info(
    frame: str,
    timestamp_ns: int,
    camera: Camera,
    rectification: NDArray[np.float64],
    projection: NDArray[np.float64],
) -> bytes:
    """Return a CameraInfo; `rectification` (3, 3) turns the camera into the ideal one, which
    `projection` (3, 4) describes, pixels.
    """
    coefficients = list(camera.coefficients) or [0.0] * 5
    if camera.distortion == "brown":
        coefficients += [0.0] * (5 - len(coefficients))
    matrix = [camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1]
    region = _new(
        "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0,
        do_rectify=False,
    )  # fmt: skip
    return _to_cdr(
        _new(
            CAMERA_INFO, header=_header(frame, timestamp_ns), height=camera.height_px,
            width=camera.width_px, distortion_model=LENSES[camera.distortion],
            d=_floats(coefficients), k=_floats(matrix), r=_floats(rectification.ravel()),
            p=_floats(projection.ravel()), binning_x=0, binning_y=0, roi=region,
        )
    )  # fmt: skip


def transforms(timestamp_ns: int, parent_from_child: Mapping[tuple[str, str], Transform]) -> bytes:
    """Return a TFMessage of transforms by (parent, child)."""
    stamped = [
        _new(
            "geometry_msgs/msg/TransformStamped",
            header=_header(parent, timestamp_ns),
            child_frame_id=child,
            transform=_new(
                "geometry_msgs/msg/Transform",
                translation=_vector(transform.translation_m),
                rotation=_quaternion(transform),
            ),
        )
        for (parent, child), transform in parent_from_child.items()
    ]
    return _to_cdr(_new(TRANSFORMS, transforms=stamped))


def pose(frame: str, timestamp_ns: int, frame_from_body: Transform) -> bytes:
    """Return a PoseStamped."""
    return _to_cdr(_new(POSE, header=_header(frame, timestamp_ns), pose=_pose(frame_from_body)))


def odometry(
    frames: tuple[str, str],
    timestamp_ns: int,
    frame_from_body: Transform,
    covariance: NDArray[np.float64],
    twist: Sequence[float],
) -> bytes:
    """Return an Odometry: `frames` name the fixed one and the body, `covariance` (6, 6) is of
    x y z rx ry rz, `twist` (6,) in the body's axes, m/s and rad/s.
    """
    linear, angular = _vector(twist[:3]), _vector(twist[3:])
    moving = _new("geometry_msgs/msg/Twist", linear=linear, angular=angular)
    return _to_cdr(
        _new(
            ODOMETRY,
            header=_header(frames[0], timestamp_ns),
            child_frame_id=frames[1],
            pose=_new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=_pose(frame_from_body),
                covariance=_floats(covariance.ravel()),
            ),
            twist=_new(
                "geometry_msgs/msg/TwistWithCovariance", twist=moving, covariance=_floats([0] * 36)
            ),
        )
    )


def joints(timestamp_ns: int, positions_rad: Mapping[str, float]) -> bytes:
    """Return a JointState of named angles."""
    none = _floats([])
    return _to_cdr(
        _new(
            JOINTS, header=_header("", timestamp_ns), name=list(positions_rad),
            position=_floats(positions_rad.values()), velocity=none, effort=none,
        )
    )  # fmt: skip


def read_message(data: bytes, type_name: str) -> Any:
    """Return a message; MessageError where the bytes are none of that type."""
    from rosbags.serde import SerdeError

    try:
        return typestore().deserialize_cdr(data, type_name)
    except (SerdeError, ValueError, IndexError, AssertionError, MemoryError, struct.error) as error:
        raise MessageError(f"no {type_name}: {str(error)[:80]}") from None


def read_stamp_ns(data: bytes) -> int:
    """Return the header's stamp of any message that begins with one; MessageError without."""
    if len(data) < HEADER_BYTES or data[:2] not in (b"\0\0", b"\0\1"):
        raise MessageError("no message with a header")
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] else ">iI", data, 4)
    return int(seconds) * NS_PER_S + int(nanoseconds)


def transform_of(translation: Any, rotation: Any) -> Transform:
    """Return the transform of a message's vector and quaternion; MessageError where it is none."""
    vector = [translation.x, translation.y, translation.z]
    quaternion = [rotation.w, rotation.x, rotation.y, rotation.z]
    length = math.hypot(*quaternion)
    if not all(abs(value) < LARGEST_M for value in vector) or not abs(length - 1) < 1e-2:
        raise MessageError(f"translation {vector}, quaternion of length {length:.4g}: no transform")
    if abs(length - 1) > ROUNDED:
        quaternion = [value / length for value in quaternion]
    return Transform(translation_m=vector, quaternion_wxyz=quaternion)


def _new(type_name: str, **fields: Any) -> Any:
    return typestore().types[type_name](**fields)


def _to_cdr(message: Any) -> bytes:
    return bytes(typestore().serialize_cdr(message, message.__msgtype__, little_endian=True))


def _header(frame: str, timestamp_ns: int) -> Any:
    seconds, nanoseconds = divmod(check_time(timestamp_ns), NS_PER_S)
    stamp = _new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return _new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def _floats(values: Any) -> NDArray[np.float64]:
    return np.array(list(values), np.float64)


def _vector(values: Any) -> Any:
    x, y, z = map(float, values)
    return _new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _quaternion(transform: Transform) -> Any:
    w, x, y, z = map(float, transform.quaternion_wxyz)
    return _new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _pose(frame_from_body: Transform) -> Any:
    x, y, z = map(float, frame_from_body.translation_m)
    point = _new("geometry_msgs/msg/Point", x=x, y=y, z=z)
    return _new("geometry_msgs/msg/Pose", position=point, orientation=_quaternion(frame_from_body))
