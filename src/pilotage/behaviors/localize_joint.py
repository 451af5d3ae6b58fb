# SPDX-License-Identifier: Apache-2.0
"""Localise with several stereo pairs: each tracked by itself, compared and joined by the judge."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotage.behaviors.choice import Choice, Source
from pilotage.behaviors.contact_sheet import sheets_jpeg
from pilotage.behaviors.joint_clouds import joint_cloud
from pilotage.behaviors.joint_summary import Decided, summarize_joint
from pilotage.behaviors.joint_times import Timing, correct_times
from pilotage.behaviors.localize import Selection, pose_numbers, record_of, truth_records
from pilotage.behaviors.pair_track import PairTrack, Tracked, adjust, in_order, run_side_by_side
from pilotage.behaviors.summary import Cost, peak_rss_mb, settle
from pilotage.config import JUDGE, PAIRS
from pilotage.errors import InputError, RunError
from pilotage.judge_files import judge_lines, judge_text, levers_m
from pilotage.judge_words import Story, tell, words
from pilotage.pose_files import PoseRecord
from pilotage.results import ResultsFolder, pair_folders

if TYPE_CHECKING:
    from pilotage import JointResult, Judge, JudgeConfig

OnInstant = Callable[[int, PoseRecord, str], None]
# Of each pair so many results are remembered until the judge has decided their instant.
REMEMBERED = 64


def localize_joint(  # noqa: PLR0913, all by name
    *,
    choice: Choice,
    judge: JudgeConfig,
    out: Path,
    selection: Selection | None = None,
    overwrite: bool = False,
    on_instant: OnInstant | None = None,
) -> dict[str, Any]:
    """Track the pairs of `choice`, join them, write the results folder, and return its summary.

    `on_instant` is told how many pictures of the first pair are done, the last joint record as
    known then, and in words whom the judge believes. An interrupt (Ctrl-C) ends the run early with
    all that was computed; a fault of one pair ends that pair alone.
    """
    sources, chosen = list(choice.sources), selection or Selection()
    rigs = {source.name: source.recording.rig for source in sources}
    with ResultsFolder(out, overwrite=overwrite) as folder:
        configs = {source.name: source.config.to_dict() for source in sources}
        folder.write_config({PAIRS: configs, JUDGE: judge.to_dict()})
        folder.write_calibrations(rigs)
        folder.begin_pairs(rigs)
        run = _Run(choice, judge, folder, [_track(i, s, chosen) for i, s in enumerate(sources)])
        start = Cost.of_all([source.recording for source in sources])
        interrupt: KeyboardInterrupt | None = None
        try:
            run.live(on_instant)
        except KeyboardInterrupt as caught:
            interrupt = caught
        spent = Cost.of_all([source.recording for source in sources]).since(start)
        summary = run.save(spent, interrupt)
    errors = [track.error for track in run.tracks]
    if all(errors) and errors[0] is not None:
        raise errors[0]
    return summary


def _track(number: int, source: Source, selection: Selection) -> PairTrack:
    chosen = selection.indices(len(source.recording))
    return PairTrack(number, source, chosen, source.make_odometry())


@dataclass
class _Run:
    """One run. While it is live, what it remembers does not grow with the number of pictures."""

    choice: Choice
    config: JudgeConfig
    folder: ResultsFolder
    tracks: list[PairTrack]
    names: list[str] = field(init=False)

    def __post_init__(self) -> None:
        self.names = [track.source.name for track in self.tracks]
        rigs = {track.source.name: track.source.recording.rig for track in self.tracks}
        self.levers = levers_m(rigs)
        self.folders = pair_folders(self.names)

    def live(self, on_instant: OnInstant | None) -> None:
        """Track all pairs, and judge them as far as is known at each moment."""
        court = _Court(self._new_judge(), self.config, len(self.tracks))
        done = 0
        with closing(run_side_by_side(self.tracks)) as results:
            for tracked in results:
                name = self.names[tracked.pair]
                self.folder.append_pair_live(self.folders[name], record_of_tracked(tracked))
                done += tracked.pair == 0
                for decision in court.add(tracked):
                    self._append_live(decision)
                    if on_instant is not None:
                        told = words(decision.story, self.names, self.config)
                        on_instant(done, decision.record, told)
        for decision in court.finish():
            self._append_live(decision)

    def _append_live(self, decision: _Decision) -> None:
        self.folder.append_live(decision.record)
        self.folder.append_judge_live(
            judge_lines(decision.joint, decision.record.status, self.levers)
        )

    def _new_judge(self) -> Judge:
        from pilotage import Judge

        return Judge(pairs=len(self.tracks), config=self.config)

    def save(self, cost: Cost, interrupt: KeyboardInterrupt | None) -> dict[str, Any]:
        """Adjust each pair, judge what came of it, write every file that can be written."""
        adjusted = adjust(self.tracks)
        timings: list[Timing] = []
        if interrupt is None:
            adjusted, timings = correct_times(self.tracks, adjusted)
        else:
            adjusted = _up_to_common_end(adjusted)
        court = _Court(self._new_judge(), self.config, len(self.tracks))
        decisions = [one for tracked in in_order(adjusted) for one in court.add(tracked)]
        decisions += court.finish()
        joints = [one.joint for one in decisions]
        records = [one.record for one in decisions]
        alone = {
            name: [record_of_tracked(tracked) for tracked in of_pair]
            for name, of_pair in zip(self.names, adjusted, strict=True)
        }
        summary = summarize_joint(
            choice=self.choice,
            tracks=self.tracks,
            decided=Decided(self.config, joints, records, alone, timings),
            cost=cost,
            # Taken before the report is drawn: drawing needs more memory than tracking.
            peak_rss_mb=peak_rss_mb(),
            error=interrupt,
        )
        self._write(joints, records, alone, summary)
        return summary

    def _write(
        self,
        joints: Sequence[JointResult],
        records: Sequence[PoseRecord],
        alone: dict[str, list[PoseRecord]],
        summary: dict[str, Any],
    ) -> None:
        """Write all that can be written, and only then complain of the first fault."""
        writes: list[Callable[[], None]] = [
            lambda: self.folder.write_trajectory(records),
            lambda: self.folder.write_judge(
                judge_text(joints, [record.status for record in records], self.levers)
            ),
        ]
        writes += [
            partial(self.folder.write_trajectory, of_pair, self.folders[name])
            for name, of_pair in alone.items()
        ]
        writes += [
            lambda: self.folder.write_cloud(*joint_cloud(self.tracks, records, alone)),
            lambda: self.folder.write_truth(_truth_of(self.tracks)),
            lambda: self.folder.write_pictures(sheets_jpeg([t.sheet for t in self.tracks])),
            lambda: self.folder.write_summary(summary),
        ]
        faults = []
        for write in writes:
            try:
                write()
            except RunError as fault:
                faults.append(fault)
        if faults:
            raise faults[0]


def record_of_tracked(tracked: Tracked) -> PoseRecord:
    """Return what one pair says, as the results folder holds it."""
    bad = [] if tracked.bad is None else [tracked.bad]
    return settle([record_of(tracked.index, tracked.result)], bad)[0]


def _up_to_common_end(results: Sequence[Sequence[Tracked]]) -> list[list[Tracked]]:
    """Return what lies before the earliest end: an interrupt finds some pairs further than others.

    Without this a pair would look lost that was only behind.
    """
    ends_ns = [of_pair[-1].result.timestamp_ns for of_pair in results if of_pair]
    end_ns = min(ends_ns, default=0)
    kept = [[t for t in of_pair if t.result.timestamp_ns <= end_ns] for of_pair in results]
    # Shutters need not coincide: the first one at or after the end still tells of it.
    return [
        [*inside, *of_pair[len(inside) : len(inside) + 1]]
        for inside, of_pair in zip(kept, results, strict=True)
    ]


def _truth_of(tracks: Iterable[PairTrack]) -> list[PoseRecord]:
    """Return the truth of the robot, from the first pair that has one that is whole."""
    for track in tracks:
        try:
            records = truth_records(track.source.recording)
        except InputError:
            continue
        if records:
            return records
    return []


@dataclass(frozen=True)
class _Decision:
    """What the judge decided of an instant, as written down and as told."""

    joint: JointResult
    record: PoseRecord
    story: Story


class _Court:
    """The judge, and what else is needed to write down what it decides."""

    def __init__(self, judge: Judge, config: JudgeConfig, pairs: int) -> None:
        self._judge = judge
        self._config = config
        self._story: Story | None = None
        self._seen: list[deque[Tracked]] = [deque(maxlen=REMEMBERED) for _ in range(pairs)]

    def add(self, tracked: Tracked) -> list[_Decision]:
        """Give the judge a pair's result and return what it decides by it."""
        self._seen[tracked.pair].append(tracked)
        return list(map(self._decision, self._judge.add(tracked.pair, tracked.result)))

    def finish(self) -> list[_Decision]:
        """Return what was still waiting for other pairs."""
        return list(map(self._decision, self._judge.finish()))

    def _decision(self, joint: JointResult) -> _Decision:
        self._story = tell(self._story, joint, self._config)
        return _Decision(joint, self._record(joint, self._story), self._story)

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
