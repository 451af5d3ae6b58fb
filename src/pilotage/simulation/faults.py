# SPDX-License-Identifier: Apache-2.0
"""Faults by name: one table for bodies, cameras, calibrations and marks; read from YAML."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pilotage.errors import InputError
from pilotage.simulation.options import unknown

NANOSECONDS = 1_000_000_000
PUSH_S = 0.1  # an impulse is spread over this time
ALL = "all"


class Kind(NamedTuple):
    """What a fault of some name acts on, and what its size means and may be."""

    part: str
    low: float
    high: float
    meaning: str
    is_whole: bool = False


BODY, CAMERA, PAIR, CALIBRATION, MARK = "body", "camera", "pair", "calibration", "mark"
GRIP = "share of the grip that is lost, 0 to 1"
TRACK = "share of the speed that is lost, 0 to 1"
PUSH = "impulse along {} of the robot, N s, -100 to 100"
TILT = "degrees the camera is turned {}, -45 to 45"
SHIFT = "mm the camera is moved {}, -200 to 200"
COVER = "share of the mark that leaves hide, 0 to 1"

KINDS: dict[str, Kind] = {
    "slip": Kind(BODY, 0, 1, GRIP),
    "slip_left": Kind(BODY, 0, 1, GRIP),
    "slip_right": Kind(BODY, 0, 1, GRIP),
    "stuck_left": Kind(BODY, 0, 1, TRACK),
    "stuck_right": Kind(BODY, 0, 1, TRACK),
    "push_forward": Kind(BODY, -100, 100, PUSH.format("x")),
    "push_left": Kind(BODY, -100, 100, PUSH.format("y")),
    "blind": Kind(CAMERA, 0, 1, "share of the picture that is covered, 0 to 1"),
    "dirt": Kind(CAMERA, 0, 0.9, "share of the picture that blotches dim, 0 to 0.9"),
    "glare": Kind(CAMERA, 0, 0.4, "share of the picture that is dazzled, 0 to 0.4"),
    "darkness": Kind(CAMERA, 0, 1, "share of the light that is lost, 0 to 1"),
    "blur": Kind(CAMERA, 0, 50, "standard deviation of the blur, pixels, 0 to 50"),
    "tilt_up": Kind(CAMERA, -45, 45, TILT.format("up")),
    "tilt_right": Kind(CAMERA, -45, 45, TILT.format("to its right")),
    "tilt_clockwise": Kind(CAMERA, -45, 45, TILT.format("clockwise about its axis")),
    "shift_right": Kind(CAMERA, -200, 200, SHIFT.format("to its right")),
    "shift_down": Kind(CAMERA, -200, 200, SHIFT.format("down")),
    "shift_forward": Kind(CAMERA, -200, 200, SHIFT.format("forward")),
    "frames_dropped": Kind(CAMERA, 0, 1, "share of the frames that are lost, 0 to 1"),
    "frames_delayed": Kind(CAMERA, 0, 500, "ms the frames come, and are stamped, late, 0 to 500"),
    "swapped": Kind(PAIR, 0, 1, "share of the pairs with left and right swapped, 0 to 1"),
    "out_of_step_frames": Kind(
        PAIR, -10, 10, "frames the right picture is older than the left, -10 to 10", is_whole=True
    ),
    "out_of_step_ms": Kind(PAIR, -50, 50, "ms the right picture is older than the left, -50 to 50"),
    "wrong_base": Kind(CALIBRATION, 0.5, 2, "factor on the written base, 0.5 to 2"),
    "wrong_square": Kind(CALIBRATION, 0.5, 2, "factor on all written distances, 0.5 to 2"),
    "mark_a_covered": Kind(MARK, 0, 1, COVER),
    "mark_b_covered": Kind(MARK, 0, 1, COVER),
}
PUSHES = frozenset({"push_forward", "push_left"})
OF_CAMERAS = frozenset({CAMERA, PAIR, CALIBRATION})


@dataclass(frozen=True)
class Fault:
    """One fault, from `onset_s` on the clock of the simulation, for `duration_s`.

    `size` means what `KINDS` says of the name. `camera` narrows a camera's fault: to a camera
    (`front_left`), a pair (`front`) or a side (`left`). A push does not heed `duration_s`; a
    calibration is wrong from the start to the end. InputError names what is wrong.
    """

    name: str
    onset_s: float
    size: float
    duration_s: float = math.inf
    camera: str = ALL

    def __post_init__(self) -> None:
        if self.name not in KINDS:
            raise InputError(f"fault {self.name!r} {unknown(self.name, KINDS)}")
        kind = KINDS[self.name]
        self._check("size", kind.low, kind.high, kind.meaning)
        if kind.is_whole and self.size % 1:
            raise self._wrong("size", f"a whole number: {kind.meaning}")
        self._check("onset_s", 0, 1e6, "seconds from the start, 0 or more")
        self._check("duration_s", 0, math.inf, "seconds, 0 or more")
        if kind.part == CALIBRATION and (self.onset_s, self.duration_s) != (0, math.inf):
            key = "duration_s" if self.onset_s == 0 else "onset_s"
            raise self._wrong(key, "left out or 0: a calibration is written once, at the start")
        if not isinstance(self.camera, str):
            raise self._wrong("camera", "the name of a camera, a pair or a side")
        if self.camera != ALL and kind.part not in OF_CAMERAS:
            raise self._wrong("camera", f"left out: {self.name} is a fault of no camera")

    def is_active(self, time_ns: int) -> bool:
        """Tell whether the fault acts at a time of the simulation."""
        lasts_s = PUSH_S if self.name in PUSHES else self.duration_s
        return self.onset_s <= time_ns / NANOSECONDS < self.onset_s + lasts_s

    def concerns(self, camera: str) -> bool:
        """Tell whether it is a fault of that camera."""
        return self.camera in {ALL, camera, *camera.split("_", 1)}

    def _check(self, key: str, low: float, high: float, meaning: str) -> None:
        value = getattr(self, key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:
            raise self._wrong(key, meaning)

    def _wrong(self, key: str, meaning: str) -> InputError:
        value = getattr(self, key)
        return InputError(f"fault {self.name}: {key} = {value!r}: must be {meaning}")


def names_of(part: str) -> frozenset[str]:
    """Return the names of all faults of a part: of the body, a camera, a pair, ..."""
    return frozenset(name for name, kind in KINDS.items() if kind.part == part)


def check_faults(
    faults: Sequence[Fault], *, body_faults: Collection[str], cameras: Collection[str]
) -> None:
    """Raise InputError unless a body that suffers `body_faults` and has `cameras` can have all."""
    pairs = {c.removesuffix("_left") for c in cameras if c.endswith("_left")}
    has_pairs = any(f"{pair}_right" in cameras for pair in pairs)
    fitting = {
        name
        for name, kind in KINDS.items()
        if (kind.part == BODY and name in body_faults)
        or kind.part == MARK
        or (kind.part == CAMERA and cameras)
        or (kind.part in {PAIR, CALIBRATION} and has_pairs)
    }
    choices = {ALL, *cameras, *(part for c in cameras for part in c.split("_", 1))}
    for fault in faults:
        if fault.name not in fitting:
            raise InputError(
                f"fault {fault.name!r} does not fit; it {unknown(fault.name, fitting)}"
            )
        if fault.camera not in choices:
            raise InputError(
                f"fault {fault.name}: camera {fault.camera!r} {unknown(fault.camera, choices)}"
            )
        if KINDS[fault.name].part in {PAIR, CALIBRATION} and fault.camera not in pairs | {ALL}:
            raise InputError(
                f"fault {fault.name}: camera {fault.camera!r}: must be a pair: "
                f"{', '.join(sorted(pairs))}"
            )


def read_faults(source: str | Path | Sequence[Mapping[str, object]]) -> list[Fault]:
    """Return the faults of a YAML file (`faults: [{name: slip, onset_s: 2, size: 0.8}]`) or list.

    Raises InputError naming the file, the fault and the key.
    """
    if isinstance(source, str | Path):
        from pilotage.calibration.document import read_documents

        section = read_documents(Path(source))[0]
        section.refuse_unknown(["faults"])
        entries, where = section.value("faults"), f"{source}: "
    else:
        entries, where = source, ""
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        raise InputError(f"{where}faults: must be a list of name, onset_s, size")
    return [_read_fault(entry, f"{where}fault {number}") for number, entry in enumerate(entries)]


def _read_fault(entry: object, where: str) -> Fault:
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} = {entry!r}: must have name, onset_s and size")
    keys = Fault.__dataclass_fields__
    for key in entry:
        if key not in keys:
            raise InputError(f"{where}: key {key!r} {unknown(str(key), keys)}")
    for key in ("name", "onset_s", "size"):
        if key not in entry:
            raise InputError(f"{where}: {key} is missing; add it")
    if not isinstance(entry["name"], str):
        raise InputError(f"{where}: name = {entry['name']!r}: must be a word")
    try:
        return Fault(**{str(key): value for key, value in entry.items()})
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
