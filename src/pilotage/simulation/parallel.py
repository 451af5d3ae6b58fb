# SPDX-License-Identifier: Apache-2.0
"""Jobs at the same time, each on its share of the processors."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")
MOST_THREADS = 8  # of all jobs; beyond, what one of them does alone decides


def processors() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_parallel(jobs: Sequence[Callable[[int], Result]]) -> list[Result]:
    """Return what the jobs return, in their order; each is told how many threads it may use.

    The first one's exception is raised when all have ended.
    """
    available = min(processors(), MOST_THREADS)
    threads = max(1, available // max(1, len(jobs)))
    if len(jobs) <= 1 or available == 1:
        return [job(threads) for job in jobs]
    with ThreadPoolExecutor(min(available, len(jobs))) as pool:
        return list(pool.map(lambda job: job(threads), jobs))
