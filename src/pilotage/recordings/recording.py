# SPDX-License-Identifier: Apache-2.0
"""The protocol of a recording, the table of formats, and `open_recording`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

from pilotage import StereoRig
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame, StereoFrame, Truth

__all__ = [
    "BadFrame",
    "HasMetadata",
    "OpenedPairs",
    "Recording",
    "StereoFrame",
    "Truth",
    "open_pairs",
    "open_recording",
]

# Tried in this order, each imported when its turn comes; outside packages come after, through
# entry points of this group.
FORMATS = {
    "kitti": "pilotage.recordings.kitti:KittiRecording",
    "euroc": "pilotage.recordings.euroc:EurocRecording",
    "mcap": "pilotage.recordings.mcap:McapRecording",
    "video": "pilotage.recordings.video:VideoRecording",
    "images": "pilotage.recordings.images:ImagesRecording",
}
ENTRY_POINTS = "pilotage.recordings"
NAMELESS = "stereo"  # what the only pair of a recording without names is called
SIMULATION = "pilotage.simulation"  # metadata that say with what a recording was simulated
Opened = TypeVar("Opened")


class Recording(Protocol):
    """Stereo pairs with times and the rig that took them."""

    name: str
    path: Path
    rig: StereoRig

    @property
    def decode_cpu_s(self) -> float:
        """Return the processor time reading and decoding has cost so far."""

    def __len__(self) -> int:
        """Return the number of pairs, bad ones included."""

    def frames(self) -> Iterator[StereoFrame | BadFrame]:
        """Return the pairs in order; each call starts anew."""

    def truth(self) -> Truth | None:
        """Return the true poses stored with the recording, None without; InputError if broken."""


@runtime_checkable
class HasMetadata(Protocol):
    """A recording that says something of itself."""

    def metadata(self, name: str) -> Mapping[str, str] | None:
        """Return what it says under that name; None where it says nothing."""


def metadata_of(recording: Recording, name: str) -> Mapping[str, str] | None:
    """Return what any recording says of itself under that name; None where it says nothing."""
    return recording.metadata(name) if isinstance(recording, HasMetadata) else None


class Format(Protocol):
    """What a format's class offers beside its instances, which are `Recording`s."""

    looks_for: str  # what must be there, in a few words

    def recognises(self, path: Path) -> bool:
        """Tell from names alone whether `path` is of this format."""

    def __call__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> Recording:
        """Open; InputError when the content does not hold what the names promise."""


@dataclass(frozen=True)
class OpenedPairs:
    """The stereo pairs of a recording by name: those that can be used, and why others cannot."""

    sound: Mapping[str, Recording]
    left_out: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all, the sound ones first."""
        return (*self.sound, *self.left_out)


@runtime_checkable
class PairsFormat(Protocol):
    """A format whose recordings may hold several stereo pairs, each with a name."""

    def open_pair(
        self, path: Path, calibration: Path | None, rate_hz: float | None, pair: str
    ) -> Recording:
        """Open the pair of that name; InputError lists those there are."""


@runtime_checkable
class AllPairsFormat(Protocol):
    """A format that opens all its stereo pairs at once."""

    def open_pairs(
        self, path: Path, calibration: Path | None, rate_hz: float | None
    ) -> OpenedPairs:
        """Open every pair that can be used; InputError where there is no pair at all."""


def open_recording(
    path: str | Path,
    *,
    calibration: str | Path | None = None,
    rate_hz: float | None = None,
    pair: str | None = None,
) -> Recording:
    """Open a recording of whichever format `path` is.

    `calibration` replaces the recording's own; `rate_hz` replaces its times by a steady rate;
    `pair` names the stereo pair, by default the one that looks ahead.
    Raises InputError naming the file, the value and the remedy.
    """

    def opened(found: Format, source: Path, given: Path | None) -> Recording:
        return _open(found, source, given, rate_hz, pair)

    return _with_format(path, calibration, rate_hz, opened)


def open_pairs(
    path: str | Path,
    *,
    calibration: str | Path | None = None,
    rate_hz: float | None = None,
) -> OpenedPairs:
    """Open every stereo pair of a recording; a pair without a name is called `stereo`.

    A pair that cannot be used is told with the reason; InputError where the recording as a whole
    is none.
    """

    def opened(found: Format, source: Path, given: Path | None) -> OpenedPairs:
        if isinstance(found, AllPairsFormat):
            return found.open_pairs(source, given, rate_hz)
        return OpenedPairs({NAMELESS: found(source, given, rate_hz)})

    return _with_format(path, calibration, rate_hz, opened)


def _with_format(
    path: str | Path,
    calibration: str | Path | None,
    rate_hz: float | None,
    opened: Callable[[Format, Path, Path | None], Opened],
) -> Opened:
    """Return what `opened` makes of the format that `path` is of, path and calibration."""
    source = Path(path)
    if rate_hz is not None and not 1e-3 <= rate_hz <= 1e5:
        raise InputError(f"rate_hz = {rate_hz}: must lie from 0.001 to 100000 pictures a second")
    try:
        if not source.exists():
            raise InputError(f"{source}: does not exist; check the path")
        for recording_format in _formats():
            if recording_format.recognises(source):
                given = None if calibration is None else Path(calibration)
                return opened(recording_format, source, given)
    except (OSError, ValueError) as error:  # no permission, a zero byte in a name
        raise InputError(f"{str(source)!r}: cannot be read ({error}); check the path") from error
    looked_for = "; ".join(f.looks_for for f in _formats())
    raise InputError(f"{source}: holds no recording. Looked for: {looked_for}")


def _open(
    recording_format: Format,
    source: Path,
    calibration: Path | None,
    rate_hz: float | None,
    pair: str | None,
) -> Recording:
    if pair is None:
        return recording_format(source, calibration, rate_hz)
    if isinstance(recording_format, PairsFormat):
        return recording_format.open_pair(source, calibration, rate_hz, pair)
    raise InputError(
        f"{source}: pair {pair!r}: holds one stereo pair, which has no name; leave the name out"
    )


def _formats() -> Iterator[Format]:
    for target in FORMATS.values():
        module, _, name = target.partition(":")
        yield getattr(importlib.import_module(module), name)
    for entry_point in entry_points(group=ENTRY_POINTS):
        yield entry_point.load()
