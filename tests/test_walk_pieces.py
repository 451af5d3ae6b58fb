# SPDX-License-Identifier: Apache-2.0
"""A walk that falls into pieces: the largest is kept, however well another one would begin."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from program import call

from pilotage import StopFate, Transform
from pilotage.behaviors.walk import place_walk
from pilotage.behaviors.walk_account import RecordedWalk, read_walk
from pilotage.recordings import SinglePicture, open_pictures

FEW, MANY = 3, 5


def walk_in(office: int, path: str, out: Path) -> RecordedWalk:
    done = call(
        "simulate", "office", "--robot", "nao", "--seed", office, "--set", "person=sit",
        "--width", 320, "--path", path, "--stop-every", 8, "-o", out,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return read_walk(open_pictures(out))


def first_stops(walk: RecordedWalk, count: int) -> list[list[SinglePicture]]:
    stops: list[list[SinglePicture]] = [[] for _ in range(count)]
    for stop, picture in zip(walk.stop_of_picture, walk.pictures, strict=True):
        if stop < count:
            stops[stop].append(picture)
    return stops


def one_after_the_other(
    walk: RecordedWalk, a: list[list[SinglePicture]], b: list[list[SinglePicture]]
) -> RecordedWalk:
    """Return a walk through both, as the robot tells it: a step leads from one to the other."""
    here, there = a[-1][0].odom_from_robot, b[0][0].odom_from_robot
    assert here is not None
    assert there is not None
    step = here @ Transform(translation_m=[0.4, 0, 0]) @ there.inverse()
    moved = []
    for stop in b:
        moved.append([])
        for picture in stop:
            assert picture.odom_from_robot is not None
            moved[-1].append(replace(picture, odom_from_robot=step @ picture.odom_from_robot))
    stops = [*a, *moved]
    return replace(
        walk,
        pictures=tuple(picture for stop in stops for picture in stop),
        stop_of_picture=tuple(i for i, stop in enumerate(stops) for _ in stop),
    )


@pytest.mark.parametrize("few_first", [True, False])
def test_the_largest_piece_is_kept(tmp_path: Path, few_first: bool):
    walk = walk_in(3, "straight-1m", tmp_path / "few")
    few = first_stops(walk, FEW)
    many = first_stops(walk_in(14, "straight-2m", tmp_path / "many"), MANY)
    # Less to see: the other piece begins better.
    many = [
        [replace(p, picture=cv2.GaussianBlur(p.picture, (0, 0), 1.5)) for p in stop]
        for stop in many
    ]
    both = (few, many) if few_first else (many, few)
    fates = [stop.fate for stop in place_walk(one_after_the_other(walk, *both)).stops]
    lost, placed = [StopFate.lost] * FEW, [StopFate.placed] * MANY
    assert fates == ([*lost, *placed] if few_first else [*placed, *lost])
