# SPDX-License-Identifier: Apache-2.0
"""Stereo pairs as files: what the folder formats share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pilotage import Camera, StereoRig
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame, DecodeClock, Frames, Grey, StereoFrame
from pilotage.recordings.pictures import PictureError, read_grey

# So many readable pairs of another size than calibrated are not an accident.
PAIRS_CHECKED = 10
NOMINAL_RATE_HZ = 10.0
NS_PER_S = 1_000_000_000


@dataclass(frozen=True)
class Pair:
    """Where a pair lies. `right` is None for side-by-side pictures; `problem` when it is known."""

    timestamp_ns: int
    left: Path
    right: Path | None
    problem: str = ""


class PairRecording:
    """A recording of picture files; its formats add where the truth is."""

    def __init__(self, path: Path, pairs: list[Pair], rig: StereoRig) -> None:
        check_pairs(path, pairs, rig)
        self.name = path.resolve().name
        self.path = path
        self.rig = rig
        self._pairs = pairs
        self._clock = DecodeClock()

    @property
    def decode_cpu_s(self) -> float:
        """Return the processor time reading and decoding has cost so far."""
        return self._clock.cpu_s

    def __len__(self) -> int:
        return len(self._pairs)

    def frames(self) -> Frames:
        """Return the pairs in order, decoded when asked for."""
        return Frames(_generate(self._pairs, self.rig), self._clock)


def check_pairs(path: Path, pairs: list[Pair], rig: StereoRig) -> None:
    """Raise InputError unless a pair can be read and has the calibrated size."""
    problems: list[str] = []
    wrong_sizes: list[PictureError] = []
    for pair in pairs:
        try:
            read_pair(pair, rig)
            return
        except SizeError as error:
            wrong_sizes.append(error)
            if len(wrong_sizes) == PAIRS_CHECKED:
                break
        except PictureError as error:
            problems.append(str(error))
    if wrong_sizes:
        raise InputError(f"{wrong_sizes[0]}; give the calibration of these pictures")
    raise InputError(
        f"{path}: none of its {len(pairs)} pairs can be read; the first: {problems[0]}; "
        "copy the recording again"
    )


class SizeError(PictureError):
    """A picture that is whole but not of the calibrated size."""


def read_pair(pair: Pair, rig: StereoRig) -> tuple[Grey, Grey]:
    """Return left and right, of the calibrated sizes; PictureError says why not."""
    if pair.problem:
        raise PictureError(pair.problem)
    left = read_grey(pair.left)
    if pair.right is None:
        return split_side_by_side(left, rig, pair.left)
    right = read_grey(pair.right)
    check_size(left, rig.left, pair.left)
    check_size(right, rig.right, pair.right)
    return left, right


def split_side_by_side(both: Grey, rig: StereoRig, file: Path) -> tuple[Grey, Grey]:
    """Return the left and right half of a picture, left eye first."""
    height, width = both.shape
    wanted = (rig.left.width_px + rig.right.width_px, rig.left.height_px)
    if (width, height) != wanted:
        raise SizeError(
            f"{file}: {width}x{height} px, where side-by-side pictures of the calibrated cameras "
            f"have {wanted[0]}x{wanted[1]}"
        )
    split = rig.left.width_px
    return both[:, :split].copy(), both[:, split:].copy()


def check_size(picture: Grey, camera: Camera, file: Path | str) -> None:
    height, width = picture.shape
    if (width, height) != (camera.width_px, camera.height_px):
        raise SizeError(
            f"{file}: {width}x{height} px, the calibration is for "
            f"{camera.width_px}x{camera.height_px}"
        )


def match_names(lefts: dict[str, Path], rights: dict[str, Path], path: Path) -> list[str]:
    """Return the keys both sides share, in the order of the left; InputError when any differ."""
    alone = [file for key, file in lefts.items() if key not in rights]
    alone += [file for key, file in rights.items() if key not in lefts]
    if alone:
        raise InputError(
            f"{path}: {len(lefts)} left and {len(rights)} right pictures; {alone[0]} has no "
            "partner; restore the missing picture, or remove this one"
        )
    return list(lefts)


def steady_times(count: int, rate_hz: float | None) -> list[int]:
    """Return `count` times of a steady rate, 10 a second when none is known."""
    return [round(i * NS_PER_S / (rate_hz or NOMINAL_RATE_HZ)) for i in range(count)]


def check_times(times_ns: list[int], file: Path) -> None:
    """Raise InputError naming the first time that does not rise."""
    for number, (earlier, later) in enumerate(pairwise(times_ns), start=2):
        if later <= earlier:
            raise InputError(
                f"{file}: time {number} = {later / NS_PER_S:.9f} s does not come after "
                f"{earlier / NS_PER_S:.9f} s; sort the pictures, or give rate_hz (--rate-hz)"
            )


def _generate(pairs: list[Pair], rig: StereoRig) -> Iterator[StereoFrame | BadFrame]:
    for index, pair in enumerate(pairs):
        try:
            left, right = read_pair(pair, rig)
        except PictureError as error:
            yield BadFrame(index, pair.timestamp_ns, str(error))
        else:
            yield StereoFrame(index, pair.timestamp_ns, left, right)
