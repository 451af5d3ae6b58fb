# SPDX-License-Identifier: Apache-2.0
"""Stereo recordings: one protocol, one file a format."""

from pilotage.recordings.recording import (
    BadFrame,
    Recording,
    StereoFrame,
    Truth,
    open_recording,
)

__all__ = ["BadFrame", "Recording", "StereoFrame", "Truth", "open_recording"]
