# SPDX-License-Identifier: Apache-2.0
"""KITTI odometry folders: image_0 and image_1 (or image_2, image_3), calib.txt, times.txt."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from pilotage import StereoRig
from pilotage.calibration.files import load_rig
from pilotage.errors import InputError
from pilotage.recordings.frames import Truth
from pilotage.recordings.pairs import Pair, PairRecording, check_times, match_names, steady_times
from pilotage.recordings.pictures import PictureError, list_pictures, read_grey
from pilotage.recordings.times import read_lines, seconds_to_ns
from pilotage.recordings.truth import find_truth, read_kitti_poses

PICTURES_MEASURED = 3  # one of another size among them must not decide
SIDES = (("image_0", "image_1"), ("image_2", "image_3"))


class KittiRecording(PairRecording):
    """Rectified pairs; times are nominal, 10 a second, when times.txt is absent."""

    looks_for = "KITTI folders image_0 and image_1 with calib.txt"

    def __init__(self, path: Path, calibration: Path | None, rate_hz: float | None) -> None:
        sides = _sides(path)
        lefts, rights = ({f.stem: f for f in list_pictures(path / side)} for side in sides)
        if not lefts and not rights:
            raise InputError(f"{path / sides[0]}: holds no pictures; put them in")
        names = match_names(lefts, rights, path)
        rig = _load_rig(path, calibration, list(lefts.values()), colour=sides == SIDES[1])
        self._times_ns = _read_times(path / "times.txt", len(names), rate_hz)
        pairs = [
            Pair(t, lefts[name], rights[name])
            for t, name in zip(self._times_ns, names, strict=True)
        ]
        super().__init__(path, pairs, rig)

    @staticmethod
    def recognises(path: Path) -> bool:
        """Tell by the two folders."""
        return any(all((path / side).is_dir() for side in sides) for sides in SIDES)

    def truth(self) -> Truth | None:
        """Return poses.txt, or a TUM file of the left camera."""
        file = self.path / "poses.txt"
        if file.is_file():
            return read_kitti_poses(file, self._times_ns)
        return find_truth(self.path, lambda: None)


def _sides(path: Path) -> tuple[str, str]:
    return next(sides for sides in SIDES if all((path / side).is_dir() for side in sides))


def _load_rig(
    path: Path, calibration: Path | None, lefts: list[Path], *, colour: bool
) -> StereoRig:
    file = calibration or path / "calib.txt"
    if calibration is None and not file.is_file():
        raise InputError(f"{file}: does not exist; add it, or give a calibration (--calibration)")
    return load_rig(file, image_size_px=_picture_size(path, lefts), colour=colour)


def _picture_size(path: Path, lefts: list[Path]) -> tuple[int, int]:
    """Return the commonest (width, height) of the first pictures: calib.txt does not say it."""
    sizes: Counter[tuple[int, int]] = Counter()
    for left in lefts:
        try:
            height, width = read_grey(left).shape
        except PictureError:
            continue
        sizes[width, height] += 1
        if sizes.total() == PICTURES_MEASURED:
            break
    if not sizes:
        raise InputError(f"{path}: none of its {len(lefts)} left pictures can be read; copy again")
    return sizes.most_common(1)[0][0]


def _read_times(file: Path, count: int, rate_hz: float | None) -> list[int]:
    if rate_hz is not None or not file.is_file():
        return steady_times(count, rate_hz)
    lines = [line for line in read_lines(file) if line.strip()]
    if len(lines) != count:
        raise InputError(
            f"{file}: {len(lines)} times for {count} pairs; there must be one each, "
            "or give rate_hz (--rate-hz)"
        )
    times_ns = [seconds_to_ns(line, f"{file}:{n}") for n, line in enumerate(lines, start=1)]
    check_times(times_ns, file)
    return times_ns
