# SPDX-License-Identifier: Apache-2.0
"""What moves by itself while a camera exposes draws a streak, and bends row by row."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pilotage import Camera, Transform
from pilotage.simulation import Simulation
from pilotage.simulation.pictures import Pictures
from pilotage.simulation.views import View
from pilotage.simulation.world import World

Array = NDArray[np.float64]
LENS = Camera(width_px=320, height_px=240, fx_px=290, fy_px=290, cx_px=159.5, cy_px=119.5)
SPEED_M_S = 3.0
# The eye looks down on a dark board that crosses white ground two metres below.
WORLD = World(
    "crossing",
    0,
    f"""<mujoco>
    <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>
    <custom><numeric name="start" data="0 -30 0"/>
    <text name="walk:board" data="speed_m_s={SPEED_M_S} points_m=-1,0 3,0 3,-9"/></custom>
    <worldbody><geom name="ground" type="plane" size="0 0 1" pos="0 0 -1" rgba="1 1 1 1"/>
    <body name="board" mocap="true">
    <geom type="box" size="0.1 2 0.001" rgba=".1 .1 .1 1" contype="0" conaffinity="0"/></body>
    <camera name="eye" pos="0 0 2" xyaxes="1 0 0 0 1 0" fovy="45"/></worldbody></mujoco>""",
)
NOW_NS, MIDDLE_NS = 400_000_000, 340_000_000
BOARD_M = -1 + SPEED_M_S * MIDDLE_NS * 1e-9  # its middle, in the middle of the exposure


@pytest.fixture(scope="module")
def eye() -> View:
    simulation = Simulation(WORLD, "rover")
    pictures = Pictures(simulation)
    simulation.advance(NOW_NS)
    return View(simulation, pictures, "eye", LENS)


def look(eye: View, exposure_s: float, readout_s: float = 0.0) -> Array:
    render = eye.look(
        middle_ns=MIDDLE_NS,
        exposure_s=exposure_s,
        readout_s=readout_s,
        channels=1,
        built_from_camera=Transform(),
    )
    return np.asarray(render(1), float)


def column_of(x_m: float) -> float:
    return LENS.cx_px + LENS.fx_px * x_m / 2


def test_a_streak_is_as_long_as_the_way_over_the_exposure(eye: View):
    row = look(eye, 0.03)[120]
    light, dark = row[5], look(eye, 0.0)[120].min()
    assert dark < 0.2 * light
    way_m = 0.03 * SPEED_M_S
    for side_m in (-0.1, 0.1):
        # Over its streak an edge is there for a share of the time that grows evenly.
        begin, end = (column_of(BOARD_M + side_m + part * way_m) for part in (-0.5, 0.5))
        columns = np.arange(int(begin) + 1, int(end))
        assert len(columns) > 10
        covered = (light - row[columns]) / (light - dark)
        share = (columns - begin) / (end - begin)
        np.testing.assert_allclose(covered, 1 - share if side_m > 0 else share, atol=0.08)


def test_rows_are_read_one_after_another(eye: View):
    picture = look(eye, 0.001, readout_s=0.04)
    dark = picture < 0.5 * picture[0, 5]
    middles = np.array([np.flatnonzero(row).mean() for row in dark])
    rows = np.arange(len(middles))
    slope, offset = np.polyfit(rows, middles, 1)
    per_row_px = LENS.fx_px / 2 * SPEED_M_S * 0.04 / (len(rows) - 1)
    assert slope == pytest.approx(per_row_px, rel=0.02)
    assert slope * rows.mean() + offset == pytest.approx(column_of(BOARD_M), abs=0.2)


def test_without_exposure_it_is_where_it_was_then(eye: View):
    row = look(eye, 0.0)[120]
    dark = np.flatnonzero(row < 0.5 * row[5])
    assert dark.mean() == pytest.approx(column_of(BOARD_M), abs=0.6)
