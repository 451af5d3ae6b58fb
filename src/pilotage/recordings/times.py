# SPDX-License-Identifier: Apache-2.0
"""Times as text, read without losing nanoseconds."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

from pilotage.errors import InputError

NS_PER_S = 1_000_000_000
LATEST_S = 9e9  # int64 nanoseconds end in 2262
LARGEST_FILE_BYTES = 256 * 1024 * 1024
# Names of pictures that tell when they were taken.
SECONDS_NAME = re.compile(r"\d{9,10}\.\d{1,9}")
NANOSECONDS_NAME = re.compile(r"\d{15,19}")


def read_lines(file: Path) -> list[str]:
    """Return the lines of a table; InputError when it cannot be read."""
    try:
        if file.stat().st_size > LARGEST_FILE_BYTES:
            raise InputError(f"{file}: larger than {LARGEST_FILE_BYTES} bytes; check the file")
        return file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(f"{file}: not a text file; check it") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read ({error}); check the path") from error


def seconds_to_ns(text: str, place: str) -> int:
    """Return nanoseconds of a decimal number of seconds; InputError naming `place`."""
    try:
        seconds = Decimal(text.strip())
        if not seconds.is_finite() or not abs(float(seconds)) < LATEST_S:
            raise ValueError
        # Beyond 20 places a number of seconds says nothing; exponents of millions cost hours.
        return round(seconds.scaleb(9)) if seconds.adjusted() > -20 else 0
    except (InvalidOperation, ValueError, OverflowError):
        raise InputError(f"{place}: {text[:40]!r} is no time in seconds; correct it") from None


def nanoseconds(text: str, place: str) -> int:
    """Return a whole number of nanoseconds; InputError naming `place`."""
    digits = text.strip()
    if not (digits.isascii() and digits.isdecimal()) or len(digits) > 19 or int(digits) >= 2**63:
        raise InputError(f"{place}: {text[:40]!r} is no time in nanoseconds; correct it")
    return int(digits)


def times_in_names(names: Sequence[str], folder: Path) -> list[int] | None:
    """Return nanoseconds where each name, without suffix, is a time; None where one is not."""
    if all(NANOSECONDS_NAME.fullmatch(name) for name in names):
        return [nanoseconds(name, str(folder / name)) for name in names]
    if all(SECONDS_NAME.fullmatch(name) for name in names):
        return [seconds_to_ns(name, str(folder / name)) for name in names]
    return None


def finite_numbers(words: list[str], count: int, place: str) -> list[float]:
    """Return exactly `count` finite numbers; InputError naming `place`."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(math.isfinite(n) and abs(n) < 1e12 for n in numbers):
        raise InputError(f"{place}: must hold {count} finite numbers; correct or remove the line")
    return numbers
