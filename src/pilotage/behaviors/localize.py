# SPDX-License-Identifier: Apache-2.0
"""Localise: pairs of a recording go through the odometry, what comes out into a results folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotage.atomic_files import write_each
from pilotage.behaviors.contact_sheet import ContactSheet
from pilotage.behaviors.summary import Cost, name_of, peak_rss_mb, settle, summarize
from pilotage.errors import InputError
from pilotage.pose_files import PoseRecord
from pilotage.recordings.recording import BadFrame, Recording, StereoFrame
from pilotage.results import ResultsFolder

if TYPE_CHECKING:
    from pilotage import OdometryConfig, OdometryResult, StereoOdometry, Transform

OnPair = Callable[[int, PoseRecord], None]


@dataclass(frozen=True)
class Selection:
    """Which pairs of a recording: indices from `start` to before `end`, each `every`-th."""

    start: int = 0
    end: int | None = None
    every: int = 1

    def __post_init__(self) -> None:
        if self.start < 0:
            raise InputError(f"--start {self.start}: the first pair is 0")
        if self.every < 1:
            raise InputError(f"--every {self.every}: must be 1 or more")
        if self.end is not None and self.end <= self.start:
            raise InputError(f"--end {self.end}: must lie after --start {self.start}")

    def indices(self, pairs: int) -> range:
        """Return the indices taken of so many pairs; InputError where the first lies outside."""
        if self.start >= pairs:
            raise InputError(f"--start {self.start}: the recording has {pairs} pairs")
        end = pairs if self.end is None else min(self.end, pairs)
        return range(self.start, end, self.every)


def localize(  # noqa: PLR0913, all by name
    *,
    recording: Recording,
    odometry: StereoOdometry,
    config: OdometryConfig,
    out: Path,
    selection: Selection | None = None,
    overwrite: bool = False,
    on_pair: OnPair | None = None,
    warnings: Sequence[str] = (),
) -> dict[str, Any]:
    """Track the selected pairs, write the results folder `out`, and return its summary.

    `on_pair` is told how many pairs are done and the last one's live record; `warnings` of before
    the run go into the summary. An interrupt (Ctrl-C) or an error on the way ends the run early:
    all that was computed is adjusted and written; an error then goes on, an interrupt is told by
    the summary's `state`.
    """
    chosen = (selection or Selection()).indices(len(recording))
    with ResultsFolder(out, overwrite=overwrite) as folder:
        folder.write_config(config.to_dict())
        folder.write_calibration(recording.rig)
        run = _Run(recording, odometry, folder, chosen, ContactSheet(chosen), warnings)
        start = Cost.now(recording)
        error: BaseException | None = None
        try:
            run.track(on_pair)
        except (Exception, KeyboardInterrupt) as caught:
            error = caught
        summary = run.save(Cost.now(recording).since(start), error)
    if error is not None and not isinstance(error, KeyboardInterrupt):
        raise error
    return summary


@dataclass
class _Run:
    """One run. What it remembers of each pair is small: memory stays flat over any number."""

    recording: Recording
    odometry: StereoOdometry
    folder: ResultsFolder
    chosen: range
    sheet: ContactSheet
    warnings: Sequence[str] = ()
    indices: list[int] = field(default_factory=list)
    skipped: list[BadFrame] = field(default_factory=list)

    def track(self, on_pair: OnPair | None) -> None:
        """Give the chosen pairs to the odometry, one after the other."""
        for frame in self.recording.frames():
            if frame.index >= self.chosen.stop:
                return
            if frame.index not in self.chosen:
                continue
            record = self._track_pair(frame)
            self.folder.append_live(record)
            if on_pair is not None:
                on_pair(len(self.indices), record)

    def _track_pair(self, frame: StereoFrame | BadFrame) -> PoseRecord:
        self.indices.append(frame.index)
        if isinstance(frame, StereoFrame):
            self.sheet.look(frame.index, frame.timestamp_ns, frame.left)
            result = self.odometry.track(frame.left, frame.right, frame.timestamp_ns)
            return record_of(frame.index, result)
        self.skipped.append(frame)
        result = self.odometry.skip(frame.timestamp_ns)
        return settle([record_of(frame.index, result)], [frame])[0]

    def save(self, cost: Cost, error: BaseException | None) -> dict[str, Any]:
        """Adjust, write every file that can be written, and only then complain of a fault."""
        # A pair the odometry choked on has an index but no result, hence not strict.
        adjusted = zip(self.indices, self.odometry.finish(), strict=False)
        records = settle([record_of(index, result) for index, result in adjusted], self.skipped)
        points, greys = self.odometry.points(), self.odometry.point_greys()
        summary = summarize(
            recording=self.recording,
            odometry=self.odometry,
            records=records,
            skipped=self.skipped,
            chosen=self.chosen,
            cost=cost,
            # Taken before the report is drawn: drawing needs more memory than tracking.
            peak_rss_mb=peak_rss_mb(),
            error=error,
            warnings=self.warnings,
        )
        faults = write_each(
            [
                lambda: self.folder.write_trajectory(records),
                lambda: self.folder.write_cloud(points, greys),
                lambda: self.folder.write_truth(truth_records(self.recording)),
                lambda: self.folder.write_pictures(self.sheet.jpeg()),
                lambda: self.folder.write_summary(summary),
            ]
        )
        if faults and error is None:
            raise faults[0]
        return summary


def record_of(index: int, result: OdometryResult) -> PoseRecord:
    """Return what the odometry said of the pair `index`, as the results folder holds it."""
    pose = result.world_from_left
    position, quaternion = (None, None) if pose is None else pose_numbers(pose)
    return PoseRecord(
        index=index,
        timestamp_ns=result.timestamp_ns,
        status=name_of(result.status),
        reason=name_of(result.reason),
        position_m=position,
        quaternion_wxyz=quaternion,
        covariance=result.covariance,
        segment=result.segment,
        matches=result.matches,
        inliers=result.inliers,
        residual_px=result.residual_px,
        y_parallax_px=result.y_parallax_px,
        is_keyframe=result.is_keyframe,
    )


def truth_records(recording: Recording) -> list[PoseRecord]:
    """Return the truth that came with the recording, of the body whose poses the results hold."""
    from pilotage import Transform

    truth = recording.truth()
    if truth is None:
        return []
    robot_from_left = recording.rig.robot_from_left
    left_from_body = robot_from_left.inverse() if robot_from_left else Transform()
    records = []
    times = zip(truth.timestamps_ns.tolist(), truth.world_from_left, strict=True)
    for index, (timestamp_ns, world_from_left) in enumerate(times):
        world_from_body = Transform.from_matrix(world_from_left) @ left_from_body
        position, quaternion = pose_numbers(world_from_body)
        records.append(
            PoseRecord(
                index, timestamp_ns, "tracking", position_m=position, quaternion_wxyz=quaternion
            )
        )
    return records


def pose_numbers(
    pose: Transform,
) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return position and unit quaternion (wxyz) as plain numbers."""
    x, y, z = pose.translation_m.tolist()
    qw, qx, qy, qz = pose.quaternion_wxyz.tolist()
    return (x, y, z), (qw, qx, qy, qz)
