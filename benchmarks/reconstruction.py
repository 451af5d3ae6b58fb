# SPDX-License-Identifier: Apache-2.0
"""Reconstruct picture sets with Pilotage and with COLMAP, and hold both against the truth.

    python benchmarks/reconstruction.py [--sets kitti_a office_walk] [--systems pilotage colmap]
    python benchmarks/reconstruction.py --sets kitti_a --shuffle 1 --out rows.jsonl

Both get the same files, two threads, each in a process of its own, and the same calibration.
COLMAP holds it unless --lens-sigma is above 0; Pilotage does as for its users, and holds it with
--lens-sigma 0. The centres of the cameras are laid onto the truth by a similarity.
With --shuffle the pictures are given once more, copied under random names in random order, and the
poses of both runs compared. Runs that --out holds already are not done again. Real sets are looked
for in $PILOTAGE_DATA.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from picture_sets import MANY, READERS, PictureSet, load_set
from run_reconstruction import MISSING, SYSTEMS
from tables import markdown_table, number

from pilotage.errors import InputError
from pilotage.evaluation.camera_poses import pose_errors
from pilotage.models import Model, read_colmap_binary

Array = npt.NDArray[Any]
COLUMNS = {
    "set": "set",
    "system": "system",
    "registered": "registered",
    "ate_rmse_m": "ATE m",
    "ate_median_m": "median m",
    "ate_percent_of_length": "ATE % of path",
    "rotation_median_deg": "rotation deg",
    "points": "points",
    "reprojection_px": "reprojection px",
    "wall_s": "wall s",
    "cpu_s": "CPU s",
    "peak_mb": "memory MB",
    "cpu_ratio": "CPU COLMAP/this",
    "shuffled_mm": "off unshuffled, mm",
    "note": "note",
}


def run_in_child(
    pictures: PictureSet, files: Sequence[Path], system: str, options: dict[str, Any]
) -> dict[str, Any]:
    """Run one system on `files`, those of the set in its order; return costs, figures and poses."""
    job = {
        "system": system,
        "pictures": [str(path) for path in sorted(files)],
        "camera": _named(pictures.camera),
        "options": options,
    }
    with tempfile.TemporaryDirectory(prefix="pilotage-bench-") as scratch:
        script = Path(__file__).with_name("run_reconstruction.py")
        command = [sys.executable, str(script), scratch]
        # Threads of numpy's algebra spin for a while after their start, in either's account.
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            command, input=json.dumps(job), text=True, capture_output=True,
            env=environment, check=False,
        )  # fmt: skip
        if done.returncode == MISSING:
            return {"missing": done.stderr.strip()}
        if done.returncode:
            return {"note": f"failed with {done.returncode}: {_last_line(done.stderr)}"}
        costs: dict[str, Any] = json.loads((Path(scratch) / "costs.json").read_text())
        folder = Path(scratch) / "model"
        model = read_colmap_binary(folder) if folder.is_dir() else None
    return {**costs, **figures(model), "poses": poses_by_place(model, files)}


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["nothing said"])[-1]


def _named(camera: Any) -> dict[str, Any]:
    sizes = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    lens = {"distortion": camera.distortion, "coefficients": list(camera.coefficients)}
    return {name: getattr(camera, name) for name in sizes} | lens


def figures(model: Model | None) -> dict[str, Any]:
    """Return what a model says of itself."""
    if model is None:
        return {"points": 0, "reprojection_px": None}
    errors = model.reprojection_errors_px()
    known = errors[np.isfinite(errors)]
    mean_px = float(known.mean()) if len(known) else None
    return {"points": len(model.points_in_world), "reprojection_px": mean_px}


def poses_by_place(model: Model | None, files: Sequence[Path]) -> list[list[float] | None]:
    """Return for each file the `world_from_camera`, 3x4 row by row; None where not registered."""
    if model is None:
        return [None] * len(files)
    poses = dict(zip(model.names, model.world_from_camera(), strict=True))
    found = [poses.get(path.name) for path in files]
    return [None if pose is None else pose[:3].ravel().tolist() for pose in found]


def matrices(poses: Sequence[Sequence[float] | None]) -> Array:
    """Return (N, 4, 4) of what `poses_by_place` gave, NaN for None."""
    result = np.full((len(poses), 4, 4), np.nan)
    for matrix, pose in zip(result, poses, strict=True):
        if pose is not None:
            matrix[:3], matrix[3] = np.reshape(pose, (3, 4)), (0, 0, 0, 1)
    return result


def shuffled_files(files: Sequence[Path], seed: int, folder: Path) -> list[Path]:
    """Copy the files into `folder` under random names; return the copies in the order of `files`.

    Sorted by name, the copies are in random order.
    """
    places = np.random.default_rng(seed).permutation(len(files))
    copies = []
    for path, place in zip(files, places.tolist(), strict=True):
        copy = folder / f"{place:05d}{path.suffix.lower()}"
        copy.write_bytes(path.read_bytes())
        copies.append(copy)
    return copies


def judged(row: dict[str, Any], pictures: PictureSet) -> dict[str, Any]:
    """Add the errors of a run's poses and how many pictures it has."""
    if "poses" not in row:
        return row
    estimate = matrices(row["poses"])
    count = int(np.isfinite(estimate[:, 0, 0]).sum())
    errors = pose_errors(estimate=estimate, truth=pictures.truth)
    row = {**row, "registered": f"{count}/{len(estimate)}"}
    return row if errors is None else {**row, **asdict(errors)}


