# SPDX-License-Identifier: Apache-2.0
"""How a run goes, while it goes: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self

from pilotage.pose_files import PoseRecord
from pilotage.reasons import reason_words

if TYPE_CHECKING:
    from rich.console import RenderableType

SECONDS_BETWEEN_LINES = 5.0


class Progress(Protocol):
    """Shows pairs as they are done; used in a `with`."""

    def __enter__(self) -> Self:
        """Start showing."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop showing."""

    def on_pair(self, done: int, record: PoseRecord, words: str = "") -> None:
        """Show that `done` pairs are done, the last of them with `record`.

        `words` say more of its status where several stereo pairs are judged.
        """


def make_progress(name: str, pairs: int) -> Progress:
    """Return a bar where stderr is a terminal, plain lines otherwise."""
    return BarProgress(name, pairs) if sys.stderr.isatty() else LineProgress(name, pairs)


def status_words(record: PoseRecord, words: str = "") -> str:
    """Return the status, with the reason where there is one; `words` say it better."""
    if words:
        return f"{record.status}, {words}" if record.status != "lost" else words
    if record.reason == "none":
        return record.status
    return f"{record.status}: {reason_words(record.reason)}"


class LineProgress:
    """A line every few seconds."""

    def __init__(self, name: str, pairs: int) -> None:
        self._name, self._pairs = name, pairs
        self._started = self._said = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def on_pair(self, done: int, record: PoseRecord, words: str = "") -> None:
        """Print a line when the last one is old enough or the run is through."""
        now = time.monotonic()
        if now - self._said < SECONDS_BETWEEN_LINES and done < self._pairs:
            return
        self._said = now
        rate = done / max(now - self._started, 1e-9)
        status = status_words(record, words)
        print(
            f"{self._name}: {done}/{self._pairs} pairs, {rate:.1f} pairs/s, {status},"
            f" {record.inliers} inliers",
            file=sys.stderr,
            flush=True,
        )


class BarProgress:
    """A bar that is redrawn a few times a second, whatever the rate of pairs.

    Where several stereo pairs are judged, what is said of them stands on a line below.
    """

    def __init__(self, name: str, pairs: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as PlainBar
        from rich.text import Text

        self._words = Text(overflow="fold")
        said = self._words

        class Bar(PlainBar):
            def get_renderables(self) -> Iterable[RenderableType]:
                yield from super().get_renderables()
                if said.plain:
                    yield said

        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]:.1f} pairs/s"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[status]}, {task.fields[inliers]} inliers"),
            console=Console(stderr=True),
            refresh_per_second=4,
        )
        self._task = self._bar.add_task(name, total=pairs, rate=0.0, status="starting", inliers=0)
        self._started = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()

    def on_pair(self, done: int, record: PoseRecord, words: str = "") -> None:
        """Tell the bar; it redraws by its own clock."""
        if words:
            self._words.plain = words
            self._words.style = "bold red" if record.status in {"lost", "skipped"} else ""
        self._bar.update(
            self._task,
            completed=done,
            rate=done / max(time.monotonic() - self._started, 1e-9),
            status=record.status if words else status_words(record),
            inliers=record.inliers,
        )
