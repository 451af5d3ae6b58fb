# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs tracked side by side: an odometry for each in a thread of its own.

Both tracking and decoding leave Python's lock free. What comes out is merged by time, so that it
does not depend on which thread was faster.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from queue import Empty, Queue
from threading import Event, Thread
from typing import TYPE_CHECKING

from pilotage.behaviors.choice import Source
from pilotage.behaviors.contact_sheet import ContactSheet
from pilotage.recordings.recording import BadFrame, StereoFrame

if TYPE_CHECKING:
    from pilotage import OdometryResult, StereoOdometry

# So many results of a pair may wait for those of slower ones.
WAITING_RESULTS = 16


@dataclass(frozen=True)
class Tracked:
    """What came of one stereo picture of a pair; `bad` where it could not be read."""

    pair: int
    index: int
    result: OdometryResult
    bad: BadFrame | None = None


@dataclass
class PairTrack:
    """One stereo pair while it is tracked; `shift_ns` is added to its times."""

    number: int
    source: Source
    chosen: range
    odometry: StereoOdometry
    shift_ns: int = 0
    indices: list[int] = field(default_factory=list)
    skipped: list[BadFrame] = field(default_factory=list)
    error: Exception | None = None
    sheet: ContactSheet = field(init=False)
    results: Queue[Tracked | None] = field(default_factory=lambda: Queue(WAITING_RESULTS))
    stop: Event = field(default_factory=Event)

    def __post_init__(self) -> None:
        self.sheet = ContactSheet(self.chosen, self.source.name)

    def run(self) -> None:
        """Track the chosen pictures; a fault ends this pair alone and is kept as `error`."""
        try:
            for frame in self.source.recording.frames():
                if frame.index >= self.chosen.stop or self.stop.is_set():
                    break
                if frame.index in self.chosen:
                    self.results.put(self._track(frame))
        except Exception as error:
            self.error = error
        self.results.put(None)

    def _track(self, frame: StereoFrame | BadFrame) -> Tracked:
        time_ns = frame.timestamp_ns + self.shift_ns
        if isinstance(frame, StereoFrame):
            self.sheet.look(frame.index, frame.timestamp_ns, frame.left)
            result = self.odometry.track(frame.left, frame.right, time_ns)
            bad = None
        else:
            result, bad = self.odometry.skip(time_ns), frame
            self.skipped.append(frame)
        self.indices.append(frame.index)
        return Tracked(self.number, frame.index, result, bad)


def run_side_by_side(tracks: Sequence[PairTrack]) -> Generator[Tracked, None, None]:
    """Yield what all pairs say in order of time, of equal times in the order of `tracks`.

    However it ends, no thread is left behind.
    """
    threads = [Thread(target=track.run, name=track.source.name, daemon=True) for track in tracks]
    for thread in threads:
        thread.start()
    try:
        yield from _merged([iter(track.results.get, None) for track in tracks])
    finally:
        for track in tracks:
            track.stop.set()
        for track, thread in zip(tracks, threads, strict=True):
            _drain(track, thread)


def in_order(results: Sequence[Sequence[Tracked]]) -> Iterator[Tracked]:
    """Yield the results of several pairs in order of time, of equal times in order of pairs."""
    yield from _merged([iter(of_pair) for of_pair in results])


def _merged(sources: Sequence[Iterator[Tracked]]) -> Iterator[Tracked]:
    heads = {number: head for number, source in enumerate(sources) if (head := next(source, None))}
    while heads:
        first = min(heads, key=lambda number: (heads[number].result.timestamp_ns, number))
        yield heads.pop(first)
        head = next(sources[first], None)
        if head is not None:
            heads[first] = head


def _drain(track: PairTrack, thread: Thread) -> None:
    """Let a thread that waits for room come to its end."""
    while thread.is_alive():
        try:
            track.results.get(timeout=0.02)
        except Empty:
            continue
    thread.join()


def adjust(tracks: Sequence[PairTrack]) -> list[list[Tracked]]:
    """Adjust each pair's whole block, side by side, and return what it says of every picture.

    A fault is kept as the pair's `error`, and nothing returned of it.
    """

    def adjusted(track: PairTrack) -> list[Tracked]:
        try:
            return _tracked(track, track.odometry.finish())
        except Exception as error:
            track.error = track.error or error
            return []

    with ThreadPoolExecutor(max_workers=len(tracks)) as executor:
        return list(executor.map(adjusted, tracks))


def as_said(track: PairTrack) -> list[Tracked]:
    """Return what a pair said of every picture when it came, not adjusted."""
    return _tracked(track, track.odometry.live_results())


def _tracked(track: PairTrack, results: Sequence[OdometryResult]) -> list[Tracked]:
    bad = {frame.index: frame for frame in track.skipped}
    # A picture the odometry choked on may have a result but no index, hence not strict.
    return [
        Tracked(track.number, index, result, bad.get(index))
        for index, result in zip(track.indices, results, strict=False)
    ]
