# SPDX-License-Identifier: Apache-2.0
"""report.html: one page that shows a run, with nothing fetched from elsewhere.

`python -m pilotage.evaluation.report OUT` draws it anew from a results folder.
"""

from __future__ import annotations

import base64
import contextlib
import sys
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from pilotage.errors import InputError
from pilotage.evaluation import plots
from pilotage.evaluation.course import Course, course_of, truth_in_view
from pilotage.evaluation.evaluate import Comparison, evaluate_results
from pilotage.evaluation.judge_plots import draw_pair_errors
from pilotage.evaluation.judge_report import alone_table, judge_sections
from pilotage.evaluation.metrics import SegmentError
from pilotage.evaluation.page import (
    appendix,
    figure_card,
    head,
    number_cards,
    run_alone,
    verdict_card,
    warnings_card,
    write_page,
)
from pilotage.evaluation.several import Several, paths_in_view, read_several
from pilotage.evaluation.verdict import (
    calibration_words,
    failure_words,
    length_words,
    metric_rows,
    tracking_words,
)
from pilotage.reasons import reason_remedy, reason_words
from pilotage.results import PICTURES, TRUTH, Results, read_results


def write_report(results: Results, comparison: Comparison | None) -> None:
    """Write report.html into the results folder; `comparison` adds what is known of the truth."""
    write_page(results.path, _recording(results)["name"], _sections(results, comparison))


def _recording(results: Results) -> dict[str, Any]:
    """Return what the summary says of the recording; a killed run did not come to say it."""
    unknown = {"name": results.path.name, "path": "?"}
    return dict(results.summary.get("recording", unknown))


def _sections(results: Results, comparison: Comparison | None) -> Iterable[str]:
    summary = results.summary
    course = course_of(results.records, summary.get("body", "left"))
    several = read_several(results)
    yield _head(results)
    if "pairs" in summary:
        yield _verdict(summary)
        yield warnings_card(summary["warnings"])
        yield _numbers(summary)
    else:
        yield warnings_card(["The run was killed: this is what was known when it ended."])
    if several is not None:
        yield from judge_sections(several, summary)
    yield from _figures(course, comparison, several)
    yield _pictures(results)
    if comparison is not None:
        yield _truth_tables(comparison)
        yield alone_table(comparison)
    if "pairs" in summary:
        yield _reasons(summary)
    yield appendix(results.path)


def _head(results: Results) -> str:
    recording = _recording(results)
    simulated = recording.get("simulated")
    origin = f"<p class='made'>Simulated: {escape(simulated)}</p>" if simulated else ""
    return head(recording["name"], str(recording["path"]), results.summary) + origin


def _verdict(summary: dict[str, Any]) -> str:
    failure = failure_words(summary)
    must_stop = summary.get("judge", {}).get("stops", 0) > 0
    is_misfit = summary["calibration_check"]["verdict"] == "inconsistent"
    is_bad = failure is not None or is_misfit or must_stop
    check = summary["calibration_check"]
    said = [tracking_words(summary), check.get("message") or calibration_words(check)]
    if failure is not None:
        said.insert(0, failure[0].upper() + failure[1:])
    return verdict_card(said, is_bad=is_bad)


def _numbers(summary: dict[str, Any]) -> str:
    shown = [
        (f"{summary['tracked'] + summary['degraded']} of {summary['pairs']}", "pairs with a pose"),
        (length_words(summary), "path"),
        (f"{summary['keyframes']}", "keyframes"),
        (f"{summary['cpu_ms_per_pair']:.1f} ms", "CPU a pair, without decoding"),
        (f"{summary['wall_ms_per_pair']:.1f} ms", "wall clock a pair"),
        (f"{summary['adjustment_cpu_ms']:.0f} ms", "CPU of the last adjustment"),
        (f"{summary['peak_rss_mb']:.0f} MB", "peak memory"),
    ]
    return number_cards(shown)


