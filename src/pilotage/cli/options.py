# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs have."""

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
FovDeg = Annotated[
    float | None,
    typer.Option(
        help="Horizontal field of view of a camera without calibration.", show_default=False
    ),
]
Config = Annotated[
    Path | None,
    typer.Option(help="Configuration YAML: what differs from the defaults.", show_default=False),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one setting; may be repeated."),
]
Report = Annotated[bool, typer.Option(help="Draw report.html.")]
Overwrite = Annotated[bool, typer.Option(help="Replace earlier results in that folder.")]
Debug = Annotated[bool, typer.Option(help="Show where an error came from.")]
