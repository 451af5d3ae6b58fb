# SPDX-License-Identifier: Apache-2.0
"""The program called inside this process, which is faster where only the answer matters."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from pilotage.cli.main import app


def call(*arguments: object) -> Result:
    """Return how the program ended and what it said."""
    return CliRunner().invoke(app, list(map(str, arguments)))


def said(done: Result) -> str:
    """Return all it said in one line, wherever the terminal broke it."""
    return " ".join(done.output.split())


def summary_of(out: Path) -> dict[str, Any]:
    """Return the summary of a run's results folder."""
    return dict(json.loads((out / "summary.json").read_text()))
