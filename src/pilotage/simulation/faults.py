# SPDX-License-Identifier: Apache-2.0
"""Faults that act on a simulated body: slipping and stuck tracks, pushes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pilotage.errors import InputError
from pilotage.simulation.options import unknown

NANOSECONDS = 1_000_000_000
PUSH_S = 0.1  # an impulse is spread over this time

# name -> what acts, on which side (None: both), the meaning of its size
KINDS: dict[str, tuple[str, str | None, str]] = {
    "slip": ("slip", None, "share of the grip that is lost, 0 to 1"),
    "slip_left": ("slip", "left", "share of the grip that is lost, 0 to 1"),
    "slip_right": ("slip", "right", "share of the grip that is lost, 0 to 1"),
    "stuck_left": ("stuck", "left", "share of the speed that is lost, 0 to 1"),
    "stuck_right": ("stuck", "right", "share of the speed that is lost, 0 to 1"),
    "push_forward": ("push", None, "impulse along x of the robot, N s, -100 to 100"),
    "push_left": ("push", None, "impulse along y of the robot, N s, -100 to 100"),
}
LARGEST_PUSH_N_S = 100.0


@dataclass(frozen=True)
class Fault:
    """One fault of a simulated body, from `onset_s` on the clock of the simulation.

    `size` means what `KINDS` says of the name; `duration_s` is not heeded by a push. InputError
    names what is wrong.
    """

    name: str
    onset_s: float
    size: float
    duration_s: float = math.inf

    def __post_init__(self) -> None:
        if self.name not in KINDS:
            raise InputError(f"fault {self.name!r} {unknown(self.name, KINDS)}")
        kind, _, meaning = KINDS[self.name]
        low, high = (-LARGEST_PUSH_N_S, LARGEST_PUSH_N_S) if kind == "push" else (0.0, 1.0)
        self._check("size", low, high, meaning)
        self._check("onset_s", 0, 1e6, "seconds from the start, 0 or more")
        self._check("duration_s", 0, math.inf, "seconds, 0 or more")

    def is_active(self, time_ns: int) -> bool:
        """Tell whether the fault acts at a time of the simulation."""
        lasts_s = PUSH_S if KINDS[self.name][0] == "push" else self.duration_s
        return self.onset_s <= time_ns / NANOSECONDS < self.onset_s + lasts_s

    def _check(self, key: str, low: float, high: float, meaning: str) -> None:
        value = getattr(self, key)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:
            raise InputError(f"fault {self.name}: {key} = {value!r}: must be {meaning}")


@dataclass
class Disturbance:
    """What the faults do to a body at one moment; left before right.

    `grip` and `speed` are the shares that are left, `push_n` a force (x, y) in the robot's frame.
    """

    grip: tuple[float, float] = (1.0, 1.0)
    speed: tuple[float, float] = (1.0, 1.0)
    push_n: tuple[float, float] = (0.0, 0.0)


CALM = Disturbance()


def disturbance(faults: Sequence[Fault], time_ns: int) -> Disturbance:
    """Return what all faults together do at a time; shares of one kind multiply."""
    active = [fault for fault in faults if fault.is_active(time_ns)]
    if not active:
        return CALM
    shares = {"slip": [1.0, 1.0], "stuck": [1.0, 1.0]}
    push = [0.0, 0.0]
    for fault in active:
        kind, side, _ = KINDS[fault.name]
        if kind == "push":
            push[fault.name == "push_left"] += fault.size / PUSH_S
            continue
        for index, name in enumerate(("left", "right")):
            if side in {None, name}:
                shares[kind][index] *= 1 - fault.size
    grip, speed = shares["slip"], shares["stuck"]
    return Disturbance((grip[0], grip[1]), (speed[0], speed[1]), (push[0], push[1]))


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
    try:
        return Fault(**{str(key): value for key, value in entry.items()})
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
