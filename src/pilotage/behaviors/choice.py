# SPDX-License-Identifier: Apache-2.0
"""Which stereo pairs of a recording are used, how each is tracked, and which cannot be used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from pilotage.calibration.rig_calibration import FORWARD_WORDS, is_of_pairs, looks_down
from pilotage.config import UserConfig
from pilotage.errors import InputError
from pilotage.recordings.recording import OpenedPairs, Recording, open_pairs, open_recording

if TYPE_CHECKING:
    from pilotage import OdometryConfig, StereoOdometry

NOT_PLACED = "nothing says where it sits on the robot; add its robot_from_left"


class Use(StrEnum):
    """Whose trajectory is wanted of a recording with several stereo pairs."""

    forward = "forward"
    down = "down"
    paper = "paper"
    joint = "joint"


@dataclass(frozen=True)
class Source:
    """A stereo pair that is used: its pictures and an odometry made for it."""

    name: str
    recording: Recording
    config: OdometryConfig
    is_downward: bool

    def make_odometry(self) -> StereoOdometry:
        """Return a new odometry; InputError where the rig cannot be one."""
        from pilotage import StereoOdometry

        try:
            return StereoOdometry(rig=self.recording.rig, config=self.config)
        except ValueError as error:
            raise InputError(
                f"{self.recording.path}: pair {self.name}: {error}; calibrate it again"
            ) from None


@dataclass(frozen=True)
class Choice:
    """The pairs that are used, the one that looks ahead first, and why others are not.

    `use` is joint or paper where several are joined.
    """

    sources: Sequence[Source]
    use: Use
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_joint(self) -> bool:
        """Tell whether trajectories are to be compared: of a single one there is nothing to."""
        return len(self.sources) > 1

    def warnings(self) -> list[str]:
        """Return a sentence for each pair that cannot be used."""
        going = ", ".join(source.name for source in self.sources)
        return [
            f"The stereo pair {name} is left out: {why}. Going on with {going}."
            for name, why in self.left_out.items()
        ]


def choose(  # noqa: PLR0913, all by name
    path: Path,
    *,
    config: UserConfig,
    pair: str | None = None,
    use: Use | None = None,
    calibration: Path | None = None,
    rate_hz: float | None = None,
) -> Choice:
    """Return which pairs of the recording at `path` are used.

    `pair` takes one by name. Without `use` all are joined that say where they sit on the robot.
    InputError where nothing can be used, or not what is wanted.
    """
    if pair is not None and use is not None:
        raise InputError(f"--pair {pair} and --use {use.value}: give one of them")
    if pair is not None or _is_for_one_pair(path, calibration, use):
        opened = open_recording(path, calibration=calibration, rate_hz=rate_hz, pair=pair)
        name = str(getattr(opened, "pair", "stereo"))
        config.check_pairs(getattr(opened, "pairs", [name]))
        down = use is Use.down or looks_down(name, opened.rig)
        return _one(_source(name, opened, config, is_downward=down))
    pairs = open_pairs(path, calibration=calibration, rate_hz=rate_hz)
    config.check_pairs(pairs.names)
    return _chosen_of(path, pairs, config, use)


def _is_for_one_pair(path: Path, calibration: Path | None, use: Use | None) -> bool:
    """Tell whether the calibration given is that of a single pair: it speaks for no other one."""
    if calibration is None or is_of_pairs(calibration):
        return False
    if use in {Use.joint, Use.paper}:
        raise InputError(
            f"{calibration}: is of one stereo pair, and --use {use.value} needs that of each; write"
            " `pairs: {front: {...}, down: {...}}` (docs/recordings.md)"
        )
    return True


def _chosen_of(path: Path, pairs: OpenedPairs, config: UserConfig, use: Use | None) -> Choice:
    left_out = dict(pairs.left_out)
    sources = []
    for name, recording in pairs.sound.items():
        down = looks_down(name, recording.rig) or (use is Use.down and len(pairs.names) == 1)
        source = _source(name, recording, config, is_downward=down)
        try:
            source.make_odometry()
        except InputError as error:
            left_out[name] = str(error)
        else:
            sources.append(source)
    if not sources:
        whys = "; ".join(f"{name}: {why}" for name, why in left_out.items())
        raise InputError(whys if len(left_out) == 1 else f"{path}: no pair can be used: {whys}")
    if use in {Use.forward, Use.down}:
        return _looking(path, sources, left_out, use)
    placed = [source for source in sources if source.recording.rig.robot_from_left is not None]
    if use is None and len(placed) < len(sources):
        return replace(_one(_ahead(sources) or sources[0]), left_out=left_out)
    if use is not None and len(pairs.names) == 1:
        raise InputError(f"{path}: holds one stereo pair; --use {use.value} compares several")
    left_out |= {source.name: NOT_PLACED for source in sources if source not in placed}
    if not placed:
        raise InputError(f"{path}: {', '.join(left_out)}: {NOT_PLACED}")
    if len(placed) == 1:
        return replace(_one(placed[0]), left_out=left_out)
    return Choice(placed, use or Use.joint, left_out)


def _looking(
    path: Path, sources: Sequence[Source], left_out: Mapping[str, str], use: Use
) -> Choice:
    """Return the one pair that looks ahead, or down."""
    down = next((source for source in sources if source.is_downward), None)
    found = _ahead(sources) if use is Use.forward else down
    if found is None:
        names = ", ".join(source.name for source in sources)
        whys = "".join(f"; {name} cannot be used: {why}" for name, why in left_out.items())
        raise InputError(
            f"{path}: --use {use.value}: no stereo pair looks that way; there are: {names}{whys}"
        )
    return _one(found)


def _ahead(sources: Sequence[Source]) -> Source | None:
    """Return the pair that is called front, else the one whose axis is nearest to straight on."""
    ahead = [source for source in sources if not source.is_downward]
    named = [source for source in ahead if source.name.startswith(FORWARD_WORDS)]
    if named or not ahead:
        return named[0] if named else None

    def forwardness(source: Source) -> float:
        placed = source.recording.rig.robot_from_left
        return -2.0 if placed is None else float(placed.matrix()[0, 2])

    return max(ahead, key=forwardness)


def _source(name: str, recording: Recording, config: UserConfig, *, is_downward: bool) -> Source:
    used = config.odometry(name, is_downward=is_downward)
    return Source(name, recording, used, is_downward)


def _one(source: Source) -> Choice:
    return Choice([source], Use.down if source.is_downward else Use.forward)
