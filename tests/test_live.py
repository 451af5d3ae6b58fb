# SPDX-License-Identifier: Apache-2.0
"""The view of a drive in a terminal: a map that shows the way, and lines where there is none."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from rich.console import Console

from pilotage import Transform
from pilotage.behaviors.recorder import Moment
from pilotage.cli import live
from pilotage.cli.braille import BLANK, BrailleMap, arrow
from pilotage.cli.live import LineView, MapView, make_drive_view
from pilotage.simulation import parse_path
from pilotage.simulation.scene import yaw_quaternion


def moment(second: float, x_m: float, y_m: float, yaw_rad: float = 0.0) -> Moment:
    return Moment(
        time_ns=round(second * 1e9),
        shots=round(second * 5),
        share_done=second / 25,
        world_from_robot=Transform(
            translation_m=[x_m, y_m, 0.0], quaternion_wxyz=yaw_quaternion(yaw_rad)
        ),
    )


def shown(view: MapView, last: Moment) -> str:
    console = Console(file=io.StringIO(), width=100, record=True)
    console.print(view.view(last))
    return console.export_text()


def test_dots_lie_where_the_points_do() -> None:
    drawn = BrailleMap(np.array([[0.0, 0.0], [7.5, 7.5]]), columns=10, rows=5)
    assert drawn.metres_per_dot == pytest.approx(0.5)
    cells = drawn.cells(np.array([[0.0, 0.0], [7.4, 7.4], [99.0, 0.0]]))
    assert cells[4, 1] == 0x02  # third dot from the left, third row from the bottom
    assert cells[0, 8] != 0
    assert np.count_nonzero(cells) == 2
    assert drawn.cell_of(np.array([0.0, 0.0])) == (4, 1)
    assert drawn.cell_of(np.array([0.0, 99.0])) is None


def test_arrows_point_ahead() -> None:
    headings = [0, 90, 180, -90, 45, 359]
    assert "".join(arrow(math.radians(heading)) for heading in headings) == "→↑←↓↗→"


@pytest.mark.parametrize("path", ["closed-10m", "straight-5m", "eight-30m"])
def test_the_map_shows_both_paths_and_the_figures(path: str) -> None:
    planned = parse_path(path)
    console = Console(file=io.StringIO(), width=100, force_terminal=True)
    with MapView("yard", planned.points, planned.length_m, "pairs", console) as view:
        for number, point in enumerate(planned.points[: len(planned.points) // 2 : 10]):
            view.on_moment(moment(number / 2, *point.tolist(), math.pi / 2))
        text = shown(view, moment(number / 2, *point.tolist(), math.pi / 2))
    assert text.count("↑") == 1
    assert sum(ord(character) > BLANK for character in text) > 30
    assert f"of {planned.length_m:.1f} m" in text
    assert "0.40 m/s" in text
    assert f"simulated {number / 2:.1f} s" in text
    assert f"pairs {round(number / 2 * 5)}" in text
    assert max(map(len, text.splitlines())) <= 80
    assert "yard" in console.file.getvalue()  # type: ignore[attr-defined]


def test_lines_come_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    now = iter([0.0, 1.0, 6.0, 7.0])
    monkeypatch.setattr(live.time, "monotonic", lambda: next(now))
    with make_drive_view("yard", np.zeros((2, 2)), 1.0, "looks") as view:
        assert isinstance(view, LineView)
        for second in (5, 10, 15):
            view.on_moment(moment(second, 0.0, 0.0))
    said = capsys.readouterr().err.splitlines()
    assert said == ["yard: 40 % of the way, 50 looks, 8.3 looks/s"]
