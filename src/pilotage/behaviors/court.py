# SPDX-License-Identifier: Apache-2.0
"""The judge at work: what it decides of each instant, as written down and as told."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pilotage.behaviors.localize import pose_numbers, record_of
from pilotage.behaviors.pair_track import Tracked
from pilotage.behaviors.summary import settle
from pilotage.judge_words import Story, tell
from pilotage.pose_files import PoseRecord

if TYPE_CHECKING:
    from pilotage import JointResult, Judge, JudgeConfig

# Of each pair so many results are remembered until the judge has decided their instant.
REMEMBERED = 64


def record_of_tracked(tracked: Tracked) -> PoseRecord:
    """Return what one pair says, as the results folder holds it."""
    bad = [] if tracked.bad is None else [tracked.bad]
    return settle([record_of(tracked.index, tracked.result)], bad)[0]


@dataclass(frozen=True)
class Decision:
    """What the judge decided of an instant, as written down and as told."""

    joint: JointResult
    record: PoseRecord
    story: Story


class Court:
    """The judge, and what else is needed to write down what it decides."""

    def __init__(self, judge: Judge, config: JudgeConfig, pairs: int) -> None:
        self._judge = judge
        self._config = config
        self._story: Story | None = None
        self._seen: list[deque[Tracked]] = [deque(maxlen=REMEMBERED) for _ in range(pairs)]

    def add(self, tracked: Tracked) -> list[Decision]:
        """Give the judge a pair's result and return what it decides by it."""
        self._seen[tracked.pair].append(tracked)
        return list(map(self._decision, self._judge.add(tracked.pair, tracked.result)))

    def finish(self) -> list[Decision]:
        """Return what was still waiting for other pairs."""
        return list(map(self._decision, self._judge.finish()))

    def _decision(self, joint: JointResult) -> Decision:
        self._story = tell(self._story, joint, self._config)
        return Decision(joint, self._record(joint, self._story), self._story)

    def _record(self, joint: JointResult, story: Story) -> PoseRecord:
        """Return the joint pose as the results folder holds it.

        Index and measures are of the pictures that are nearest in time, of those believed.
        """
        near = [self._nearest(pair, joint.timestamp_ns) for pair in range(len(self._seen))]
        here = [(tracked, v) for tracked, v in zip(near, joint.pairs, strict=True) if tracked]
        at = min(here, key=lambda item: abs(item[0].result.timestamp_ns - joint.timestamp_ns))[0]
        believed = [tracked.result for tracked, v in here if v.belief.name == "joined"]
        near_bad = bool(here) and all(tracked.bad is not None for tracked, _ in here)
        status, reason = _status_of(joint, story, is_bad=near_bad)
        pose = joint.world_from_robot
        position, quaternion = (None, None) if pose is None else pose_numbers(pose)
        best = max(believed, key=lambda result: result.inliers, default=None)
        return PoseRecord(
            index=at.index,
            timestamp_ns=joint.timestamp_ns,
            status=status,
            reason=reason,
            position_m=position,
            quaternion_wxyz=quaternion,
            covariance=joint.covariance,
            segment=joint.segment,
            matches=sum(result.matches for result in believed),
            inliers=sum(result.inliers for result in believed),
            residual_px=best.residual_px if best else float("nan"),
            y_parallax_px=best.y_parallax_px if best else float("nan"),
            is_keyframe=any(result.is_keyframe for result in believed),
        )

    def _nearest(self, pair: int, timestamp_ns: int) -> Tracked | None:
        seen = self._seen[pair]
        return min(seen, key=lambda t: abs(t.result.timestamp_ns - timestamp_ns), default=None)


def _status_of(joint: JointResult, story: Story, *, is_bad: bool) -> tuple[str, str]:
    """Return status and reason of the closed list; the choice itself stands in judge.csv.

    `is_bad` tells that no pair's picture could be read.
    """
    status = joint.status.name
    if status == "tracking":
        return status, "none"
    if status == "lost" and is_bad:
        return "skipped", "frames_missing"
    if status == "degraded":
        if story.is_disputed:
            return status, "pairs_disagree"
        sound = [v for v in joint.pairs if v.belief.name == "joined"]
        if any(verdict.status.name == "tracking" for verdict in sound):
            return "tracking", "none"
        return status, next((v.reason.name for v in sound if v.reason.name != "none"), "none")
    reasons = [verdict.reason.name for verdict in joint.pairs if verdict.reason.name != "none"]
    absent = any(verdict.belief.name == "absent" for verdict in joint.pairs)
    return status, reasons[0] if reasons else "frames_missing" if absent else "none"
