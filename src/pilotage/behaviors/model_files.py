# SPDX-License-Identifier: Apache-2.0
"""What every model's folder holds, of a folder of pictures or of a recorded walk."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from pilotage import LengthSource, PictureFate, __version__
from pilotage.atomic_files import write_atomically
from pilotage.behaviors.reconstruct import FATE_WORDS
from pilotage.models import Model, write_colmap_binary, write_colmap_text, write_ply, write_tum
from pilotage.provenance import program_commit
from pilotage.results import (
    CLOUD,
    CLOUD_WITH_CAMERAS,
    COLMAP_BINARY,
    COLMAP_TEXT,
    CONFIG,
    FILES,
    TUM,
)

if TYPE_CHECKING:
    from pilotage import LengthEstimate, Reconstruction, ReconstructionConfig

MODEL_FILES = (*FILES, CLOUD_WITH_CAMERAS, f"{COLMAP_TEXT}/*.*", f"{COLMAP_BINARY}/*.*")


# What a person reads of what tells how long a metre is.
LENGTH_WORDS: Mapping[LengthSource, str] = {
    LengthSource.joints: "head and legs, which move the cameras",
    LengthSource.steps: "the steps it believes to have taken",
    LengthSource.ground: "the cameras' height above the floor",
    LengthSource.marks: "marks of a known size",
}


def length_summary(
    sources: Sequence[LengthEstimate], factor: float, sigma: float
) -> dict[str, Any]:
    """Return by what each source would have lengths multiplied, and what was done."""
    told = [
        {
            "source": LENGTH_WORDS[one.source],
            "factor": one.factor,
            "sigma": one.sigma,
            "count": one.count,
        }
        for one in sources
    ]
    return {"sources": told, "factor": factor, "sigma": sigma}


def model_summary(  # noqa: PLR0913, all that is told of a model
    *,
    source: Path,
    verdict: str,
    names: Sequence[str],
    model: Model,
    result: Reconstruction,
    fates: Sequence[PictureFate],
    unit: str,
    ordered: bool,
) -> dict[str, Any]:
    """Return what summary.json says of any model; `names` are of all pictures, posed or not."""
    return {
        "program": "pilotage", "version": __version__, "commit": program_commit(),
        "state": "done", "source": str(source.resolve()), "verdict": verdict,
        "pictures": len(names), "posed": len(model.names),
        "without_pose": {
            name: FATE_WORDS[fate]
            for name, fate in zip(names, fates, strict=True)
            if fate is not PictureFate.posed
        },
        "points": len(model.points_in_world), "observations": len(model.picture),
        "rms_px": result.rms_px, "features": result.feature_count,
        "matched_pairs": result.pair_count, "tracks": result.track_count, "unit": unit,
        "ordered": ordered,
    }  # fmt: skip


def model_writes(
    out: Path,
    model: Model,
    times_ns: dict[str, int],
    config: ReconstructionConfig,
    camera_names: Sequence[str] = (),
) -> list[Callable[[], object]]:
    """Return what writes the settings, and the model where it has pictures; times by name.

    Cameras with names, those of `model.cameras`, have a trajectory each: two that look at one time
    would be two poses of it.
    """
    settings = yaml.safe_dump(config.to_dict(), sort_keys=False)
    writes: list[Callable[[], object]] = [
        functools.partial(write_atomically, out / CONFIG, settings)
    ]
    if model.names:
        posed_ns = [times_ns[name] for name in model.names]
        writes += [
            functools.partial(write_colmap_text, out / COLMAP_TEXT, model),
            functools.partial(write_colmap_binary, out / COLMAP_BINARY, model),
            functools.partial(write_ply, out / CLOUD, model),
            functools.partial(write_ply, out / CLOUD_WITH_CAMERAS, model, with_cameras=True),
        ]
        of_camera: list[tuple[str, int | None]] = [
            (f"trajectory_{name}_tum.txt", i) for i, name in enumerate(camera_names)
        ]
        writes += [
            functools.partial(write_tum, out / file, model, posed_ns, camera=camera)
            for file, camera in of_camera or [(TUM, None)]
        ]
    return writes
