# SPDX-License-Identifier: Apache-2.0
"""Whether two trajectories of one robot were stamped by the same clock.

Speeds and turn rates of the two, in the robot's axes, must rise and fall together. The difference
in time that lays them onto each other best is found in pieces of the recording: a line through it
tells a constant offset and a drift. Pure functions; no input is changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pilotage.evaluation.poses import Array, inverse, rotation_vectors

PIECE_S = 10.0
FEWEST_PIECES = 3
WIDEST_S = 1.0  # an offset is looked for so far
STEPS_A_PERIOD = 8
# A step of more periods than this is a gap.
GAP_PERIODS = 2.5
# An offset or drift counts when it is so many standard errors.
SIGNIFICANT = 4.0
# Rates are averages over so many periods: a single step's are noisy.
AVERAGED_PERIODS = 2
LEAST_INSTANTS = 15


@dataclass(frozen=True)
class ClockCheck:
    """How late the second trajectory's stamps are, on average and more each minute.

    `limit_s` is what does not matter, half a picture's period; all in seconds, or seconds a minute.
    """

    offset_s: float
    offset_sigma_s: float
    drift_s_min: float
    drift_sigma_s_min: float
    duration_s: float
    limit_s: float

    @property
    def drifts(self) -> bool:
        """Tell whether the difference changes by more than the limit over the recording."""
        change_s = abs(self.drift_s_min) * self.duration_s / 60
        sound = abs(self.drift_s_min) > SIGNIFICANT * self.drift_sigma_s_min
        return bool(sound and change_s > self.limit_s)

    @property
    def is_offset(self) -> bool:
        """Tell whether the difference is constant and more than the limit."""
        sound = abs(self.offset_s) > SIGNIFICANT * self.offset_sigma_s
        return bool(not self.drifts and sound and abs(self.offset_s) > self.limit_s)


@dataclass(frozen=True)
class Track:
    """Poses (N, 4, 4) of the robot at rising (N,) times, ns; each segment (N,) has its world."""

    timestamps_ns: NDArray[np.int64]
    poses: Array
    segments: NDArray[np.int64]


def check_clocks(first: Track, second: Track) -> ClockCheck | None:
    """Return how the clocks differ; None where the motion does not tell."""
    if min(len(first.timestamps_ns), len(second.timestamps_ns)) < LEAST_INSTANTS:
        return None
    origin_ns = int(first.timestamps_ns[0])
    a, b = _Ways.of(first, origin_ns), _Ways.of(second, origin_ns)
    period_s = max(a.period_s, b.period_s)
    begin_s = max(a.times_s[0], b.times_s[0])
    end_s = min(a.times_s[-1], b.times_s[-1])
    if end_s - begin_s < LEAST_INSTANTS * period_s:
        return None
    duration_s = end_s - begin_s
    # Of a short recording as many as can be, for one alone tells of no drift.
    few = min(FEWEST_PIECES, int(duration_s / ((LEAST_INSTANTS + 2) * period_s)))
    pieces = max(1, few, round(duration_s / PIECE_S))
    edges = np.linspace(begin_s, end_s, pieces + 1)
    found = [
        (0.5 * (low + high), *shift)
        for low, high in pairwise(edges.tolist())
        if (shift := _shift(a, b, low, high, period_s)) is not None
    ]
    if not found:
        return None
    return _line(np.array(found), duration_s, 0.5 * period_s)


@dataclass(frozen=True)
class _Ways:
    """The way and turn since the start, (N, 6) summed in the robot's own axes, and where it has a
    gap (N,): `gaps` counts them.
    """

    times_s: Array
    summed: Array
    gaps: Array
    period_s: float

    @staticmethod
    def of(track: Track, origin_ns: int) -> _Ways:
        times_s = (track.timestamps_ns - origin_ns) * 1e-9
        spans = np.diff(times_s)
        period_s = float(np.median(spans))
        steps = inverse(track.poses[:-1]) @ track.poses[1:]
        moves = np.hstack([steps[:, :3, 3], rotation_vectors(steps[:, :3, :3])])
        gaps = (spans > GAP_PERIODS * period_s) | (np.diff(track.segments) != 0)
        return _Ways(
            np.asarray(times_s, np.float64),
            np.vstack([np.zeros(6), np.cumsum(moves, axis=0)]),
            np.concatenate([[0.0], np.cumsum(gaps)]),
            period_s,
        )

    def rates(self, at_s: Array, over_s: float) -> Array:
        """Return (M, 6) mean rates around each time; NaN at a gap and outside."""
        ends = at_s - 0.5 * over_s, at_s + 0.5 * over_s
        low, high = (
            np.column_stack([np.interp(end, self.times_s, column) for column in self.summed.T])
            for end in ends
        )
        gap = np.interp(ends[1], self.times_s, self.gaps) > np.interp(
            ends[0], self.times_s, self.gaps
        )
        outside = (ends[0] < self.times_s[0]) | (ends[1] > self.times_s[-1])
        rates = (high - low) / over_s
        rates[gap | outside] = np.nan
        return np.asarray(rates)


def _shift(
    a: _Ways, b: _Ways, low_s: float, high_s: float, period_s: float
) -> tuple[float, float] | None:
    """Return the time by which b's stamps are late in a piece, and its standard error."""
    over_s = AVERAGED_PERIODS * period_s
    at_s = np.arange(low_s, high_s, period_s)
    wanted = a.rates(at_s, over_s)
    shifts = np.arange(-WIDEST_S, WIDEST_S, period_s / STEPS_A_PERIOD)
    there = np.stack([b.rates(at_s + shift, over_s) for shift in shifts])
    known = np.isfinite(wanted[:, 0]) & np.isfinite(there[:, :, 0]).sum(axis=0).astype(bool)
    if known.sum() < LEAST_INSTANTS:
        return None
    apart = (there - wanted)[:, known]
    weights = np.ones(6) / np.maximum(np.nanvar(wanted[known], axis=0), 1e-6)
    best = 0
    for _ in range(3):  # weights from what is left at the best place
        costs = np.array([_cost(errors, weights) for errors in apart])
        best = int(np.nanargmin(costs))
        weights = 1 / np.maximum(np.nanmedian(apart[best] ** 2, axis=0) / 0.455, 1e-8)
    if best in {0, len(shifts) - 1}:
        return None
    before, here, after = costs[best - 1 : best + 2]
    bend = before - 2 * here + after
    if not np.isfinite(bend) or bend <= 0:
        return None
    step_s = period_s / STEPS_A_PERIOD
    shift_s = float(shifts[best] + 0.5 * step_s * (before - after) / bend)
    slopes = np.gradient(wanted, period_s, axis=0)[known]
    told = float(np.nansum(np.minimum(slopes**2, 1e6) * weights))
    # Neighbouring averages share their steps: that many fewer count.
    sigma_s = float(np.sqrt(AVERAGED_PERIODS / max(told, 1e-12)))
    return (shift_s, sigma_s) if sigma_s < 0.5 * period_s else None


