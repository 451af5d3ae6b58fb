# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs whose clocks differ: found by how the robot moved, corrected where constant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotage.behaviors.pair_track import PairTrack, Tracked, adjust, run_side_by_side
from pilotage.evaluation.clocks import ClockCheck, Track, check_clocks


@dataclass(frozen=True)
class Timing:
    """What was found of a pair's time stamps against another's; `corrected_ms` was taken off."""

    pair: str
    against: str
    check: ClockCheck
    corrected_ms: float = 0.0

    def warning(self) -> str | None:
        """Return what is wrong, by how much and what was done; None where nothing is."""
        offset_ms = 1e3 * self.check.offset_s
        told = f"The time stamps of {self.pair} are {_late(offset_ms)} against {self.against}'s"
        if self.check.drifts:
            return (
                f"{told} and drift by {1e3 * self.check.drift_s_min:+.0f} ms a minute. They were"
                " taken as they are, so the pairs may disagree; stamp both by one clock."
            )
        if not self.check.is_offset:
            return None
        if self.corrected_ms:
            return f"{told}, steadily. They were corrected by that; stamp both by one clock."
        return f"{told}, steadily. They were taken as they are; stamp both by one clock."

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for summary.json."""
        check = self.check
        return {
            "pair": self.pair,
            "against": self.against,
            "late_ms": 1e3 * check.offset_s,
            "late_sigma_ms": 1e3 * check.offset_sigma_s,
            "drift_ms_per_min": 1e3 * check.drift_s_min,
            "drift_sigma_ms_per_min": 1e3 * check.drift_sigma_s_min,
            "corrected_ms": self.corrected_ms,
        }


def _late(offset_ms: float) -> str:
    return f"{abs(offset_ms):.0f} ms {'late' if offset_ms > 0 else 'early'}"


def correct_times(
    tracks: Sequence[PairTrack], adjusted: Sequence[Sequence[Tracked]]
) -> tuple[list[list[Tracked]], list[Timing]]:
    """Return the results with times corrected where they are plainly off, and what was found.

    Each pair is set against the first one that moved visibly. A corrected pair is tracked anew
    with its times shifted; an interrupt meanwhile leaves it as it was.
    """
    results = [list(of_pair) for of_pair in adjusted]
    paths = [_path(of_pair) for of_pair in results]
    timings: list[Timing] = []
    reference = max(range(len(paths)), key=lambda n: (len(paths[n].timestamps_ns) > 0, -n))
    for number, track in enumerate(tracks):
        if number == reference:
            continue
        check = check_clocks(paths[reference], paths[number])
        if check is None:
            continue
        shift_ms = 0.0
        if check.is_offset:
            anew = _track_anew(track, round(-check.offset_s * 1e9))
            if anew is not None:
                results[number], shift_ms = anew, 1e3 * check.offset_s
        against = tracks[reference].source.name
        timings.append(Timing(track.source.name, against, check, shift_ms))
    return results, timings


def _path(results: Sequence[Tracked]) -> Track:
    known = [
        (tracked.result.timestamp_ns, pose.matrix(), tracked.result.segment)
        for tracked in results
        if (pose := tracked.result.world_from_left) is not None
    ]
    return Track(
        np.array([time_ns for time_ns, _, _ in known], dtype=np.int64),
        np.array([pose for _, pose, _ in known], dtype=np.float64).reshape(-1, 4, 4),
        np.array([segment for _, _, segment in known], dtype=np.int64),
    )


def _track_anew(track: PairTrack, shift_ns: int) -> list[Tracked] | None:
    """Return a pair's results with its times shifted; None where that was interrupted."""
    anew = PairTrack(
        track.number, track.source, track.chosen, track.source.make_odometry(), shift_ns
    )
    try:
        for _ in run_side_by_side([anew]):
            pass
        return adjust([anew])[0] if anew.error is None else None
    except KeyboardInterrupt:
        return None
