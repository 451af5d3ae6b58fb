# SPDX-License-Identifier: Apache-2.0
"""All stereo pairs of a robot: where each sits against the others, and which one looks down.

pairs:
  front: {left: ..., right: ..., right_from_left: ..., robot_from_left: ...}
  down: {left: ..., right: ..., right_from_left: ..., robot_from_left: ...}

Each pair is written as a rig by itself is (`own.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pilotage import StereoRig, Transform
from pilotage.calibration.document import Section, read_documents
from pilotage.calibration.own import own_values, read_own
from pilotage.errors import InputError, did_you_mean

PAIRS = "pairs"
# An optical axis within so much of straight down sees the ground, whatever stands around.
DOWN_WITHIN_DEG = 35.0
DOWN_WORDS = ("down", "nadir", "bottom", "ground")
FORWARD_WORDS = ("front", "forward")  # how the name of a pair that looks ahead begins


@dataclass(frozen=True)
class RigCalibration(Mapping[str, StereoRig]):
    """The stereo rigs of a robot by name, in order; `source` is named in errors."""

    rigs: Mapping[str, StereoRig]
    source: str = "the calibration"

    def __getitem__(self, name: str) -> StereoRig:
        if name not in self.rigs:
            raise missing_pair(self.source, name, self.rigs)
        return self.rigs[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rigs)

    def __len__(self) -> int:
        return len(self.rigs)

    def left_from_left(self, b: str, a: str) -> Transform:
        """Return `b_left_from_a_left`, where the left camera of pair `a` sits in that of `b`.

        InputError names the pair that is missing, or that does not say where it sits.
        """
        return self._robot_from_left(b).inverse() @ self._robot_from_left(a)

    def _robot_from_left(self, name: str) -> Transform:
        robot_from_left = self[name].robot_from_left
        if robot_from_left is None:
            raise InputError(
                f"{self.source}: pair {name!r} does not say where it sits; add its robot_from_left"
            )
        return robot_from_left


def looks_down(name: str, rig: StereoRig) -> bool:
    """Tell whether a pair sees the ground below: by where it sits on the robot, else by its name.

    A name says so where one of its words begins with down, nadir, bottom or ground.
    """
    if rig.robot_from_left is not None:
        up = float(rig.robot_from_left.matrix()[2, 2])  # of the optical axis, in the robot
        return up < -math.cos(math.radians(DOWN_WITHIN_DEG))
    return any(word.startswith(DOWN_WORDS) for word in re.split(r"[^a-z]+", name.lower()))


def has_pairs(section: Section) -> bool:
    """Tell a file of several pairs by its only key."""
    return PAIRS in section


def read_pair(section: Section, name: str | None) -> StereoRig:
    """Return one rig of a file of several pairs, by default the first; the others may be broken.

    InputError names what is wrong, or the pair that is missing.
    """
    named = _named(section)
    names = [str(key) for key in named.values]
    if name is not None and name not in names:
        raise missing_pair(str(section.file), name, names)
    return read_own(named.section(name or names[0]))


def read_pairs(section: Section) -> RigCalibration:
    """Return the rigs of a file of several pairs; InputError names pair and fault."""
    rigs: dict[str, StereoRig] = {}
    for name in map(str, _named(section).values):
        try:
            rigs[name] = read_pair(section, name)
        except InputError as error:
            raise InputError(f"pair {name}: {error}") from None
    return RigCalibration(rigs, str(section.file))


def _named(section: Section) -> Section:
    section.refuse_unknown([PAIRS])
    named = section.section(PAIRS)
    if not named.values:
        raise section.fault(PAIRS, "names no pair; add one, or remove the file")
    return named


def missing_pair(source: str, name: str, names: Iterable[str]) -> InputError:
    """Return the error that names a missing pair, those there are, and the nearest."""
    known = list(names)
    hint = did_you_mean(name, known)
    return InputError(f"{source}: has no pair {name!r}; there are: {', '.join(known)}{hint}")


def load_rigs(path: str | Path) -> RigCalibration | None:
    """Return the rigs of a file of several pairs by name; None where it is of one rig."""
    first = _first_document(Path(path))
    return read_pairs(first) if first is not None and has_pairs(first) else None


def is_of_pairs(path: str | Path) -> bool:
    """Tell whether a calibration file is of several pairs, sound or not."""
    first = _first_document(Path(path))
    return first is not None and has_pairs(first)


def _first_document(file: Path) -> Section | None:
    if not file.is_file() or file.suffix.lower() == ".txt":
        return None
    return read_documents(file)[0]


def save_rigs(rigs: Mapping[str, StereoRig], path: str | Path) -> None:
    """Write the rigs of several pairs; `load_rigs` gives them back exactly."""
    document: dict[str, Any] = {PAIRS: {name: own_values(rig) for name, rig in rigs.items()}}
    header = "# Stereo pairs of a robot. Pixel (0, 0) is the centre of the first pixel.\n"
    text = header + yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
    Path(path).write_text(text, encoding="utf-8")
