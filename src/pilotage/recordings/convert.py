# SPDX-License-Identifier: Apache-2.0
"""A recording of one format written as another."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pilotage import Transform
from pilotage.atomic_files import write_error
from pilotage.errors import InputError
from pilotage.recordings.euroc_folder import write_euroc
from pilotage.recordings.folder_files import transform_of_pose
from pilotage.recordings.frames import BadFrame, StereoFrame, Truth
from pilotage.recordings.kitti_folder import write_kitti
from pilotage.recordings.mcap_writer import McapWriter
from pilotage.recordings.recording import SIMULATION, Recording, metadata_of

FOLDER_WRITERS = {"kitti": write_kitti, "euroc": write_euroc}
TARGETS = (*FOLDER_WRITERS, "mcap")
FRONT = "front"
Watch = Callable[[Iterable[StereoFrame | BadFrame]], Iterable[StereoFrame | BadFrame]]


@dataclass
class Conversion:
    """What went over: the number of pairs, those that could not be read, what else to know."""

    pairs: int = 0
    skipped: list[BadFrame] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def convert(
    recording: Recording, out: Path, to: str, *, watch: Watch = iter, pair: str = FRONT
) -> Conversion:
    """Write pictures, calibration, times and truth of `recording` to `out`, a new file or folder.

    `to` is one of TARGETS; `watch` passes the frames on and may show how it goes; `pair` is what
    MCAP calls the stereo pair, its cameras `<pair>_left` and `<pair>_right`. Pictures go over
    unchanged, as the grey ones that reading gives, unless KITTI asks for rectified ones. `out`
    appears once it is whole. InputError where it exists or the target cannot hold the recording,
    RunError naming the file that cannot be written.
    """
    if to not in TARGETS:
        raise InputError(f"--to {to}: must be one of {', '.join(TARGETS)}")
    if out.exists():
        raise InputError(f"{out} exists; choose another name or remove it")
    conversion = Conversion()
    truth = recording.truth()
    if truth is None:
        conversion.notes.append("the recording holds no truth")
    pairs = _good_pairs(watch(recording.frames()), conversion)
    if to == "mcap":
        _write_mcap(recording, pairs, truth, out, pair)
    else:
        _write_folder(recording, pairs, truth, out, to, conversion)
    return conversion


def _good_pairs(
    frames: Iterable[StereoFrame | BadFrame], conversion: Conversion
) -> Iterator[StereoFrame]:
    for frame in frames:
        if isinstance(frame, StereoFrame):
            conversion.pairs += 1
            yield frame
        else:
            conversion.skipped.append(frame)


def _write_folder(  # noqa: PLR0913, PLR0917, what to write, where and how
    recording: Recording,
    pairs: Iterator[StereoFrame],
    truth: Truth | None,
    out: Path,
    to: str,
    conversion: Conversion,
) -> None:
    temporary = out.with_name(f".{out.name}.partial")
    try:
        # What a killed conversion left behind is nobody's.
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        conversion.notes += FOLDER_WRITERS[to](recording.rig, pairs, truth, temporary)
        temporary.rename(out)
    except OSError as error:
        raise write_error(Path(error.filename or out), error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write_mcap(
    recording: Recording, pairs: Iterator[StereoFrame], truth: Truth | None, out: Path, pair: str
) -> None:
    writer = McapWriter(out)
    left, right = f"{pair}_left", f"{pair}_right"
    poses = iter(_poses(truth))
    pose = next(poses, None)
    try:
        with writer:
            if origin := metadata_of(recording, SIMULATION):
                writer.write_metadata(SIMULATION, origin)
            is_first = True
            for frame in pairs:
                now_ns = frame.timestamp_ns
                if is_first:
                    writer.add_rig(recording.rig, timestamp_ns=now_ns, left=left, right=right)
                    is_first = False
                while pose is not None and pose[0] <= now_ns:
                    writer.write_truth(timestamp_ns=pose[0], world_from_body=pose[1], body=left)
                    pose = next(poses, None)
                writer.write_pair(
                    timestamp_ns=now_ns,
                    left=frame.left,
                    right=frame.right,
                    cameras=(left, right),
                )
            while pose is not None:
                writer.write_truth(timestamp_ns=pose[0], world_from_body=pose[1], body=left)
                pose = next(poses, None)
    except BaseException:
        # Nothing is lost with it: the recording is still there. One that stood there before was
        # refused on entering, and stays.
        if writer.is_ours:
            with contextlib.suppress(OSError):
                writer.part.unlink(missing_ok=True)
        raise


def _poses(truth: Truth | None) -> Iterator[tuple[int, Transform]]:
    if truth is not None:
        times = zip(truth.timestamps_ns.tolist(), truth.world_from_left, strict=True)
        for timestamp_ns, world_from_left in times:
            yield timestamp_ns, transform_of_pose(world_from_left, timestamp_ns)
