# SPDX-License-Identifier: Apache-2.0
"""What a results folder holds of several stereo pairs: each path, and how they were judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pilotage.errors import InputError
from pilotage.evaluation.course import Course
from pilotage.evaluation.poses import Array, inverse
from pilotage.evaluation.truth import poses_of
from pilotage.judge_files import JudgeRow, read_judge_table
from pilotage.pose_files import PoseRecord
from pilotage.results import JUDGE, JUDGE_LIVE, Results, read_pair_records

# A pose counts as that of an instant when it is so near.
SAME_INSTANT_NS = 100_000_000


@dataclass(frozen=True)
class Several:
    """Poses of each stereo pair by name, each in its own world, and the lines of judge.csv."""

    records: Mapping[str, Sequence[PoseRecord]]
    rows: Sequence[JudgeRow]

    @property
    def names(self) -> list[str]:
        """Return the names of the pairs in the order of the judge, the first one leading."""
        return list(dict.fromkeys(row.pair for row in self.rows))

    def of(self, name: str) -> list[JudgeRow]:
        """Return the rows of a pair in order of time."""
        return [row for row in self.rows if row.pair == name]

    def times_s(self, name: str) -> Array:
        """Return the (N,) times of a pair's rows since the first instant."""
        start_ns = self.rows[0].timestamp_ns
        return np.array([(row.timestamp_ns - start_ns) * 1e-9 for row in self.of(name)])


def read_several(results: Results) -> Several | None:
    """Return what the folder holds of several pairs; None of a run with one, or broken files."""
    path = results.path / (JUDGE if results.adjusted else JUDGE_LIVE)
    if not path.exists():
        return None
    try:
        rows = read_judge_table(path)
        return Several(read_pair_records(results), rows) if rows else None
    except InputError:
        return None


def joint_from_own(joint: Sequence[PoseRecord], own: Sequence[PoseRecord]) -> Array | None:
    """Return (4, 4) from a pair's own world to the joint one, where the two first have a pose.

    None where they never have one at the same instant.
    """
    known = [record for record in joint if record.position_m is not None]
    times_ns = np.array([record.timestamp_ns for record in known], dtype=np.int64)
    for record in own:
        if record.position_m is None or not len(times_ns):
            continue
        nearest = int(np.argmin(np.abs(times_ns - record.timestamp_ns)))
        if abs(int(times_ns[nearest]) - record.timestamp_ns) <= SAME_INSTANT_NS:
            poses = poses_of([known[nearest], record])
            return np.asarray(poses[0] @ inverse(poses[1]))
    return None


def paths_in_view(course: Course, several: Several) -> dict[str, Array]:
    """Return each pair's (N, 3) path in the axes of the joint `course`, NaN where it was lost.

    Each is laid onto the joint one where the two first meet.
    """
    known = [record for record in course.records if record.position_m is not None]
    paths = {}
    for name, records in several.records.items():
        placed = joint_from_own(course.records, records)
        if placed is not None and known:
            origin = poses_of(known[:1])[0, :3, 3]
            laid = (placed @ poses_of(records))[:, :3, 3]
            paths[name] = np.asarray((laid - origin) @ course.axes.T)
    return paths
