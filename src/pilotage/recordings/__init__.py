# SPDX-License-Identifier: Apache-2.0
"""Recordings: of stereo pairs and of single pictures, a protocol each; one file a format."""

from pilotage.recordings.motion import (
    FramePoses,
    JointAngles,
    OdometryPoses,
    read_joints,
    read_odometry,
)
from pilotage.recordings.recording import (
    BadFrame,
    Recording,
    StereoFrame,
    Truth,
    open_recording,
)
from pilotage.recordings.single import PictureRecording, SinglePicture, open_pictures

__all__ = [
    "BadFrame",
    "FramePoses",
    "JointAngles",
    "OdometryPoses",
    "PictureRecording",
    "Recording",
    "SinglePicture",
    "StereoFrame",
    "Truth",
    "open_pictures",
    "open_recording",
    "read_joints",
    "read_odometry",
]
