# SPDX-License-Identifier: Apache-2.0
"""Errors as one clear line and an exit code: 1 the run failed, 2 the call was wrong."""

from __future__ import annotations

import errno
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from pilotage.errors import RunError

FAILED = 1
MISUSED = 2
# No room is left on the disk, for this user, or in a file.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def errors_to_exit(*, debug: bool) -> Iterator[None]:
    """Turn errors inside into a line on stderr and typer.Exit; with `debug` the traceback stays."""
    from pilotage.errors import InputError, PilotageError

    try:
        yield
    except typer.Exit:
        raise
    except PilotageError as error:
        if debug:
            raise
        fail(str(error), MISUSED if isinstance(error, InputError) else FAILED)
    except KeyboardInterrupt:
        fail("interrupted", FAILED)
    except Exception as error:
        if debug:
            raise
        kind = type(error).__name__
        fail(f"a fault of the program, {kind}: {error} (--debug shows where)", FAILED)


def is_full_disk(error: RunError) -> bool:
    """Tell whether a run failed for want of place to write to."""
    return isinstance(error.__cause__, OSError) and error.__cause__.errno in FULL


@contextmanager
def place_to_write() -> Iterator[None]:
    """Ask for another place where a disk is full: of what is made as a whole nothing is left."""
    from pilotage.errors import InputError, RunError

    try:
        yield
    except RunError as error:
        if is_full_disk(error):
            raise InputError(f"{error}; choose another place with -o") from error
        raise


@contextmanager
def stop_on_terminate() -> Iterator[None]:
    """Let `kill` end a run as Ctrl-C does: with everything written, or cleared away."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def fail(message: str, code: int) -> None:
    """Print `message` as one line on stderr and leave with `code`."""
    say_error(message)
    raise typer.Exit(code)


def say_error(message: str) -> None:
    """Print one line on stderr, red on a terminal."""
    from rich.console import Console
    from rich.text import Text

    line = " ".join(message.split())
    Console(stderr=True).print(Text.assemble(("error: ", "bold red"), line), soft_wrap=True)


def say_warning(message: str) -> None:
    """Print one line on stderr, yellow on a terminal."""
    from rich.console import Console
    from rich.text import Text

    line = " ".join(message.split())
    Console(stderr=True).print(Text.assemble(("warning: ", "bold yellow"), line), soft_wrap=True)
