# SPDX-License-Identifier: Apache-2.0
"""One system over one set of pictures in a process of its own, so that its costs can be told apart.

`reconstruction.py` starts this with a job as JSON. Timed is from the list of files to the model in
memory: decoding counts, importing and writing do not.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from run_system import memory_mb

from pilotage import Camera, ReconstructionConfig
from pilotage.models import Model, read_colmap_binary, write_colmap_binary

MISSING = 3  # exit code of a system that is not there
OVERLAP = 10  # pictures that COLMAP compares each with, where their order means something


@dataclass(frozen=True)
class Options:
    """What a system is told besides pictures and camera."""

    is_ordered: bool  # neighbours in the list were taken one after the other
    matches_all: bool  # every picture is compared with every other
    threads: int
    # 0: the calibration is held; more: it may be improved, by COLMAP freely; None: Pilotage does as
    # it does for its users, COLMAP holds it.
    lens_sigma: float | None = None
    seed: int = 0

    @property
    def frees_colmap(self) -> bool:
        """Tell whether COLMAP may improve the calibration."""
        return bool(self.lens_sigma)


class MissingSystemError(Exception):
    """The system cannot be imported; the message says why."""


# What a system found, taken out of its own memory after the clock has stopped: the largest model,
# None where there is none, and a note.
Found = Callable[[], tuple[Model | None, str]]
# From pictures, camera, options and a folder for what lies between.
System = Callable[[Sequence[Path], Camera, Options, Path], Found]


def run_ours(pictures: Sequence[Path], camera: Camera, options: Options, _: Path) -> Found:
    """Return what Pilotage makes of the pictures."""
    given: dict[str, Any] = {}
    if options.lens_sigma is not None:
        given["config"] = ReconstructionConfig.from_dict({"lens_sigma": options.lens_sigma})
    said = _ours()(pictures, camera=camera, ordered=options.is_ordered, **given)
    if isinstance(said, Model):
        return lambda: (said, "")
    return lambda: (said.model, str(getattr(said, "reason", "")))


def _ours() -> Callable[..., Any]:
    try:
        from pilotage.behaviors.reconstruct import reconstruct
    except ImportError as error:
        raise MissingSystemError(f"pilotage: {error}") from error
    return reconstruct


def run_colmap(pictures: Sequence[Path], camera: Camera, options: Options, scratch: Path) -> Found:
    """Return what COLMAP's incremental mapper makes of the pictures."""
    pycolmap = _pycolmap()
    database, folder = _matched(pictures, camera, options, scratch)
    pipeline = pycolmap.IncrementalPipelineOptions()
    pipeline.num_threads, pipeline.random_seed = options.threads, options.seed
    is_refined = options.frees_colmap
    pipeline.ba_refine_focal_length = is_refined
    pipeline.ba_refine_principal_point = False
    pipeline.ba_refine_extra_params = is_refined
    pipeline.mapper.abs_pose_refine_focal_length = is_refined
    pipeline.mapper.abs_pose_refine_extra_params = is_refined
    models = pycolmap.incremental_mapping(database, folder, scratch, pipeline)
    return lambda: _largest(models, scratch)


def run_colmap_global(
    pictures: Sequence[Path], camera: Camera, options: Options, scratch: Path
) -> Found:
    """Return what COLMAP's global mapper makes of the pictures."""
    pycolmap = _pycolmap()
    database, folder = _matched(pictures, camera, options, scratch)
    pipeline = pycolmap.GlobalPipelineOptions()
    pipeline.num_threads, pipeline.random_seed = options.threads, options.seed
    adjustment = pipeline.mapper.bundle_adjustment
    adjustment.refine_focal_length = options.frees_colmap
    adjustment.refine_principal_point = False
    adjustment.refine_extra_params = options.frees_colmap
    models = pycolmap.global_mapping(database, folder, scratch, pipeline)
    return lambda: _largest(models, scratch)


