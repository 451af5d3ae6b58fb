# SPDX-License-Identifier: Apache-2.0
"""Options of a world: a frozen dataclass is the only home of names, defaults and ranges."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from pilotage.errors import InputError, nearest

Options = TypeVar("Options")


def ranged(default: float, low: float, high: float) -> Any:
    """Return a field for a number from `low` to `high`."""
    return dataclasses.field(default=default, metadata={"low": low, "high": high})


def chosen(default: str, choices: Sequence[str]) -> Any:
    """Return a field for one of `choices`."""
    return dataclasses.field(default=default, metadata={"choices": tuple(choices)})


def check_seed(seed: object) -> int:
    """Return a seed as a whole number; InputError when it is none or negative."""
    try:
        whole = operator.index(seed)  # type: ignore[arg-type]
    except TypeError:
        whole = -1
    if whole < 0 or isinstance(seed, bool):
        raise InputError(f"seed = {seed!r}: must be a whole number, 0 or more")
    return whole


def read_options(kind: type[Options], values: Mapping[str, object], where: str) -> Options:
    """Return the options; InputError names `where`, the value and what is allowed."""
    fields = {f.name: f for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    read = {}
    for key, value in values.items():
        if key not in fields:
            raise InputError(f"{where}: option {key!r} {unknown(key, fields)}")
        read[key] = _check(f"{where}: {key}", value, fields[key])
    return kind(**read)


def check_options(options: Any, where: str) -> None:
    """Raise InputError unless each field of a dataclass made in Python lies within its range."""
    for field in dataclasses.fields(options):
        _check(f"{where}: {field.name}", getattr(options, field.name), field)


def unknown(name: str, known: Collection[str]) -> str:
    """Return the end of a message about a name that is none of `known`."""
    if not known:
        return "is unknown; there are none here"
    near = nearest(name, known)
    meant = f"did you mean {near!r}? Use" if near else "use"
    return f"is unknown; {meant} one of {', '.join(sorted(known))}"


def _check(where: str, value: object, field: dataclasses.Field[Any]) -> object:
    limits = field.metadata
    if "choices" in limits:
        if value not in limits["choices"]:
            allowed = ", ".join(limits["choices"])
            raise InputError(f"{where} = {value!r}: must be one of {allowed}")
        return value
    if isinstance(field.default, str):
        if not isinstance(value, str):
            raise InputError(f"{where} = {value!r}: must be a word")
        return value
    number = _as_number(value)
    whole = isinstance(field.default, int)
    if number is None or not limits["low"] <= number <= limits["high"] or (whole and number % 1):
        kind = "a whole number" if whole else "a number"
        raise InputError(f"{where} = {value!r}: must be {kind} {_range(limits)}")
    return int(number) if whole else number


def _as_number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _range(limits: Mapping[str, float]) -> str:
    return f"from {limits['low']:g} to {limits['high']:g}"
