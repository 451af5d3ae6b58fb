# SPDX-License-Identifier: Apache-2.0
"""Localise with several stereo pairs: each tracked by itself, compared and joined by the judge."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotage.atomic_files import write_each
from pilotage.behaviors.choice import Choice, Source
from pilotage.behaviors.contact_sheet import sheets_jpeg
from pilotage.behaviors.court import Court, Decision, record_of_tracked
from pilotage.behaviors.joint_clouds import joint_cloud
from pilotage.behaviors.joint_summary import Decided, summarize_joint
from pilotage.behaviors.joint_times import Timing, correct_times
from pilotage.behaviors.localize import Selection, truth_records
from pilotage.behaviors.pair_track import (
    PairTrack,
    Tracked,
    adjust,
    as_said,
    in_order,
    run_side_by_side,
)
from pilotage.behaviors.summary import Cost, peak_rss_mb
from pilotage.config import JUDGE, PAIRS
from pilotage.errors import InputError, RunError
from pilotage.judge_files import judge_lines, judge_text, levers_m
from pilotage.judge_words import words
from pilotage.pose_files import PoseRecord
from pilotage.results import ResultsFolder, pair_folders

if TYPE_CHECKING:
    from pilotage import JointResult, JudgeConfig

OnInstant = Callable[[int, PoseRecord, str], None]


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
        error: BaseException | None = None
        try:
            run.live(on_instant)
        except (Exception, KeyboardInterrupt) as caught:
            error = caught
        spent = Cost.of_all([source.recording for source in sources]).since(start)
        summary = run.save(spent, error)
    errors = [track.error for track in run.tracks]
    if error is None and all(errors):
        error = errors[0]
    if error is not None and not isinstance(error, KeyboardInterrupt):
        raise error
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
        from pilotage import Judge

        self.names = [track.source.name for track in self.tracks]
        rigs = {track.source.name: track.source.recording.rig for track in self.tracks}
        self.levers = levers_m(rigs)
        self.folders = pair_folders(self.names)
        self._judge = Judge(pairs=len(self.tracks), config=self.config)

    def live(self, on_instant: OnInstant | None) -> None:
        """Track all pairs, and judge them as far as is known at each moment."""
        court = Court(self._judge, self.config, len(self.tracks))
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

    def _heard(
        self, adjusted: Sequence[list[Tracked]], timings: Sequence[Timing]
    ) -> list[list[Tracked]]:
        """Return what is judged at the end: of a pair set aside for good what it said live.

        Adjusted, its fault reaches back to where it was sound.
        """
        shifted = {timing.pair for timing in timings if timing.corrected_ms}
        return [
            as_said(track) if is_aside and name not in shifted else of_pair
            for name, track, of_pair, is_aside in zip(
                self.names, self.tracks, adjusted, self._judge.set_aside(), strict=True
            )
        ]

    def _append_live(self, decision: Decision) -> None:
        self.folder.append_live(decision.record)
        self.folder.append_judge_live(
            judge_lines(decision.joint, decision.record.status, self.levers)
        )

    def save(self, cost: Cost, error: BaseException | None) -> dict[str, Any]:
        """Adjust each pair, judge what came of it, write every file that can be written."""
        adjusted = adjust(self.tracks)
        timings: list[Timing] = []
        if error is None:
            adjusted, timings = correct_times(self.tracks, adjusted)
        else:
            adjusted = _up_to_common_end(adjusted)
        court = Court(self._judge.again(), self.config, len(self.tracks))
        heard = adjusted if error is not None else self._heard(adjusted, timings)
        decisions = [one for tracked in in_order(heard) for one in court.add(tracked)]
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
            error=error,
        )
        faults = self._write(joints, records, alone, summary)
        if faults and error is None:
            raise faults[0]
        return summary

    def _write(
        self,
        joints: Sequence[JointResult],
        records: Sequence[PoseRecord],
        alone: dict[str, list[PoseRecord]],
        summary: dict[str, Any],
    ) -> list[RunError]:
        """Write all that can be written, and return the faults."""
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
        return write_each(writes)


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