def _pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError as error:
        raise MissingSystemError(f"colmap: {error}") from error
    return pycolmap


def _matched(
    pictures: Sequence[Path], camera: Camera, options: Options, scratch: Path
) -> tuple[Path, Path]:
    """Extract SIFT features and match them; return the database and the pictures' folder."""
    pycolmap = _pycolmap()
    pycolmap.logging.minloglevel = pycolmap.logging.WARNING
    pycolmap.set_random_seed(options.seed)
    database, folder = scratch / "database.db", pictures[0].parent
    reader, extraction = pycolmap.ImageReaderOptions(), pycolmap.FeatureExtractionOptions()
    reader.camera_model, parameters = _colmap_camera(camera, is_refined=options.frees_colmap)
    reader.camera_params = ",".join(repr(value) for value in parameters)
    extraction.num_threads = options.threads
    pycolmap.extract_features(
        database,
        folder,
        image_names=[picture.name for picture in pictures],
        camera_mode=pycolmap.CameraMode.SINGLE,
        reader_options=reader,
        extraction_options=extraction,
    )
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = options.threads
    if options.matches_all:
        pycolmap.match_exhaustive(database, matching_options=matching)
    else:
        pairing = pycolmap.SequentialPairingOptions()
        pairing.overlap = OVERLAP
        pycolmap.match_sequential(database, matching_options=matching, pairing_options=pairing)
    return database, folder


def _colmap_camera(camera: Camera, *, is_refined: bool) -> tuple[str, tuple[float, ...]]:
    if is_refined and camera.distortion == "none" and camera.fx_px == camera.fy_px:
        return "SIMPLE_RADIAL", (camera.fx_px, camera.cx_px, camera.cy_px, 0.0)
    from pilotage.models.colmap_tables import camera_row

    row = camera_row(1, camera)
    return row.model, row.parameters


def _largest(models: dict[int, Any], scratch: Path) -> tuple[Model | None, str]:
    """Return the model with the most pictures, and what happened to the others."""
    if not models:
        return None, "no model"
    sizes = {number: model.num_reg_images() for number, model in models.items()}
    largest = max(sizes, key=lambda number: (sizes[number], -number))
    folder = scratch / "largest"
    folder.mkdir()
    models[largest].write_binary(folder)
    others = sorted((sizes[number] for number in sizes if number != largest), reverse=True)
    return read_colmap_binary(folder), f"other models: {others}" if others else ""


SYSTEMS: dict[str, System] = {
    "pilotage": run_ours,
    "colmap": run_colmap,
    "colmap-global": run_colmap_global,
}


def cpu_s() -> float:
    """Return the CPU time of this process, all its threads, and of its children that ended."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def run(job: dict[str, Any], out: Path) -> dict[str, Any]:
    """Run what the job says; write the model into `out` and return the costs."""
    pictures, camera = [Path(name) for name in job["pictures"]], Camera(**job["camera"])
    options = Options(**job["options"])
    # Whatever a system starts by itself finds no more processors than that.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.threads])
    if job["system"] == "pilotage":  # imported before the clock starts
        _ours()
    else:
        _pycolmap()
    cpu, wall = cpu_s(), time.perf_counter()
    found = SYSTEMS[job["system"]](pictures, camera, options, out)
    costs = {"cpu_s": cpu_s() - cpu, "wall_s": time.perf_counter() - wall}
    costs["peak_mb"] = memory_mb("VmHWM")
    model, note = found()
    if model is not None:
        write_colmap_binary(out / "model", model)
    return {**costs, "note": note}


def main() -> int:
    """Read the job from standard input, write `costs.json` into the folder given."""
    out = Path(sys.argv[1])
    try:
        costs = run(json.load(sys.stdin), out)
    except MissingSystemError as missing:
        print(missing, file=sys.stderr)
        return MISSING
    (out / "costs.json").write_text(json.dumps(costs))
    sys.stdout.flush()
    # Not through the interpreter's end: libraries take their time to free what they hold.
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
