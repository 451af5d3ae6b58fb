# SPDX-License-Identifier: Apache-2.0
"""What a summary says, in plain words: for the terminal and for the report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pilotage.reasons import reason_remedy, reason_words, some_names

if TYPE_CHECKING:
    from pilotage.evaluation.evaluate import Comparison
    from pilotage.evaluation.metrics import Metrics


# More names than this on a line tell no more; summary.json has them all.
LISTED = 12


def model_words(summary: Mapping[str, Any]) -> str:
    """Return one line on how much of a folder of pictures became a model."""
    if not summary["posed"]:
        return f"No model: {summary['verdict']}"
    if "stops" in summary:
        return _walk_words(summary)
    words = (
        f"{summary['posed']} of {summary['pictures']} pictures placed, {summary['points']} points,"
        f" residuals {summary['rms_px']:.2f} px rms, {summary['wall_s']:.1f} s"
    )
    if "lengths" in summary:
        lengths = summary["lengths"]
        sigma = lengths["sigma"] / lengths["factor"]
        words += f"; lengths known to {100 * sigma:.1f} % by {lengths['sources'][0]['source']}"
    if summary.get("focal_px") is not None:
        words += (
            f"; focal length {summary['focal_px']:.1f} ± {summary['focal_sigma_px']:.1f} px,"
            f" {summary['fov_deg']:.2f} degrees wide"
        )
    return words


def _walk_words(summary: Mapping[str, Any]) -> str:
    truth, lengths = summary["truth"], summary["lengths"]
    words = (
        f"{summary['stops_placed']} of {summary['stops']} stops placed"
        f" ({summary['posed']} pictures, {summary['points']} points), lengths known to"
        f" {100 * lengths['sigma']:.1f} %, {sum(summary['set_aside'])} features set aside that"
        f" contradict the room, {summary['wall_s']:.1f} s"
    )
    if truth is not None:
        words += (
            f"; against the truth: last stop off by {1e3 * truth['home_m']:.1f} mm and"
            f" {truth['home_deg']:.2f} degrees, largest {1e3 * truth['largest_m']:.1f} mm"
        )
    return words


def missing_lines(without_pose: Mapping[str, str]) -> list[str]:
    """Return a line for each reason: which pictures have no pose for it, and what helps."""
    lines = []
    for reason in dict.fromkeys(without_pose.values()):
        names = [name for name, said in without_pose.items() if said == reason]
        lines.append(f"{some_names(names, LISTED)}: {reason}")
    return lines


def tracking_words(summary: Mapping[str, Any]) -> str:
    """Return one sentence on how much was tracked, over which way."""
    posed = summary["tracked"] + summary["degraded"]
    words = f"Tracked {posed} of {summary['pairs']} pairs over {length_words(summary)}"
    parts = [
        f"{summary[key]} {said}"
        for key, said in (
            ("degraded", "of them uncertain"),
            ("lost", "lost"),
            ("skipped", "not readable"),
        )
        if summary[key]
    ]
    return f"{words} ({', '.join(parts)})." if parts else f"{words}."


def length_words(summary: Mapping[str, Any]) -> str:
    """Return the length of the path with a unit that suits it."""
    length_m = summary["path_length_m"]
    return f"{length_m:.1f} m" if length_m >= 10 else f"{length_m:.3f} m"


def calibration_words(check: Mapping[str, Any]) -> str:
    """Return what the pictures say of the calibration, its size, significance and remedy."""
    verdict = check["verdict"]
    if verdict == "consistent":
        return f"The calibration fits the pictures: {_found(check)}."
    if verdict == "inconsistent":
        remedy = reason_remedy("calibration_does_not_fit")
        return f"The calibration does not fit the pictures: {_found(check)}. {remedy}"
    return (
        "The calibration could not be checked: this motion does not show whether it fits. Move"
        " forwards past things that are first far and then near."
    )


def _found(check: Mapping[str, Any]) -> str:
    parts = []
    for key, said in (
        ("right_x_offset", "the right picture is off sideways by"),
        ("y_parallax", "up or down by"),
    ):
        value, sigma = check[f"{key}_px"], check[f"{key}_sigma_px"]
        errors = check[f"{key}_significance"]
        if value is None or sigma is None:
            continue
        times = "" if errors is None else f" ({errors:.1f} standard errors)"
        parts.append(f"{said} {value:+.3f} ± {sigma:.3f} px{times}")
    return " and ".join(parts)


def failure_words(summary: Mapping[str, Any]) -> str | None:
    """Return why nothing was tracked and what to do; None where something was."""
    posed = summary["tracked"] + summary["degraded"]
    # The first pose is given by choice of the world; alone it tells of no motion.
    if posed > 1 or (posed == 1 and summary["pairs"] == 1):
        return None
    if summary["pairs"] and summary["skipped"] == summary["pairs"]:
        first = summary["skipped_pairs"][0]
        return f"no pair could be read; the first (index {first['index']}): {first['reason']}"
    reasons = summary["lost_reasons"]
    if not reasons:
        return "nothing was tracked: too few pairs could be read"
    reason = next(iter(reasons))
    return f"nothing was tracked: {reason_words(reason)}. {reason_remedy(reason)}"


def alone_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """Return a row for the joint trajectory and for each stereo pair alone.

    Name, pairs with a pose, error at the end, rms and largest distance after alignment.
    """
    rows: list[tuple[str, ...]] = []
    for name, one in (("joined", comparison), *comparison.alone.items()):
        if one is None:
            rows.append((name, "none to compare", "", "", ""))
            continue
        metrics = one.metrics
        end = f"{metrics.end_error_percent:.3f} %"
        if not math.isfinite(metrics.end_error_percent):
            end = f"{metrics.end_error_m:.4f} m"
        posed = f"{metrics.pairs - metrics.lost} of {metrics.pairs}"
        ate = (f"{1e3 * metrics.ate_rmse_m:.2f} mm", f"{1e3 * metrics.ate_max_m:.2f} mm")
        rows.append((name, posed, end, *ate))
    return rows


def metric_rows(metrics: Metrics) -> list[tuple[str, str]]:
    """Return name and value of each figure, with its unit; what could not be told is left out."""
    rows = [
        ("pairs compared", f"{metrics.compared} of {metrics.pairs}"),
        ("pairs without pose", str(metrics.lost)),
        ("length of the truth", f"{metrics.truth_length_m:.3f} m"),
        (f"ATE, rms (alignment {metrics.alignment})", f"{metrics.ate_rmse_m:.4f} m"),
        ("ATE of the length", f"{metrics.ate_percent_of_length:.3f} %"),
        ("ATE, median", f"{metrics.ate_median_m:.4f} m"),
        ("ATE, largest", f"{metrics.ate_max_m:.4f} m"),
        ("translation over segments", f"{metrics.translation_percent:.3f} %"),
        ("rotation over segments", f"{metrics.rotation_deg_m:.5f} deg/m"),
        ("a step, rms", f"{1e3 * metrics.rpe_translation_rmse_m:.2f} mm"),
        ("a step, median", f"{1e3 * metrics.rpe_translation_median_m:.2f} mm"),
        ("a step's rotation, rms", f"{metrics.rpe_rotation_rmse_deg:.4f} deg"),
        ("end, from the first pose", f"{metrics.end_error_m:.4f} m"),
        ("end, of the length", f"{metrics.end_error_percent:.3f} %"),
        ("largest, from the first pose", f"{metrics.origin_error_max_m:.4f} m"),
        ("estimated size / true size", f"{metrics.scale:.5f}"),
    ]
    if metrics.consistency is not None:
        rows += [
            ("NEES, mean (6 if the truth is exact)", f"{metrics.consistency.mean_nees:.2f}"),
            (
                "NEES within 99 % (if the truth is exact)",
                f"{100 * metrics.consistency.share_within_99_percent:.1f} %",
            ),
        ]
    return [(name, value) for name, value in rows if not value.startswith("nan")]
