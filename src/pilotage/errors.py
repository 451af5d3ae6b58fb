# SPDX-License-Identifier: Apache-2.0
"""The errors a user sees. Each message names the file, the value and the remedy."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class PilotageError(Exception):
    """Base of every error this package raises on purpose."""


class InputError(PilotageError):
    """A wrong call, file or calibration; the command line exits with 2."""


class RunError(PilotageError):
    """A fault during the run, such as a full disk; the command line exits with 1."""


class DeviceError(PilotageError):
    """A robot or camera that is closed, gone or silent; the command line exits with 1."""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return which of `known` a misspelt name most likely means; None where none is near."""
    return next(iter(get_close_matches(name, list(known), 1)), None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the end of a message about a misspelt name; empty where no known one is near."""
    near = nearest(name, known)
    return f"; did you mean {near}?" if near else ""
