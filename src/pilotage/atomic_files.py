# SPDX-License-Identifier: Apache-2.0
"""Whole files that are either the old one or the new one, never half of either."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from pilotage.errors import RunError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write `content` (text as UTF-8) to `path` through a temporary file beside it.

    Raises RunError naming the file and the system's reason, say a full disk; whatever stood at
    `path` before then still stands there.
    """
    data = content.encode() if isinstance(content, str) else content
    produce_atomically(path, lambda temporary: temporary.write_bytes(data))


def produce_atomically(path: Path, produce: Callable[[Path], object]) -> None:
    """Let `produce` write a temporary file beside `path`, then rename it; errors as above."""
    # The suffix stays, for writers that choose their format by it.
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        produce(temporary)
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    except OSError as error:
        raise write_error(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_error(path: Path, error: OSError) -> RunError:
    """Return the RunError that tells the user which file could not be written, and why."""
    return RunError(f"cannot write {path}: {error.strerror or error}")
