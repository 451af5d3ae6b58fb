# SPDX-License-Identifier: Apache-2.0
"""YAML as it is found in the wild, and access to its values with errors that name them."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pilotage.errors import InputError

LARGEST_FILE_BYTES = 256 * 1024
LARGEST_NUMBER = 1e12  # beyond any pixel, metre or lens coefficient; guards later arithmetic


class _Loader(yaml.SafeLoader):
    """YAML 1.1, with OpenCV's matrices as mappings and repeated keys refused."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key.value, str) and key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {reprlib.repr(key.value)} appears twice", node.start_mark
                )
            if isinstance(key.value, str):
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)


def _construct_opencv_matrix(loader: _Loader, node: yaml.Node) -> dict[Any, Any]:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(
            None, None, "an opencv-matrix must be a mapping", node.start_mark
        )
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _construct_opencv_matrix)


def read_text(file: Path) -> str:
    """Return the text of a small file; InputError says why it cannot be had."""
    try:
        with file.open("rb") as stream:
            data = stream.read(LARGEST_FILE_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}); check the path") from error
    if len(data) > LARGEST_FILE_BYTES:
        raise InputError(
            f"{file}: larger than {LARGEST_FILE_BYTES} bytes, so not a calibration; "
            "give the calibration's own file"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{file}: not a text file (byte {error.start}); give a text file"
        ) from None


def read_documents(file: Path) -> list[Section]:
    """Return the mappings of a YAML file, one a document; InputError when there is none."""
    lines = read_text(file).splitlines()
    if lines and lines[0].startswith("%YAML"):
        lines[0] = ""  # OpenCV writes "%YAML:1.0", which no YAML reader accepts
    try:
        documents = list(yaml.load_all("\n".join(lines), Loader=_Loader))
    except yaml.YAMLError as error:
        first_line = " ".join(str(error).split())
        raise InputError(f"{file}: not valid YAML ({first_line}); correct it") from None
    except (ValueError, TypeError, OverflowError, RecursionError, AttributeError) as error:
        raise InputError(
            f"{file}: holds a value YAML cannot represent ({error}); correct it"
        ) from None
    mappings = [d for d in documents if isinstance(d, dict)]
    if not mappings:
        raise InputError(f"{file}: holds no 'key: value' lines; give a calibration")
    return [Section(file, "", mapping) for mapping in mappings]


@dataclass(frozen=True)
class Section:
    """One mapping of a calibration file; `where` is its dotted place in the file."""

    file: Path
    where: str
    values: Mapping[Any, Any]

    def __contains__(self, key: object) -> bool:
        return key in self.values

    def keys(self) -> Iterator[str]:
        return (str(key) for key in self.values)

    def fault(self, key: str, problem: str) -> InputError:
        """Return the error that names file, key and value."""
        place = f"{self.where}.{key}" if self.where else key
        value = f" = {reprlib.repr(self.values[key])}" if key in self.values else ""
        return InputError(f"{self.file}: {place}{value}: {problem}")

    def refuse_unknown(self, known: Iterable[str]) -> None:
        """Refuse keys that nothing would read: they hide typing errors."""
        known = set(known)
        for key in self.values:
            if key not in known:
                raise InputError(
                    f"{self.file}: {self.where + '.' if self.where else ''}{reprlib.repr(key)}: "
                    f"unknown key; remove it, or use one of {', '.join(sorted(known))}"
                )

    def first_of(self, *keys: str) -> str:
        """Return the first of `keys` that is there; InputError naming the first when none is."""
        for key in keys:
            if key in self.values:
                return key
        raise self.fault(keys[0], "missing; add it")

    def value(self, key: str) -> Any:
        if key not in self.values:
            raise self.fault(key, "missing; add it")
        return self.values[key]

    def section(self, key: str) -> Section:
        value = self.value(key)
        if not isinstance(value, dict):
            raise self.fault(key, "must be a mapping of keys to values")
        return Section(self.file, f"{self.where}.{key}" if self.where else key, value)

    def text(self, key: str) -> str:
        value = self.value(key)
        if not isinstance(value, str):
            raise self.fault(key, "must be a word")
        return value.strip()

    def number(self, key: str) -> float:
        """Return a finite number; YAML 1.1 takes 1e-3 for a word, this does not."""
        return self._number(key, self.value(key))

    def count(self, key: str, *, low: int, high: int) -> int:
        number = self.number(key)
        if number != int(number) or not low <= number <= high:
            raise self.fault(key, f"must be a whole number from {low} to {high}")
        return int(number)

    def numbers(self, key: str, counts: Sequence[int]) -> list[float]:
        """Return a list of numbers, flat, nested or an OpenCV or ROS matrix, of allowed length."""
        value = self.value(key)
        if isinstance(value, dict):
            value = value.get("data")
        flat = self._flatten(key, value)
        if len(flat) not in counts:
            allowed = " or ".join(str(count) for count in counts)
            raise self.fault(key, f"has {len(flat)} numbers; must have {allowed}")
        return [self._number(key, item) for item in flat]

    def matrix(self, key: str, rows: int, columns: int) -> NDArray[np.float64]:
        return np.array(self.numbers(key, [rows * columns])).reshape(rows, columns)

    def _flatten(self, key: str, value: Any) -> list[Any]:
        if not isinstance(value, list):
            raise self.fault(key, "must be a list of numbers")
        flat: list[Any] = []
        for item in value:
            flat.extend(item if isinstance(item, list) else [item])
        return flat

    def _number(self, key: str, value: Any) -> float:
        try:
            if isinstance(value, bool) or not isinstance(value, int | float | str):
                raise ValueError
            number = float(value)
        except (ValueError, OverflowError):
            raise self.fault(key, f"{reprlib.repr(value)} is not a number; correct it") from None
        if not math.isfinite(number) or abs(number) > LARGEST_NUMBER:
            raise self.fault(key, f"{number} is no finite, sensible number; calibrate again")
        return number
