# SPDX-License-Identifier: Apache-2.0
"""The results folder: what a run leaves behind. Its files are told in docs/results_folder.md."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from pilotage.atomic_files import LineFile, produce_atomically, write_atomically
from pilotage.errors import InputError, RunError
from pilotage.judge_files import judge_header
from pilotage.models.ply import ply_bytes as colored_ply
from pilotage.pose_files import (
    PoseRecord,
    csv_header,
    csv_line,
    kitti_line,
    read_pose_table,
    read_text,
    tum_line,
)

if TYPE_CHECKING:
    from pilotage import StereoRig

SUMMARY = "summary.json"
CONFIG = "config.yaml"
CALIBRATION = "calibration.yaml"
POSES = "poses.csv"
POSES_LIVE = "poses_live.csv"
TUM = "trajectory_tum.txt"
TUM_LIVE = "trajectory_live_tum.txt"
KITTI = "trajectory_kitti.txt"
TRUTH = "truth_tum.txt"
CLOUD = "points.ply"
PICTURES = "pictures.jpg"
EVALUATION = "evaluation.json"
REPORT = "report.html"
COLMAP_TEXT, COLMAP_BINARY = "colmap_text", "colmap_binary"  # folders of a model
CLOUD_WITH_CAMERAS = "points_and_cameras.ply"
STOPS, TUM_TORSO = "stops.csv", "trajectory_torso_tum.txt"  # of a walk with stops
WALK_PICTURES = "pictures"  # a folder of its pictures
JUDGE = "judge.csv"
JUDGE_LIVE = "judge_live.csv"
PAIRS = "pairs"  # a folder with one for each of several stereo pairs
FILES = (
    *(SUMMARY, CONFIG, CALIBRATION, POSES, POSES_LIVE, TUM, TUM_LIVE, KITTI),
    *(TRUTH, CLOUD, PICTURES, EVALUATION, REPORT),
)
JUDGE_FILES = (JUDGE, JUDGE_LIVE)  # beside them, of several stereo pairs
PAIR_FILES = (CALIBRATION, POSES, POSES_LIVE, TUM, TUM_LIVE, KITTI)
PAIR_PATTERNS = (*(f"{PAIRS}/*/{name}" for name in PAIR_FILES), f"{PAIRS}/*/", f"{PAIRS}/")


class ResultsFolder:
    """A results folder being written. `with` opens it and keeps its live files open.

    Entering raises InputError where the folder holds anything but an earlier result, or holds one
    and `overwrite` is false; every write raises RunError naming the file.
    """

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        self.path = path
        self._overwrite = overwrite
        self._live: dict[str, LineFile] = {}

    def __enter__(self) -> Self:
        check_free(self.path, overwrite=self._overwrite)
        claim_folder(self.path, (*FILES, *JUDGE_FILES, *PAIR_PATTERNS))
        for name in (POSES_LIVE, TUM_LIVE):
            self._live[name] = LineFile(self.path / name)
        self._live[POSES_LIVE].append(csv_header())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for file in self._live.values():
            file.close()
        self._live = {}

    def append_live(self, record: PoseRecord) -> None:
        """Add a pair, as known at this moment, to the live files; they are readable at any time."""
        self._live[POSES_LIVE].append(csv_line(record))
        self._live[TUM_LIVE].append(tum_line(record))

    def begin_pairs(self, rigs: Mapping[str, StereoRig]) -> None:
        """Make a folder for each of several stereo pairs, with its calibration and live files."""
        from pilotage.calibration.files import save_rig

        self._live[JUDGE_LIVE] = LineFile(self.path / JUDGE_LIVE)
        self._live[JUDGE_LIVE].append(judge_header())
        for folder, rig in zip(pair_folders(rigs).values(), rigs.values(), strict=True):
            place = self.path / folder
            try:
                place.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise RunError(f"cannot make {place}: {error.strerror}") from error
            produce_atomically(place / CALIBRATION, functools.partial(save_rig, rig))
            for name in (POSES_LIVE, TUM_LIVE):
                self._live[f"{folder}/{name}"] = LineFile(place / name)
            self._live[f"{folder}/{POSES_LIVE}"].append(csv_header())

    def append_pair_live(self, folder: str, record: PoseRecord) -> None:
        """Add what one stereo pair says at this moment to the live files of its folder."""
        self._live[f"{folder}/{POSES_LIVE}"].append(csv_line(record))
        self._live[f"{folder}/{TUM_LIVE}"].append(tum_line(record))

    def append_judge_live(self, lines: str) -> None:
        """Add lines of judge.csv as they are decided at this moment."""
        self._live[JUDGE_LIVE].append(lines)

    def write_judge(self, text: str) -> None:
        """Write judge.csv, whole."""
        write_atomically(self.path / JUDGE, text)

    def write_trajectory(self, records: Iterable[PoseRecord], folder: str = "") -> None:
        """Write the adjusted trajectory in its three formats; of one pair into its folder."""
        known, place = list(records), self.path / folder
        write_atomically(place / POSES, csv_header() + "".join(map(csv_line, known)))
        write_atomically(place / TUM, "".join(map(tum_line, known)))
        write_atomically(place / KITTI, "".join(map(kitti_line, known)))

    def write_truth(self, records: Sequence[PoseRecord]) -> None:
        """Write the truth that came with the recording; no file where there is none."""
        if records:
            header = "# truth of the recording: t[s] x y z qx qy qz qw\n"
            write_atomically(self.path / TRUTH, header + "".join(map(tum_line, records)))

    def write_cloud(self, points_m: NDArray[np.floating[Any]], greys: NDArray[np.uint8]) -> None:
        """Write (N, 3) points in the world, metres, and their (N,) greys as binary PLY."""
        write_atomically(self.path / CLOUD, ply_bytes(points_m, greys))

    def write_pictures(self, sheet: bytes | None) -> None:
        """Write the sheet of some of the run's pictures, a JPEG; no file where there is none."""
        if sheet is not None:
            write_atomically(self.path / PICTURES, sheet)

    def write_config(self, config: Mapping[str, Any]) -> None:
        """Write the whole configuration the run used, so that it can be given to --config."""
        import yaml

        write_atomically(self.path / CONFIG, yaml.safe_dump(dict(config), sort_keys=False))

    def write_calibration(self, rig: StereoRig) -> None:
        """Write the calibration the run used, so that it can be given to --calibration."""
        from pilotage.calibration.files import save_rig

        produce_atomically(self.path / CALIBRATION, lambda path: save_rig(rig, path))

    def write_calibrations(self, rigs: Mapping[str, StereoRig]) -> None:
        """Write those of several stereo pairs, so that they can be given to --calibration."""
        from pilotage.calibration.rig_calibration import save_rigs

        produce_atomically(self.path / CALIBRATION, lambda path: save_rigs(rigs, path))

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write summary.json; NaN becomes null, for JSON has none."""
        write_json(self.path / SUMMARY, {"program": "pilotage", **summary})


@dataclass(frozen=True)
class Results:
    """A results folder as read: `adjusted` is false where only the live poses exist."""

    path: Path
    summary: dict[str, Any]
    records: list[PoseRecord]
    adjusted: bool


def read_results(path: Path) -> Results:
    """Read a results folder, also one whose run was killed; InputError where it is none."""
    if not is_results_folder(path):
        raise InputError(f"{path} is not a results folder: it has no {SUMMARY} of pilotage")
    summary = json.loads(read_text(path / SUMMARY))
    adjusted = (path / POSES).exists()
    records = read_pose_table(path / (POSES if adjusted else POSES_LIVE))
    return Results(path=path, summary=summary, records=records, adjusted=adjusted)


def read_pair_records(results: Results) -> dict[str, list[PoseRecord]]:
    """Return the poses of each stereo pair by itself, of a run that joined several; by name."""
    name = POSES if results.adjusted else POSES_LIVE
    listed = results.summary.get("stereo_pairs")
    if listed is None:  # the run was killed before it came to say
        found = {path.name: f"{PAIRS}/{path.name}" for path in results.path.glob(f"{PAIRS}/*/")}
    else:
        found = {pair["name"]: pair["folder"] for pair in listed}
    places = {pair: results.path / folder / name for pair, folder in found.items()}
    return {pair: read_pose_table(path) for pair, path in places.items() if path.exists()}


def pair_folders(names: Iterable[str]) -> dict[str, str]:
    """Return the folder of each stereo pair inside a results folder: `pairs/front`."""
    folders: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"[^\w-]+", "_", name) or "_"
        while f"{PAIRS}/{plain}" in folders.values():
            plain += "_"
        folders[name] = f"{PAIRS}/{plain}"
    return folders


def check_free(path: Path, *, overwrite: bool) -> None:
    """Raise InputError unless `path` is new, empty, or holds earlier results to be replaced."""
    if not path.exists():
        return
    if not path.is_dir():
        raise InputError(f"{path} is a file; results need a folder")
    if not any(path.iterdir()):
        return
    if not is_results_folder(path):
        raise InputError(f"{path} holds other things than results; choose another folder")
    if not overwrite:
        raise InputError(f"{path} holds earlier results; choose another folder or give --overwrite")


def claim_folder(path: Path, patterns: Iterable[str]) -> None:
    """Make the folder, mark it as ours and unfinished, and remove what an earlier run left in it.

    `patterns` are names or globs of the files a run of this kind writes, `pairs/*/poses.csv`; one
    that ends in `/` names folders, which go where they are empty. Nothing else is touched.
    InputError where the folder cannot be used; whether it may be is asked by `check_free`.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        # Before anything is removed: ours from the first moment on, and unfinished should we be
        # killed.
        write_json(path / SUMMARY, {"program": "pilotage", "state": "running"})
        for pattern in patterns:
            for left in sorted(path.glob(pattern)):
                if not pattern.endswith("/"):
                    if left != path / SUMMARY:
                        left.unlink()
                elif not any(left.iterdir()):
                    left.rmdir()
    except OSError as error:
        raise InputError(f"cannot use {path} for results: {error.strerror}") from error


def is_results_folder(path: Path) -> bool:
    """Tell whether a run of this program made the folder."""
    try:
        content = json.loads((path / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("program") == "pilotage"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON that every reader takes: NaN and infinity become null."""
    write_atomically(path, json.dumps(_plain(content), indent=2, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def ply_bytes(points_m: NDArray[np.floating[Any]], greys: NDArray[np.uint8]) -> bytes:
    """Return a binary little-endian PLY of (N, 3) float points whose colour is their grey."""
    if points_m.shape != (len(greys), 3):
        raise RunError(f"{len(greys)} greys do not fit points of shape {points_m.shape}")
    finite = np.isfinite(points_m).all(axis=1)
    return colored_ply(points_m[finite], np.repeat(greys[finite, None], 3, axis=1))
