# SPDX-License-Identifier: Apache-2.0
"""The errors a user sees. Each message names the file, the value and the remedy."""

from __future__ import annotations


class PilotageError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(PilotageError):
    """A wrong call, file or calibration; the command line exits with 2."""


class RunError(PilotageError):
    """A fault during the run, such as a full disk; the command line exits with 1."""


class DeviceError(PilotageError):
    """A robot or camera that is closed, gone or silent; the command line exits with 1."""
