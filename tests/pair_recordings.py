# SPDX-License-Identifier: Apache-2.0
"""Recordings of several stereo pairs, sound ones and spoilt ones, made of one simulated drive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pilotage import StereoRig, Transform
from pilotage.recordings import StereoFrame, open_recording
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.recordings.recording import open_pairs

SECOND_NS = 1_000_000_000


class SpoiltWriter(McapWriter):
    """Leaves out what is written on topics that contain one of `dropped`."""

    dropped: Iterable[str] = ()

    def _write(self, topic: str, *arguments: Any, **metadata: str) -> None:
        if not any(part in topic for part in self.dropped):
            super()._write(topic, *arguments, **metadata)


def rewritten(  # noqa: PLR0913, what can be spoilt
    recorded: Path,
    file: Path,
    *,
    shift_ns: Mapping[str, int] | None = None,
    drift: Mapping[str, float] | None = None,
    rigs: Mapping[str, StereoRig] | None = None,
    names: Sequence[tuple[str, str]] | None = None,
    dropped: Iterable[str] = (),
    statics: Mapping[tuple[str, str], Transform] | None = None,
) -> Path:
    """Write the pairs of `recorded` anew, changed by name, and return `file`.

    `names` tells which pairs are kept and what each is called; one may be kept twice.
    """
    pairs = open_pairs(recorded).sound
    kept = names or [(name, name) for name in pairs]
    writer = SpoiltWriter(file)
    writer.dropped = dropped
    truth = open_recording(recorded).truth()
    assert truth is not None
    with writer:
        frames = []
        for name, called in kept:
            cameras = (f"{called}_left", f"{called}_right")
            rig = (rigs or {}).get(name, pairs[name].rig)
            writer.add_rig(rig, timestamp_ns=1, left=cameras[0], right=cameras[1])
            first_ns = None
            for frame in pairs[name].frames():
                assert isinstance(frame, StereoFrame)
                first_ns = frame.timestamp_ns if first_ns is None else first_ns
                late_ns = (frame.timestamp_ns - first_ns) * (drift or {}).get(name, 0.0)
                time_ns = frame.timestamp_ns + (shift_ns or {}).get(name, 0) + round(late_ns)
                frames.append((time_ns + SECOND_NS, cameras, frame))
        if statics:
            writer.add_static_transforms(statics, timestamp_ns=2)
        for time_ns, cameras, frame in sorted(frames, key=lambda item: item[:2]):
            writer.write_pair(
                timestamp_ns=time_ns, left=frame.left, right=frame.right, cameras=cameras
            )
    return file