def shuffled_mm(shuffled: dict[str, Any], plain: dict[str, Any]) -> float:
    """Return how far the poses of two runs are apart, root mean square; NaN where they cannot tell.

    Millimetres by the plain run's scale against the truth.
    """
    if not {"poses", "scale"} <= plain.keys() or "poses" not in shuffled:
        return float("nan")
    errors = pose_errors(estimate=matrices(shuffled["poses"]), truth=matrices(plain["poses"]))
    return float("nan") if errors is None else 1e3 * plain["scale"] * errors.ate_rmse_m


def with_ratios(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add how many times more CPU COLMAP's incremental mapper took on the same pictures."""
    colmap = {
        (row["set"], row["shuffle"]): row.get("cpu_s") for row in rows if row["system"] == "colmap"
    }
    result = []
    for row in rows:
        theirs, own = colmap.get((row["set"], row["shuffle"])), row.get("cpu_s")
        ratio = theirs / own if theirs and own and row["system"] != "colmap" else float("nan")
        result.append({**row, "cpu_ratio": ratio})
    return result


def with_shuffles(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add to each shuffled run how far it is from the plain one."""
    plain = {(row["set"], row["system"]): row for row in rows if row["shuffle"] is None}
    result = []
    for row in rows:
        other = plain.get((row["set"], row["system"]))
        is_compared = row["shuffle"] is not None and other is not None
        far = shuffled_mm(row, other) if is_compared and other else float("nan")
        result.append({**row, "shuffled_mm": far})
    return result


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows as Markdown."""
    lines = with_shuffles(with_ratios(rows))
    return markdown_table(
        list(COLUMNS.values()), [[_cell(row, key) for key in COLUMNS] for row in lines]
    )


def _cell(row: dict[str, Any], key: str) -> str:
    value = row.get(key)
    if key == "set" and row["shuffle"] is not None:
        return f"{value}, shuffled {row['shuffle']}"
    if value is None:
        return ""
    return value if isinstance(value, str) else number(value)


def key_of(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return what tells runs apart."""
    return row["set"], row["system"], row["shuffle"], row["threads"], row.get("lens_sigma")


def read_rows(out: Path | None) -> list[dict[str, Any]]:
    """Return what --out holds; a line that an interrupt cut off is left out."""
    rows = []
    for line in out.read_text().splitlines() if out is not None and out.exists() else ():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return rows


def measure(
    pictures: PictureSet,
    system: str,
    *,
    shuffle: int | None,
    threads: int,
    lens_sigma: float | None = None,
) -> dict[str, Any]:
    """Run one system on a set, shuffled or not, and judge it."""
    is_ordered = pictures.is_ordered and shuffle is None
    matches_all = not is_ordered or len(pictures.pictures) <= MANY
    free = {"threads": threads, "lens_sigma": lens_sigma}
    options = {"is_ordered": is_ordered, "matches_all": matches_all, **free}
    with tempfile.TemporaryDirectory(prefix="pilotage-shuffle-") as folder:
        files = list(pictures.pictures)
        if shuffle is not None:
            files = shuffled_files(files, shuffle, Path(folder))
        row = run_in_child(pictures, files, system, options)
    head = {"set": pictures.name, "system": system, "shuffle": shuffle}
    return judged({**head, **free, **row}, pictures)


def parse_arguments() -> argparse.Namespace:
    """Return the command line's choices."""
    summary, _, rest = __doc__.partition("\n")
    parser = argparse.ArgumentParser(
        description=summary, epilog=rest, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", nargs="+", choices=READERS, default=list(READERS))
    parser.add_argument("--systems", nargs="+", choices=SYSTEMS, default=list(SYSTEMS))
    parser.add_argument("--every", type=int, default=1, help="take each n-th picture only")
    parser.add_argument("--shuffle", type=int, metavar="SEED", help="give them shuffled as well")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--lens-sigma", type=float, help="0: both hold the calibration; see above")
    parser.add_argument("--out", type=Path, help="JSON lines, one a run; what they hold is kept")
    parser.add_argument(
        "--cache",
        type=Path,
        default=Path(tempfile.gettempdir()) / "pilotage-picture-sets",
        help="where rendered sets are kept",
    )
    return parser.parse_args()


def main() -> int:
    """Run what is not yet done, and print the table of what was asked for."""
    arguments = parse_arguments()
    done = {key_of(row): row for row in read_rows(arguments.out)}
    shuffles = [None] if arguments.shuffle is None else [None, arguments.shuffle]
    rows = []
    for name in arguments.sets:
        try:
            pictures = load_set(name, arguments.cache).every(arguments.every)
        except InputError as error:
            print(error, file=sys.stderr)
            continue
        for system in arguments.systems:
            for shuffle in shuffles:
                key = (pictures.name, system, shuffle, arguments.threads, arguments.lens_sigma)
                if key not in done:
                    print(f"{key[0]}, {system}, shuffle {shuffle}", file=sys.stderr, flush=True)
                    free = {"threads": arguments.threads, "lens_sigma": arguments.lens_sigma}
                    row = measure(pictures, system, shuffle=shuffle, **free)
                    if "missing" in row:
                        print(f"missing: {row['missing']}", file=sys.stderr)
                        break
                    done[key] = row
                    _append(arguments.out, row)
                rows.append(done[key])
    print(table(rows))
    return 0


def _append(out: Path | None, row: dict[str, Any]) -> None:
    if out is not None:
        with out.open("a") as file:
            file.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    sys.exit(main())
