# SPDX-License-Identifier: Apache-2.0
"""A walk with stops: where the robot stood, what the room looks like, who moved through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pilotage import StopFate, Transform
from pilotage.behaviors.reconstruct import model_of
from pilotage.behaviors.square_marks import MarkSize, find_marks
from pilotage.models import Model

if TYPE_CHECKING:
    from pilotage import MarkAccount, PlacedStop, ReconstructionConfig, WalkReconstruction
    from pilotage.behaviors.walk_account import RecordedWalk


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedWalk:
    """A walk in metres; the world is the robot's frame at the first stop that has a pose."""

    walk: RecordedWalk
    model: Model
    result: WalkReconstruction

    @property
    def stops(self) -> list[PlacedStop]:
        """Return what became of each stop."""
        return self.result.stops

    @property
    def world_from_stop(self) -> NDArray[np.float64]:
        """Return (S, 4, 4) poses of the robot, on the floor; NaN where it is lost."""
        poses = np.full((len(self.stops), 4, 4), np.nan)
        for i, stop in enumerate(self.stops):
            if stop.world_from_stop is not None:
                poses[i] = stop.world_from_stop.matrix()
        return poses

    @property
    def world_from_torso(self) -> list[Transform | None]:
        """Return the torso's pose at each stop's first picture; None where it is not known."""
        poses: list[Transform | None] = []
        for stop, first in zip(self.stops, self.walk.firsts, strict=True):
            robot, torso = first.robot_from_camera, first.torso_from_camera
            if stop.world_from_stop is None or robot is None or torso is None:
                poses.append(None)
            else:
                poses.append(stop.world_from_stop @ robot @ torso.inverse())
        return poses


def walk_config() -> ReconstructionConfig:
    """Return the defaults of walks: somebody may walk about while the robot looks."""
    from pilotage import ReconstructionConfig

    return ReconstructionConfig.from_dict({"motions": 2})


def place_walk(
    walk: RecordedWalk,
    config: ReconstructionConfig | None = None,
    marks: MarkSize | None = None,
) -> PlacedWalk:
    """Return where a walk's stops are, from its pictures, its joints and its steps together.

    Marks of a known size tell of lengths as well. What cannot be solved is said stop by stop.
    """
    from pilotage import _core

    config = config or walk_config()
    cameras = [walk.camera_names.index(picture.camera) for picture in walk.pictures]
    result = _core.reconstruct_walk(
        pictures=[picture.picture for picture in walk.pictures],
        cameras=list(walk.cameras),
        camera_of_picture=cameras,
        account=walk.account(_marks_of(walk, cameras, marks)),
        config=config,
    )
    model = model_of(walk.names, walk.cameras, cameras, result.model)
    return PlacedWalk(walk=walk, model=model, result=result)


def _marks_of(walk: RecordedWalk, cameras: list[int], size: MarkSize | None) -> MarkAccount | None:
    if size is None:
        return None
    greys = [picture.picture for picture in walk.pictures]
    return find_marks(greys, walk.cameras, cameras, size)


def what_became(stops: list[PlacedStop]) -> list[str]:
    """Return lines on the stops that are not where the steps led, stretch by stretch.

    None holds a semicolon: those part the lines of a verdict.
    """
    lines: list[str] = []
    lost: list[int] = []
    for number, stop in enumerate([*stops, None]):
        if stop is not None and stop.fate == StopFate.lost:
            lost.append(number)
            continue
        if lost:
            lines.append(_lost_words(lost, len(stops)))
            lost = []
        if stop is not None and stop.fate == StopFate.carried:
            lines.append(
                f"stop {number}: the robot did not walk there from stop {number - 1} but was"
                " carried, or slipped, and found where it is by what it sees"
            )
    return lines


def _lost_words(lost: list[int], count: int) -> str:
    which = f"stop {lost[0]}" if len(lost) == 1 else f"stops {lost[0]} to {lost[-1]}"
    if len(lost) == count:
        return (
            "no stop could be placed: too little is seen twice (stop more often, or look more ways)"
        )
    return (
        f"{which}: lost, what is seen there could not be found in the rest (the robot was carried,"
        " or stops are missing between)"
    )
