# SPDX-License-Identifier: Apache-2.0
"""A side-by-side video file, left eye first; times from the container."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2

from pilotage.calibration.files import load_rig
from pilotage.errors import InputError
from pilotage.recordings.frames import BadFrame, DecodeClock, Frames, StereoFrame, Truth
from pilotage.recordings.pairs import NS_PER_S, SizeError, split_side_by_side
from pilotage.recordings.pictures import PictureError, to_grey
from pilotage.recordings.truth import find_truth

SUFFIXES = {".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".mjpeg", ".ogv"}
CALIBRATION_SUFFIXES = (".yaml", ".yml")
# One thread: the decoder's time can then be measured, and the order of pictures is fixed.
PARAMETERS = [cv2.CAP_PROP_N_THREADS, 1]


class VideoRecording:
    """Pairs of one video; the calibration has the video's name, or is given."""

    looks_for = f"a side-by-side video file ({', '.join(sorted(SUFFIXES))})"

    def __init__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> None:
        self.name = path.stem
        self.path = path
        self.rig = load_rig(calibration or _find_calibration(path))
        self._rate_hz = rate_hz
        self._clock = DecodeClock()
        self._count = self._check()

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by the name's end."""
        return path.is_file() and path.suffix.lower() in SUFFIXES

    @property
    def decode_cpu_s(self) -> float:
        """Return the processor time reading and decoding has cost so far."""
        return self._clock.cpu_s

    def __len__(self) -> int:
        return self._count

    def frames(self) -> Frames:
        """Return the pairs in order; a video that ends early closes with a bad frame."""
        return Frames(self._generate(), self._clock)

    def truth(self) -> Truth | None:
        """Return the poses in a .tum file of the video's name."""
        if not self.path.with_suffix(".tum").is_file():
            return None
        return find_truth(self.path.parent, lambda: None)

    def _check(self) -> int:
        """Return the number of pictures after a look at the first one."""
        video = _open(self.path)
        try:
            whole, picture = video.read()
            if not whole:
                raise InputError(f"{self.path}: holds no picture that can be decoded")
            split_side_by_side(to_grey(picture, self.path), self.rig, self.path)
            count = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
            if count > 0:
                return count
            count = 1  # a stream without an index: count by skipping through
            while video.grab():
                count += 1
            return count
        except SizeError as error:
            raise InputError(f"{error}; give the calibration of this video") from None
        except PictureError as error:
            raise InputError(f"{error}; convert the video") from None
        finally:
            video.release()

    def _generate(self) -> Iterator[StereoFrame | BadFrame]:
        video = _open(self.path)
        try:
            last_ns = -1
            for index in range(self._count):
                whole, picture = video.read()
                timestamp_ns = self._timestamp_ns(video, index)
                if not whole:
                    yield self._ended(index, max(timestamp_ns, last_ns + 1))
                    return
                if timestamp_ns <= last_ns:
                    reason = f"{self.path}: picture {index}: its time does not come after the last"
                    yield BadFrame(index, last_ns + 1, reason)
                    last_ns += 1
                    continue
                last_ns = timestamp_ns
                yield self._frame(index, timestamp_ns, picture)
        finally:
            video.release()

    def _timestamp_ns(self, video: cv2.VideoCapture, index: int) -> int:
        if self._rate_hz is not None:
            return round(index * NS_PER_S / self._rate_hz)
        return round(video.get(cv2.CAP_PROP_POS_MSEC) * 1e6)

    def _ended(self, index: int, timestamp_ns: int) -> BadFrame:
        reason = f"{self.path}: ends after {index} of {self._count} pictures; copy it again"
        return BadFrame(index, timestamp_ns, reason)

    def _frame(
        self, index: int, timestamp_ns: int, picture: cv2.typing.MatLike
    ) -> StereoFrame | BadFrame:
        try:
            left, right = split_side_by_side(to_grey(picture, self.path), self.rig, self.path)
        except PictureError as error:
            return BadFrame(index, timestamp_ns, str(error))
        return StereoFrame(index, timestamp_ns, left, right)


def _open(path: Path) -> cv2.VideoCapture:
    try:
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, PARAMETERS)
    except cv2.error:
        video = None
    if video is None or not video.isOpened():
        raise InputError(f"{path}: no video that can be decoded; convert it to MP4 or AVI")
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return video


def _find_calibration(path: Path) -> Path:
    for suffix in CALIBRATION_SUFFIXES:
        if path.with_suffix(suffix).is_file():
            return path.with_suffix(suffix)
    raise InputError(
        f"{path}: has no calibration; put {path.with_suffix('.yaml').name} beside it, "
        "or give one (--calibration)"
    )