def _cost(errors: Array, weights: Array) -> float:
    """Return the mean of bounded squares, (M, 6); infinite where too little is left to compare."""
    known = np.isfinite(errors[:, 0])
    if known.sum() < LEAST_INSTANTS:
        return float("inf")
    squares = np.minimum(errors[known] ** 2 * weights, 9.0)
    return float(squares.sum(axis=1).mean())


def _line(found: Array, duration_s: float, limit_s: float) -> ClockCheck:
    """Fit offset and drift to (K, 3) rows of time, offset and its standard error, seconds."""
    # The wobble of pictures between their stamps is in no piece's own error.
    sigmas = np.hypot(found[:, 2], 0.05 * limit_s)
    middle_s = float(np.average(found[:, 0], weights=sigmas**-2))
    design = np.column_stack([np.ones(len(found)), (found[:, 0] - middle_s) / 60])
    if len(found) < 2:
        sigma = float(sigmas[0])
        return ClockCheck(float(found[0, 1]), sigma, 0.0, np.inf, duration_s, limit_s)
    keep = np.ones(len(found), dtype=bool)
    for _ in range(3):
        weighted = design[keep] / sigmas[keep, None]
        normal = np.linalg.pinv(weighted.T @ weighted)
        solved = normal @ weighted.T @ (found[keep, 1] / sigmas[keep])
        apart = np.abs(found[:, 1] - design @ solved)
        scale = max(1.0, 1.48 * float(np.median(apart / sigmas)))
        keep = apart <= 4 * scale * sigmas
    errors = scale * np.sqrt(np.diag(normal))
    return ClockCheck(
        float(solved[0]), float(errors[0]), float(solved[1]), float(errors[1]), duration_s, limit_s
    )
