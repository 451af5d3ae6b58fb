# SPDX-License-Identifier: Apache-2.0
"""A folder of pictures in, a folder with their model out: what `pilotage reconstruct` does."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from pilotage import PictureFate
from pilotage.atomic_files import write_atomically, write_each
from pilotage.behaviors.model_files import MODEL_FILES, length_summary, model_summary, model_writes
from pilotage.behaviors.reconstruct import (
    FATE_WORDS,
    NOMINAL_FOCAL_SIGMA,
    Reconstructed,
    focal_fault,
    read_greys,
    shape_fault,
    solve,
)
from pilotage.behaviors.square_marks import MarkSize, find_marks, no_mark
from pilotage.calibration.one_camera import camera_of_view, load_camera
from pilotage.calibration.own import camera_values
from pilotage.errors import InputError
from pilotage.models import Model
from pilotage.recordings.pictures import PictureError, list_pictures, read_color, read_grey
from pilotage.recordings.times import NS_PER_S, times_in_names
from pilotage.results import (
    CALIBRATION,
    SUMMARY,
    check_free,
    claim_folder,
    write_json,
)

if TYPE_CHECKING:
    from pilotage import Camera, LengthEstimate, ReconstructionConfig
    from pilotage.recordings.frames import Grey


def reconstruct_folder(  # noqa: PLR0913, all by name
    *,
    pictures: Path,
    out: Path,
    calibration: Path | None,
    fov_deg: float | None,
    ordered: bool,
    config: ReconstructionConfig,
    refine_fov: bool = False,
    marks: MarkSize | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Reconstruct the pictures of a folder, write the folder `out`, and return its summary.

    The camera is that of `calibration`, of a file beside the pictures, or a pinhole of `fov_deg`.
    `refine_fov` looks for a better field of view than `fov_deg`. `marks` are squares of a known
    side in the pictures: lengths are metres then.
    InputError where there are no pictures, no camera, or `out` is not free; RunError where a file
    cannot be written: what can be is.
    """
    files = list_pictures(pictures)
    if not files:
        raise InputError(f"{pictures}: holds no pictures; give a folder of them")
    first = read_first(files[0])
    camera = camera_of(first, pictures, calibration, fov_deg)
    config = with_refinement(config, fov_deg, refine_fov=refine_fov)
    _check_count(pictures, len(files), config)
    check_free(out, overwrite=overwrite)
    start, start_cpu = time.perf_counter(), time.process_time()
    greys = read_greys(files, camera, first=first)
    claim_folder(out, MODEL_FILES)
    names = [file.name for file in files]
    found = solve(greys, names, camera=camera, ordered=ordered, config=config)
    length = None if marks is None else _length(found, greys, marks)
    cost = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - start_cpu}
    summary = _summary(pictures, found, ordered=ordered) | cost
    if marks is not None:
        summary |= _length_facts(length, marks)
    metric = found.model if length is None else found.model.scaled(length.factor)
    model = coloured(metric, {file.name: file for file in files})
    times_ns = picture_times(files)
    errors = write_each(_writes(out, model, found.camera, config, summary, times_ns))
    if errors:
        raise errors[0]
    return summary


def _check_count(pictures: Path, count: int, config: ReconstructionConfig) -> None:
    least = config.to_dict()["min_track_length"]
    if 1 < count < least:
        raise InputError(
            f"{pictures}: {count} pictures, and what fewer than {least} show does not count"
            f" (min_track_length); give more, or --set min_track_length={count}"
        )


def read_first(file: Path) -> Grey:
    """Return the picture that tells the size of all; InputError where it is none."""
    try:
        return read_grey(file)
    except PictureError as error:
        raise InputError(str(error)) from None


def camera_of(first: Grey, folder: Path, calibration: Path | None, fov_deg: float | None) -> Camera:
    """Return the camera of a folder's pictures: of a calibration, or of a field of view.

    `first` is one of them; they are all of its size.
    """
    if calibration is not None and fov_deg is not None:
        raise InputError("--calibration and --fov-deg: give one of them")
    size_px = first.shape[1], first.shape[0]
    if fov_deg is not None:
        return camera_of_view(size_px, fov_deg)
    try:
        return load_camera(calibration or folder, image_size_px=size_px)
    except InputError:
        if calibration is not None:
            raise
    raise InputError(
        f"{folder}: holds no calibration of its camera; give --calibration, or --fov-deg with its"
        " horizontal field of view"
    )


