# SPDX-License-Identifier: Apache-2.0
"""What a recording yields, one pair at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class StereoFrame:
    """One pair: `left` and `right` are (height, width) uint8, as the camera gave them."""

    index: int
    timestamp_ns: int
    left: Grey
    right: Grey


@dataclass(frozen=True)
class BadFrame:
    """A pair that cannot be read; `reason` names the file. It is skipped and reported."""

    index: int
    timestamp_ns: int
    reason: str


@dataclass(frozen=True)
class Truth:
    """True poses of the left camera: `timestamps_ns` (N,) int64, `world_from_left` (N, 4, 4)."""

    timestamps_ns: NDArray[np.int64]
    world_from_left: NDArray[np.float64]


@dataclass
class DecodeClock:
    """Processor time spent on reading and decoding, seconds."""

    cpu_s: float = 0.0


class Frames(Iterator[StereoFrame | BadFrame]):
    """Frames in order, the next one decoded in a thread while the last one is worked on."""

    def __init__(self, source: Iterator[StereoFrame | BadFrame], clock: DecodeClock) -> None:
        self._source = source
        self._clock = clock
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="decode")
        self._pending: Future[StereoFrame | BadFrame | None] | None = None

    def __next__(self) -> StereoFrame | BadFrame:
        pending = self._pending or self._executor.submit(self._read)
        frame = pending.result()
        if frame is None:
            self._pending = pending
            self._executor.shutdown(wait=False)
            raise StopIteration
        self._pending = self._executor.submit(self._read)
        return frame

    def _read(self) -> StereoFrame | BadFrame | None:
        begin_s = time.thread_time()
        frame = next(self._source, None)
        self._clock.cpu_s += time.thread_time() - begin_s
        return frame
