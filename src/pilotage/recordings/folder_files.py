# SPDX-License-Identifier: Apache-2.0
"""What the folder formats share when they are written: pictures, numbers, poses."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pilotage import Transform
from pilotage.errors import InputError, RunError
from pilotage.recordings.frames import Grey


def write_png(file: Path, picture: Grey) -> None:
    """Write a grey picture without loss."""
    is_packed, data = cv2.imencode(".png", picture)
    if not is_packed:
        raise RunError(f"{file}: this OpenCV cannot write PNG")
    file.write_bytes(data.tobytes())


def words(values: NDArray[np.float64]) -> list[str]:
    """Return numbers with every digit they need to come back the same."""
    return [repr(float(value)) for value in values.ravel()]


def seconds(timestamp_ns: int) -> str:
    """Return a time in seconds with all nine places."""
    return f"{Decimal(int(timestamp_ns)).scaleb(-9):.9f}"


def transform_of_pose(world_from_body: NDArray[np.float64], timestamp_ns: int) -> Transform:
    """Return a pose of the truth, (4, 4), as translation and quaternion."""
    try:
        return Transform.from_matrix(world_from_body)
    except ValueError as error:
        raise InputError(f"the truth at {timestamp_ns} ns is no pose ({error}); mend it") from None
