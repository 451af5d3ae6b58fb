# SPDX-License-Identifier: Apache-2.0
"""Recordings of single pictures: one protocol, what a picture brings along, `open_pictures`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pilotage import Camera, Transform
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame, Grey
from pilotage.recordings.motion import FramePoses, find_mcap

__all__ = ["PictureRecording", "SinglePicture", "open_pictures"]


@dataclass(frozen=True)
class SinglePicture:
    """What one camera saw, (height, width) uint8, and what the robot said of itself then.

    `robot_from_camera` and `torso_from_camera` follow from the robot's joints, None where the
    recording does not tell; so are `odom_from_robot` and `is_moving`, which are the robot's own
    belief. `joints_rad` are the joints it told of, `HeadYaw` and `HeadPitch` of a Nao's head.
    """

    index: int
    timestamp_ns: int
    camera: str
    picture: Grey
    joints_rad: Mapping[str, float]
    robot_from_camera: Transform | None
    torso_from_camera: Transform | None
    odom_from_robot: Transform | None
    is_moving: bool | None


class PictureRecording(Protocol):
    """Pictures of one camera or several, which need not see the same, with times."""

    name: str
    path: Path
    cameras: Mapping[str, Camera]  # by name: `top`, `bottom`

    def __len__(self) -> int:
        """Return the number of pictures of all cameras, bad ones included."""

    def pictures(self) -> Iterator[SinglePicture | BadFrame]:
        """Return the pictures in order of time; each call starts anew."""

    def truth(self, frame: str) -> FramePoses | None:
        """Return the true poses of `robot`, `torso` or a camera in the world.

        None where the recording does not hold them; InputError where they are broken.
        """


def open_pictures(path: str | Path) -> PictureRecording:
    """Open a recording of single pictures: an MCAP file, or a folder with one.

    InputError names the file and the remedy, also where no camera is calibrated.
    """
    from pilotage.recordings.mcap_single import McapPictures

    if find_mcap(path) is None:
        raise InputError(f"{path}: holds no pictures with calibration and joints (.mcap)")
    return McapPictures(Path(path))
