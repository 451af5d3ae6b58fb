# SPDX-License-Identifier: Apache-2.0
"""judge.csv: what each stereo pair says at each instant, and which are believed.

A row for each instant and pair; the columns are told in docs/results_folder.md.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pilotage.errors import InputError
from pilotage.pose_files import read_text

if TYPE_CHECKING:
    from pilotage import JointResult, StereoRig

DIFFERENCE_COLUMNS = ("dx_m", "dy_m", "dz_m", "rx_rad", "ry_rad", "rz_rad")
LEVER_COLUMNS = ("lever_x_m", "lever_y_m", "lever_z_m")
JUDGE_COLUMNS = (
    *("timestamp_ns", "status", "segment", "believed", "pair", "belief", "reason", "m_q_px"),
    *DIFFERENCE_COLUMNS,
    *LEVER_COLUMNS,
    "chi_square",
)
BETWEEN_NAMES = "+"


@dataclass(frozen=True, slots=True)
class JudgeRow:
    """One pair at one instant; `difference` and `chi_square` are NaN where nothing was compared.

    `difference` is the pair's motion over the judge's window against that of the others, in the
    robot's axes: metres, radians. `lever_m` is where by calibration its left camera sits from that
    of the first pair, in the robot's axes.
    """

    timestamp_ns: int
    status: str
    segment: int
    believed: tuple[str, ...]
    pair: str
    belief: str
    reason: str
    m_q_px: float
    difference: tuple[float, ...]
    lever_m: tuple[float, ...]
    chi_square: float


def judge_header() -> str:
    """Return the first line of judge.csv."""
    return ",".join(JUDGE_COLUMNS) + "\n"


def levers_m(rigs: Mapping[str, StereoRig]) -> dict[str, tuple[float, ...]]:
    """Return where each pair's left camera sits from the first pair's, in the robot's axes."""
    places = {
        name: rig.robot_from_left.translation_m if rig.robot_from_left else None
        for name, rig in rigs.items()
    }
    first = next(iter(places.values()))
    return {
        name: (math.nan,) * 3 if place is None or first is None else tuple((place - first).tolist())
        for name, place in places.items()
    }


def judge_lines(result: JointResult, status: str, levers: Mapping[str, tuple[float, ...]]) -> str:
    """Return the lines of an instant; the keys of `levers` name the pairs in order.

    `status` is that of the joint pose, as poses.csv has it.
    """
    names = list(levers)
    verdicts = list(zip(names, result.pairs, strict=True))
    believed = BETWEEN_NAMES.join(name for name, v in verdicts if v.belief.name == "joined")
    lines = []
    for name, verdict in verdicts:
        compared = verdict.chi_square > 0
        cells = [str(result.timestamp_ns), status, str(result.segment), believed]
        cells += [name, verdict.belief.name, verdict.reason.name]
        m_q_px = verdict.m_q if verdict.m_q > 0 else math.nan
        difference = verdict.difference.tolist() if compared else [math.nan] * 6
        chi_square = verdict.chi_square if compared else math.nan
        cells += [_cell(value) for value in (m_q_px, *difference, *levers[name], chi_square)]
        lines.append(",".join(cells) + "\n")
    return "".join(lines)


def _cell(value: float) -> str:
    return f"{value:.6g}" if math.isfinite(value) else ""


def read_judge_table(path: Path) -> list[JudgeRow]:
    """Read judge.csv, in order of time and pairs; InputError names file and line."""
    text = read_text(path)
    rows = csv.reader(io.StringIO(text[: text.rfind("\n") + 1]))
    if tuple(next(rows, ())) != JUDGE_COLUMNS:
        raise InputError(f"{path}: the first line does not name the columns of judge.csv")
    table = []
    for number, row in enumerate(rows, start=2):
        try:
            table.append(_parse(dict(zip(JUDGE_COLUMNS, row, strict=True))))
        except ValueError as error:
            raise InputError(f"{path}, line {number}: not a line of judge.csv") from error
    return table


def _parse(cells: Mapping[str, str]) -> JudgeRow:
    return JudgeRow(
        timestamp_ns=int(cells["timestamp_ns"]),
        status=cells["status"],
        segment=int(cells["segment"]),
        believed=tuple(filter(None, cells["believed"].split(BETWEEN_NAMES))),
        pair=cells["pair"],
        belief=cells["belief"],
        reason=cells["reason"],
        m_q_px=_number(cells["m_q_px"]),
        difference=_numbers(cells, DIFFERENCE_COLUMNS),
        lever_m=_numbers(cells, LEVER_COLUMNS),
        chi_square=_number(cells["chi_square"]),
    )


def _numbers(cells: Mapping[str, str], columns: Sequence[str]) -> tuple[float, ...]:
    return tuple(_number(cells[column]) for column in columns)


def _number(cell: str) -> float:
    return float(cell or "nan")


def judge_text(
    results: Iterable[JointResult],
    statuses: Iterable[str],
    levers: Mapping[str, tuple[float, ...]],
) -> str:
    """Return the whole content of judge.csv."""
    instants = zip(results, statuses, strict=True)
    return judge_header() + "".join(judge_lines(result, said, levers) for result, said in instants)
