# SPDX-License-Identifier: Apache-2.0
"""Files that hold only whole things, whatever happens: a kill, a full disk."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterable
from io import FileIO
from pathlib import Path
from typing import Self

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


def write_each(writes: Iterable[Callable[[], object]]) -> list[RunError]:
    """Do each write, also after one that failed, and return the faults."""
    faults = []
    for write in writes:
        try:
            write()
        except RunError as fault:
            faults.append(fault)
    return faults


class GrowingFile:
    """A new file that grows by whole blocks, each in the hands of the system after `append`.

    `open` or a `with` creates it.
    Opening and appending raise RunError naming the file; a block that does not fit is taken back.
    With `exclusive`, a file that exists already is refused as any other failure to open.
    """

    def __init__(self, path: Path, *, exclusive: bool = False) -> None:
        self.path = path
        self.size = 0
        self._mode = "xb" if exclusive else "wb"
        self._file: FileIO | None = None

    def open(self) -> None:
        """Create the file."""
        try:
            self._file = FileIO(self.path, self._mode)
        except OSError as error:
            raise write_error(self.path, error) from error

    def append(self, data: bytes) -> None:
        """Write `data`, all of it or nothing."""
        file = self._opened()
        try:
            if file.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            with contextlib.suppress(OSError):
                file.truncate(self.size)
                file.seek(self.size)
            raise write_error(self.path, error) from error
        self.size += len(data)

    def sync(self) -> None:
        """Wait until the disk has it."""
        try:
            os.fsync(self._opened().fileno())
        except OSError as error:
            raise write_error(self.path, error) from error

    def close(self) -> None:
        """Close; nothing is left to be written then."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _opened(self) -> FileIO:
        if self._file is None:
            raise ValueError(f"{self.path} is not open; use it in a `with`")
        return self._file


class LineFile:
    """A new file that grows by whole lines; errors as of `GrowingFile`."""

    def __init__(self, path: Path) -> None:
        self._file = GrowingFile(path)
        self._file.open()

    def append(self, line: str) -> None:
        """Write `line`, which brings its own newline."""
        self._file.append(line.encode())

    def close(self) -> None:
        """Close; nothing is left to be written then."""
        self._file.close()


def write_error(path: Path, error: OSError) -> RunError:
    """Return the RunError that tells the user which file could not be written, and why."""
    return RunError(f"cannot write {path}: {error.strerror or error}")
