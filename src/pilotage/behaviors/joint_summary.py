# SPDX-License-Identifier: Apache-2.0
"""What a run with several stereo pairs amounted to; the content of its summary.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pilotage.behaviors.joint_times import Timing
from pilotage.behaviors.summary import (
    LISTED_PAIRS,
    Cost,
    describe_calibration,
    describe_run,
    describe_tracking,
    warnings_of,
)
from pilotage.judge_words import Happening, happenings
from pilotage.pose_files import PoseRecord
from pilotage.results import pair_folders

if TYPE_CHECKING:
    from pilotage import JointResult, JudgeConfig
    from pilotage.behaviors.choice import Choice
    from pilotage.behaviors.pair_track import PairTrack

GRAVITY = ("inconsistent", "consistent", "unobservable")


@dataclass(frozen=True)
class Decided:
    """What the judge made of the pairs: the joint records, and each pair's alone, by name."""

    config: JudgeConfig
    joints: Sequence[JointResult]
    records: Sequence[PoseRecord]
    alone: Mapping[str, Sequence[PoseRecord]]
    timings: Sequence[Timing]


def summarize_joint(  # noqa: PLR0913, all by name
    *,
    choice: Choice,
    tracks: Sequence[PairTrack],
    decided: Decided,
    cost: Cost,
    peak_rss_mb: float,
    error: BaseException | None,
) -> dict[str, Any]:
    """Return the content of summary.json; see docs/results_folder.md."""
    first = tracks[0]
    broken = [track for track in tracks if track.error is not None]
    all_broken = first.error if len(broken) == len(tracks) else None
    summary: dict[str, Any] = {
        **describe_run(first.source.recording, first.chosen, error or all_broken),
        "body": "robot",
        **describe_tracking(decided.records, []),
        **cost.per_pair_ms(len(decided.records)),
        "adjustment_cpu_ms": sum(track.odometry.adjustment_cpu_ms for track in tracks),
        "peak_rss_mb": peak_rss_mb,
        "stereo_pairs": _describe_pairs(tracks, decided.alone),
        "left_out": dict(choice.left_out),
        "clocks": [timing.to_dict() for timing in decided.timings],
        "judge": _describe_judge(choice, decided),
    }
    summary["calibration_check"] = _gravest_check(summary["stereo_pairs"])
    return {**summary, "warnings": _warnings(choice, broken, decided, summary)}


def _describe_pairs(
    tracks: Sequence[PairTrack], alone: Mapping[str, Sequence[PoseRecord]]
) -> list[dict[str, Any]]:
    folders = pair_folders(alone)
    return [
        {
            "name": track.source.name,
            "folder": folders[track.source.name],
            "looks": "down" if track.source.is_downward else "ahead",
            "error": None if track.error is None else str(track.error),
            **describe_tracking(alone[track.source.name], track.skipped),
            "calibration_check": describe_calibration(track.odometry.calibration_check()),
        }
        for track in tracks
    ]


def _gravest_check(pairs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the check of the pair whose calibration fits worst, and its name."""
    worst = min(pairs, key=lambda pair: GRAVITY.index(pair["calibration_check"]["verdict"]))
    check = dict(worst["calibration_check"])
    return {**check, "pair": worst["name"], "message": f"{worst['name']}: {check['message']}"}


def _describe_judge(choice: Choice, decided: Decided) -> dict[str, Any]:
    names = [source.name for source in choice.sources]
    believed = [
        [name for name, v in zip(names, joint.pairs, strict=True) if v.belief.name == "joined"]
        for joint in decided.joints
    ]
    counts = Counter("+".join(those) for those in believed)
    told = happenings(decided.joints, names, decided.config)
    stopped_s = _stops_s(decided.joints)
    start_ns = decided.joints[0].timestamp_ns if decided.joints else 0
    return {
        "use": choice.use.value,
        "rule": decided.config.rule,
        "window_s": decided.config.window_s,
        "confidence": decided.config.confidence,
        "believed": dict(counts.most_common()),
        "stops": len(stopped_s),
        "stopped_s": sum(stopped_s),
        "happenings": [_describe_happening(one, start_ns) for one in told[:LISTED_PAIRS]],
    }


def _stops_s(joints: Sequence[JointResult]) -> list[float]:
    """Return how long each stretch without any pose lasted, up to the next instant with one."""
    stops: list[float] = []
    started_ns: int | None = None
    for joint in joints:
        if joint.status.name != "lost":
            if started_ns is not None:
                stops.append((joint.timestamp_ns - started_ns) * 1e-9)
            started_ns = None
        elif started_ns is None:
            started_ns = joint.timestamp_ns
    if started_ns is not None:
        stops.append((joints[-1].timestamp_ns - started_ns) * 1e-9)
    return stops


def _describe_happening(happening: Happening, start_ns: int) -> dict[str, Any]:
    return {
        "from_s": (happening.start_ns - start_ns) * 1e-9,
        "to_s": (happening.end_ns - start_ns) * 1e-9,
        "words": happening.words,
        "stop": happening.must_stop,
    }


def _warnings(
    choice: Choice,
    broken: Sequence[PairTrack],
    decided: Decided,
    summary: dict[str, Any],
) -> list[str]:
    """Return what the user must know, the gravest first."""
    warnings = choice.warnings()
    warnings += [
        f"The stereo pair {track.source.name} failed after {len(track.indices)} pictures:"
        f" {track.error}. What it had said until then is kept."
        for track in broken
    ]
    judged = summary["judge"]
    if judged["stops"]:
        first = next(told for told in judged["happenings"] if told["stop"])
        warnings.append(
            f"The robot was to stop {_times(judged['stops'])}, for {judged['stopped_s']:.1f} s in"
            f" all: no pair knew where it was. First at {first['from_s']:.1f} s: {first['words']}."
        )
    warnings += [told for timing in decided.timings if (told := timing.warning()) is not None]
    warnings += warnings_of(summary)
    doubted = [told for told in judged["happenings"] if not told["stop"]]
    if doubted and judged["rule"] != "paper":
        longest = max(doubted, key=lambda told: float(told["to_s"] - told["from_s"]))
        warnings.append(
            f"A pair was not believed {_times(len(doubted))}; the longest, from"
            f" {longest['from_s']:.1f} s to {longest['to_s']:.1f} s: {longest['words']}."
        )
    return warnings


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