def with_refinement(
    config: ReconstructionConfig, fov_deg: float | None, *, refine_fov: bool
) -> ReconstructionConfig:
    """Return the configuration that looks for a better field of view, where that is asked for.

    InputError where there is none to begin with: a calibration knows better.
    """
    values = config.to_dict()
    is_set = values["focal_sigma"] > 0
    wanted = refine_fov or is_set
    if wanted and fov_deg is None:
        raise InputError(
            "--refine-fov and focal_sigma > 0 improve on a nominal field of view: give --fov-deg,"
            " or --set focal_sigma=0 where the camera is known"
        )
    if not refine_fov or is_set:
        return config
    return type(config).from_dict({**values, "focal_sigma": NOMINAL_FOCAL_SIGMA})


def _length(found: Reconstructed, greys: Sequence[Grey], marks: MarkSize) -> LengthEstimate | None:
    """Return by what lengths are to be multiplied to be metres, None where no mark tells."""
    from pilotage import _core

    account = find_marks(greys, [found.camera], [0] * len(greys), marks)
    poses = dict(zip(found.model.names, found.model.camera_from_world, strict=True))
    return _core.mark_length(
        marks=account, camera_from_world=[poses.get(name) for name in found.names]
    )


def _length_facts(length: LengthEstimate | None, marks: MarkSize) -> dict[str, Any]:
    if length is not None:
        return {"unit": "m", "lengths": length_summary([length], length.factor, length.sigma)}
    return {"length_fault": f"{no_mark(marks)}: lengths are in the model's own unit"}


def _focal_summary(found: Reconstructed) -> dict[str, Any]:
    result = found.result
    if not found.model.names or result.focal_sigma_px == 0:
        return {"focal_px": None, "focal_sigma_px": None, "fov_deg": None}
    half = 0.5 * found.camera.width_px / result.focal_px
    told: dict[str, Any] = {
        "focal_px": result.focal_px,
        "focal_sigma_px": result.focal_sigma_px,
        "fov_deg": math.degrees(2 * math.atan(half)),
    }
    if result.radial != 0:
        told["lens_fault"] = (
            f"the pictures are bent by {result.corner_shift_px:.1f} px in their corners,"
            f" which their calibration does not know: taken with a focal length of"
            f" {result.focal_px:.1f} px and a radial distortion of {result.radial:.4f}; calibrate"
            " anew, or hold what was given with --set lens_sigma=0"
        )
    return told


def _summary(pictures: Path, found: Reconstructed, *, ordered: bool) -> dict[str, Any]:
    told = model_summary(
        source=pictures, verdict=verdict(found), names=found.names, model=found.model,
        result=found.result, fates=found.fates, unit="unknown", ordered=ordered,
    )  # fmt: skip
    return told | _focal_summary(found)


def verdict(found: Reconstructed) -> str:
    """Return in a line what the reconstruction amounts to."""
    if (fault := shape_fault(found) or focal_fault(found)) is not None:
        return f"unsure: {fault}"
    if found.is_whole:
        return "whole"
    if found.model.names:
        return f"partial: {len(found.model.names)} of {len(found.names)} pictures"
    if len(found.names) < 2:
        return "one picture says nothing of distance: give three or more"
    fates = [fate for fate in found.fates if fate is not PictureFate.posed]
    commonest = max(set(fates), key=lambda fate: (fates.count(fate), fate.value))
    return FATE_WORDS[commonest]


def picture_times(files: Sequence[Path]) -> dict[str, int]:
    """Return nanoseconds by name: what the names tell, else the place among them as seconds."""
    told = times_in_names([file.stem for file in files], files[0].parent)
    # Two pictures of one time would leave a trajectory in which a time has two poses.
    if told is None or len(set(told)) < len(told):
        told = [i * NS_PER_S for i in range(len(files))]
    return {file.name: time_ns for file, time_ns in zip(files, told, strict=True)}


def _writes(  # noqa: PLR0913, PLR0917, all that is written
    out: Path,
    model: Model,
    camera: Camera,
    config: ReconstructionConfig,
    summary: dict[str, Any],
    times_ns: dict[str, int],
) -> list[Callable[[], object]]:
    text = yaml.safe_dump(camera_values(camera), sort_keys=False)
    return [
        functools.partial(write_atomically, out / CALIBRATION, text),
        *model_writes(out, model, times_ns, config),
        # Last: a summary that says "done" vouches for the rest.
        functools.partial(write_json, out / SUMMARY, summary),
    ]


def coloured(model: Model, files: dict[str, Path]) -> Model:
    """Return the model with each point in the colour of the last picture that shows it."""
    colors = model.colors.copy()
    for i, name in enumerate(model.names):
        if name not in files:
            continue
        try:
            picture = read_color(files[name])
        except PictureError:
            continue  # It was read a moment ago; the points keep their grey.
        rows = np.flatnonzero(model.picture == i)
        x, y = np.rint(model.pixel_px[rows]).astype(int).T
        x, y = x.clip(0, picture.shape[1] - 1), y.clip(0, picture.shape[0] - 1)
        colors[model.point[rows]] = picture[y, x]
    return Model(**{**vars(model), "colors": colors})
