# SPDX-License-Identifier: Apache-2.0
"""Files that hold only whole things, whatever happens: a kill, a full disk."""

from __future__ import annotations

import contextlib
import errno
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


class LineFile:
    """A new file that grows by whole lines, each in the hands of the system when `append` returns.

    Opening and appending raise RunError naming the file; a line that does not fit is taken back.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = 0
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise write_error(path, error) from error

    def append(self, line: str) -> None:
        """Write `line`, which brings its own newline."""
        data = line.encode()
        try:
            if self._file.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
                self._file.seek(self._size)
            raise write_error(self._path, error) from error
        self._size += len(data)

    def close(self) -> None:
        """Close; nothing is left to be written then."""
        self._file.close()


def write_error(path: Path, error: OSError) -> RunError:
    """Return the RunError that tells the user which file could not be written, and why."""
    return RunError(f"cannot write {path}: {error.strerror or error}")