def _figures(
    course: Course, comparison: Comparison | None, several: Several | None
) -> Iterable[str]:
    if course.is_lost.all():
        yield "<p class='card'>There is no pose to draw.</p>"
        return
    truth_m = None if comparison is None else truth_in_view(course, comparison)
    yield "<h2>Path from above</h2><div class='figures'>"
    pairs_m = None if several is None else paths_in_view(course, several)
    yield figure_card(plots.draw_path(course, truth_m, pairs_m), "path from above", wide=True)
    if comparison is not None:
        yield figure_card(plots.draw_errors(course, comparison), "error over distance")
        if comparison.alone:
            yield figure_card(draw_pair_errors(comparison), "error of each pair alone")
    yield figure_card(plots.draw_height(course, truth_m), "height over distance")
    yield figure_card(plots.draw_speed(course), "speed over time")
    yield figure_card(plots.draw_matches(course), "matches and inliers over time")
    yield figure_card(plots.draw_residuals(course), "residual and y-parallax over time")
    yield figure_card(plots.draw_deviation(course), "uncertainty over time")
    yield "</div>"
    if course.is_lost.any():
        yield "<p class='made'>Shaded: no pose. Dotted: the straight line over a gap.</p>"


def _pictures(results: Results) -> str:
    """Return some of what the left camera saw; results of older versions have no pictures."""
    path = results.path / PICTURES
    if not path.exists():
        return ""
    data = base64.b64encode(path.read_bytes()).decode()
    whose = "cameras" if "judge" in results.summary else "camera"
    return (
        f"<h2>What the left {whose} saw</h2><figure class='card wide'>"
        f"<img alt='pictures over time' src='data:image/jpeg;base64,{data}'></figure>"
    )


def _truth_tables(comparison: Comparison) -> str:
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td class='number'>{escape(value)}</td></tr>"
        for name, value in metric_rows(comparison.metrics)
    )
    return (
        "<h2>Against truth</h2><div class='figures'>"
        f"<div class='card'><table>{rows}</table></div>"
        f"{_segment_table(comparison.metrics.segments)}</div>"
    )


def _segment_table(segments: Sequence[SegmentError]) -> str:
    if not segments:
        return ""
    rows = "".join(
        f"<tr><td class='number'>{segment.length_m:.3g} m</td>"
        f"<td class='number'>{segment.segments}</td>"
        f"<td class='number'>{segment.translation_percent:.3f} %</td>"
        f"<td class='number'>{segment.rotation_deg_m:.5f} &deg;/m</td></tr>"
        for segment in segments
    )
    heads = "".join(
        f"<th class='number'>{name}</th>"
        for name in ("segments of", "count", "translation error", "rotation error")
    )
    return f"<div class='card'><table><thead><tr>{heads}</tr></thead>{rows}</table></div>"


def _reasons(summary: dict[str, Any]) -> str:
    rows = [
        (said, count, reason_words(reason), reason_remedy(reason))
        for status, said in (("lost", "lost"), ("degraded", "uncertain"))
        for reason, count in summary[f"{status}_reasons"].items()
    ]
    rows += [
        ("not readable", 1, f"pair {pair['index']}: {pair['reason']}", "")
        for pair in summary["skipped_pairs"]
    ]
    if not rows:
        return ""
    body = "".join(
        f"<tr><td>{escape(said)}</td><td class='number'>{count}</td><td>{escape(why)}</td>"
        f"<td>{escape(remedy)}</td></tr>"
        for said, count, why, remedy in rows
    )
    return (
        "<h2>What went wrong, and what helps</h2><div class='card'><table><thead><tr><th></th>"
        f"<th class='number'>pairs</th><th>why</th><th>what helps</th></tr></thead>{body}"
        "</table></div>"
    )


def draw_report(out: Path) -> None:
    """Draw the report of a results folder, against the truth where the folder holds one."""
    results = read_results(out)
    comparison = None
    if (out / TRUTH).exists():
        # Truth that meets no pose (all are lost, say) leaves a report without it.
        with contextlib.suppress(InputError):
            comparison = evaluate_results(out)
    write_report(results, comparison)


if __name__ == "__main__":
    sys.exit(run_alone(draw_report))
