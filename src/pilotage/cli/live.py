# SPDX-License-Identifier: Apache-2.0
"""A simulated drive while it goes: a map and figures on a terminal, lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np

from pilotage.cli.braille import BLANK, BrailleMap, Points, arrow
from pilotage.cli.progress import SECONDS_BETWEEN_LINES

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

    from pilotage.behaviors.recorder import Moment

SECONDS_BETWEEN_VIEWS = 0.2
COLUMNS, ROWS = 40, 13
SPEED_OVER_NS = 1_000_000_000


class DriveView(Protocol):
    """Shows how a drive goes; used in a `with`."""

    def __enter__(self) -> Self:
        """Start showing."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop showing."""

    def on_moment(self, moment: Moment) -> None:
        """Show a new moment of the drive."""


def make_drive_view(name: str, planned: Points, length_m: float, shots: str) -> DriveView:
    """Return a map where stderr is a terminal, plain lines otherwise.

    `planned` is the path (N, 2) in the world, metres; `shots` what the counted things are called.
    """
    if not sys.stderr.isatty():
        return LineView(name, shots)
    from rich.console import Console

    return MapView(name, planned, length_m, shots, Console(stderr=True))


class LineView:
    """A line every few seconds."""

    def __init__(self, name: str, shots: str) -> None:
        self._name, self._shots = name, shots
        self._said = self._started = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def on_moment(self, moment: Moment) -> None:
        """Print a line when the last one is old enough."""
        now = time.monotonic()
        if now - self._said < SECONDS_BETWEEN_LINES:
            return
        self._said = now
        rate = moment.shots / max(now - self._started, 1e-9)
        print(
            f"{self._name}: {100 * moment.share_done:.0f} % of the way, {moment.shots} "
            f"{self._shots}, {rate:.1f} {self._shots}/s",
            file=sys.stderr,
            flush=True,
        )


class MapView:
    """A panel that is drawn anew a few times a second: the paths from above, and figures."""

    def __init__(
        self, name: str, planned: Points, length_m: float, shots: str, console: Console
    ) -> None:
        from rich.live import Live

        self._name, self._length_m, self._shots = name, length_m, shots
        self._map = BrailleMap(planned, columns=COLUMNS, rows=ROWS)
        self._planned = self._map.cells(planned)
        self._driven: list[tuple[int, float, float]] = []  # ns, metres
        self._live = Live(console=console, auto_refresh=False, transient=False)
        self._started = time.monotonic()
        self._drawn = -math.inf
        self._newest: Moment | None = None

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._newest is not None:
            self._live.update(self.view(self._newest), refresh=True)
        self._live.stop()

    def on_moment(self, moment: Moment) -> None:
        """Take the moment in, and draw it when the last drawing is old enough."""
        x_m, y_m, _ = moment.world_from_robot.translation_m.tolist()
        self._driven.append((moment.time_ns, x_m, y_m))
        self._newest = moment
        now = time.monotonic()
        if now - self._drawn >= SECONDS_BETWEEN_VIEWS:
            self._drawn = now
            self._live.update(self.view(moment), refresh=True)

    def view(self, moment: Moment) -> RenderableType:
        """Return the panel that shows a moment."""
        from rich.panel import Panel
        from rich.table import Table

        content = Table.grid(padding=(0, 2))
        content.add_row(self._drawn_map(moment), self._figures(moment))
        return Panel.fit(content, title=self._name, border_style="dim")

    def _drawn_map(self, moment: Moment) -> Text:
        from rich.text import Text

        driven = self._map.cells(np.array([entry[1:] for entry in self._driven]).reshape(-1, 2))
        pose = moment.world_from_robot.matrix()
        here = self._map.cell_of(pose[:2, 3])
        drawn = Text()
        for row in range(ROWS):
            for column in range(COLUMNS):
                dots, way = int(driven[row, column]), int(self._planned[row, column])
                if (row, column) == here:
                    drawn.append(arrow(math.atan2(pose[1, 0], pose[0, 0])), "bold yellow")
                elif dots:
                    drawn.append(chr(BLANK | dots | way), "bold green")
                else:
                    drawn.append(chr(BLANK | way) if way else " ", "bright_black")
            drawn.append("\n" if row < ROWS - 1 else "")
        return drawn

    def _figures(self, moment: Moment) -> Table:
        from rich.progress_bar import ProgressBar
        from rich.table import Table

        spent_s = max(time.monotonic() - self._started, 1e-9)
        simulated_s = moment.time_ns / 1e9
        figures = Table.grid(padding=(0, 1))
        figures.add_column(style="bright_black", justify="right")
        figures.add_column()
        done = min(1.0, moment.share_done)
        figures.add_row("way", f"{done * self._length_m:.1f} of {self._length_m:.1f} m")
        figures.add_row("", ProgressBar(1.0, done, 18, complete_style="green"))
        figures.add_row("speed", f"{self._speed_m_s():.2f} m/s")
        figures.add_row("simulated", f"{simulated_s:.1f} s")
        figures.add_row("spent", f"{spent_s:.0f} s")
        figures.add_row(self._shots, f"{moment.shots}")
        figures.add_row("", f"{moment.shots / spent_s:.1f} {self._shots}/s")
        figures.add_row("a dot is", f"{100 * self._map.metres_per_dot:.0f} cm")
        return figures

    def _speed_m_s(self) -> float:
        """Return the speed over the last second of the simulation's time."""
        newest = self._driven[-1]
        recent = [entry for entry in self._driven[-100:] if entry[0] >= newest[0] - SPEED_OVER_NS]
        if len(recent) < 2:
            return 0.0
        ways = np.diff(np.array([entry[1:] for entry in recent]), axis=0)
        return float(np.linalg.norm(ways, axis=1).sum() / (newest[0] - recent[0][0]) * 1e9)
