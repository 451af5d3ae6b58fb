# SPDX-License-Identifier: Apache-2.0
"""Calibrations of stereo rigs: read from the common styles, written in our own."""

from pilotage.calibration.files import find_calibration, load_rig, save_rig

__all__ = ["find_calibration", "load_rig", "save_rig"]
