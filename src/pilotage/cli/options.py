# SPDX-License-Identifier: Apache-2.0
"""Options of every verb that opens a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Calibration = Annotated[
    Path | None,
    typer.Option(help="Calibration YAML, instead of the recording's own.", show_default=False),
]
RateHz = Annotated[
    float | None,
    typer.Option(help="Pairs a second, where the recording has no times.", show_default=False),
]
Pair = Annotated[
    str | None,
    typer.Option(help="Stereo pair of a recording with several: front, down.", show_default=False),
]
