# SPDX-License-Identifier: Apache-2.0
"""Reconstruct: pictures in, where each was taken and what it shows out (structure from motion)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotage import PictureFate
from pilotage.behaviors.disjoint_views import disjoint_views
from pilotage.behaviors.picture_detail import has_detail
from pilotage.errors import InputError
from pilotage.models import Model
from pilotage.reasons import some_names
from pilotage.recordings.pictures import PictureError, read_grey

if TYPE_CHECKING:
    from pilotage import Camera, Reconstruction, ReconstructionConfig
    from pilotage.recordings.frames import Grey

# What a person reads of a picture without a pose, and what helps.
FATE_WORDS: Mapping[PictureFate, str] = {
    PictureFate.few_features: "shows hardly any detail: more light, less motion, another view",
    PictureFate.no_matches: "shows nothing that another picture shows: take pictures between",
    PictureFate.no_parallax: "what it shares with others was seen from one place only: a turn of"
    " the camera says nothing of distance, move it sideways",
    PictureFate.not_connected: "shares too little with the others: take pictures between",
    PictureFate.other_camera: "asks for another focal length than the others: another camera or"
    " zoom took it, reconstruct such pictures by themselves",
}

# Relative standard error of a focal length from a nominal field of view, of which a better one is
# asked for: data sheets round, mean the diagonal, or mean another resolution.
NOMINAL_FOCAL_SIGMA = 0.2
# A focal length known worse than this leaves depth against width in doubt: not a good model.
USABLE_FOCAL_SIGMA = 0.03
# More names than this in a line tell no more.
LISTED = 6
# So many standard errors off the nominal one, a focal length fits mistakes.
LARGEST_FOCAL_ERRORS = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstructed:
    """A model of the posed pictures, and what became of every picture.

    The world is the camera of the first posed picture; the unit of length is unknown.
    """

    model: Model
    names: tuple[str, ...]  # of all pictures, as given
    fates: tuple[PictureFate, ...]  # of all pictures
    result: Reconstruction
    given_focal_px: float
    focal_sigma: float  # relative standard error of the given one; 0: it was not looked for

    @property
    def is_whole(self) -> bool:
        """Tell whether every picture has a pose, in a model whose shape nothing contradicts."""
        is_posed = all(fate is PictureFate.posed for fate in self.fates)
        return is_posed and not self.result.bent_pictures and not self.disjoint

    @cached_property
    def disjoint(self) -> list[str]:
        """Names of the pictures that show next to nothing of what others show from beside them."""
        return [self.model.names[i] for i in disjoint_views(self.model)]

    @property
    def camera(self) -> Camera:
        """The camera, with the focal length and distortion found where they were looked for."""
        return self.model.cameras[0]


def shape_fault(found: Reconstructed) -> str | None:
    """Return why the shape of the model is not to be believed; None where it is."""
    bent, count = [found.names[i] for i in found.result.bent_pictures], len(found.model.names)
    if bent:
        return (
            f"{len(bent)} of {count} pictures ({bent[0]} to {bent[-1]}) fit each other"
            " much better than this model: its shape is wrong there, take pictures of things at"
            " different depths, from places nearer to each other"
        )
    if found.disjoint:
        return (
            f"{len(found.disjoint)} of {count} pictures ({some_names(found.disjoint, LISTED)})"
            " show hardly anything of what others show from beside them: mirrored, or of another"
            " thing that looks alike; reconstruct them by themselves"
        )
    return None


def focal_fault(found: Reconstructed) -> str | None:
    """Return why the focal length found is not to be believed; None where it is, or was given."""
    result = found.result
    if found.focal_sigma == 0 or not found.model.names:
        return None
    sigma, off = result.focal_sigma_px / result.focal_px, result.focal_px / found.given_focal_px - 1
    if sigma > USABLE_FOCAL_SIGMA:
        told = f"these pictures tell the focal length to {100 * sigma:.0f} % only"
    elif abs(off) > LARGEST_FOCAL_ERRORS * found.focal_sigma:
        told = f"the focal length comes out {100 * off:+.0f} % off the nominal one"
    else:
        return None
    return f"{told}, depth against width is as unsure: calibrate, or turn and move sideways"


def reconstruct(
    pictures: Sequence[Path],
    *,
    camera: Camera,
    ordered: bool = True,
    config: ReconstructionConfig | None = None,
) -> Reconstructed:
    """Return the model of picture files, all taken by `camera`.

    `ordered` pictures follow each other; the order does not change what is found, only how many
    of very many pictures are compared. InputError names a picture that cannot be read or has
    another size. What cannot be solved is said in `fates`.
    """
    greys = read_greys(pictures, camera)
    return solve(greys, _names(pictures), camera=camera, ordered=ordered, config=config)


def solve(
    greys: Sequence[Grey],
    names: Sequence[str],
    *,
    camera: Camera,
    ordered: bool = True,
    config: ReconstructionConfig | None = None,
) -> Reconstructed:
    """Return the model of pictures in memory, (height, width) uint8, called `names`."""
    from pilotage import ReconstructionConfig, _core

    result = _core.reconstruct(
        pictures=list(greys),
        cameras=[camera],
        camera_of_picture=[0] * len(greys),
        is_ordered=ordered,
        config=config or ReconstructionConfig(),
    )
    return Reconstructed(
        model=model_of(names, [_as_found(camera, result)], [0] * len(names), result),
        names=tuple(names),
        fates=tuple(map(_cause, result.fates, greys)),
        result=result,
        given_focal_px=camera.fx_px,
        focal_sigma=0.0 if config is None else float(config.to_dict()["focal_sigma"]),
    )


def _cause(fate: PictureFate, grey: Grey) -> PictureFate:
    """Return what is behind a picture's fate: where there is but noise, nothing can be shared."""
    is_alone = fate is PictureFate.no_matches
    return PictureFate.few_features if is_alone and not has_detail(grey) else fate


def _as_found(camera: Camera, result: Reconstruction) -> Camera:
    """Return the camera with the focal length and distortion found, where they were looked for."""
    if result.focal_sigma_px == 0:
        return camera
    from pilotage import Camera

    is_bent = result.radial != 0
    return Camera(
        width_px=camera.width_px,
        height_px=camera.height_px,
        fx_px=result.focal_px,
        fy_px=camera.fy_px / camera.fx_px * result.focal_px,
        cx_px=camera.cx_px,
        cy_px=camera.cy_px,
        distortion="brown" if is_bent else "none",
        coefficients=[result.radial, 0.0, 0.0, 0.0] if is_bent else [],
    )


def read_greys(
    pictures: Sequence[Path], camera: Camera, *, first: Grey | None = None
) -> list[Grey]:
    """Return the pictures of files in grey, the `first` one where it was read already.

    InputError names one that is not whole or has another size than its camera.
    """
    known = [] if first is None else [first]
    try:
        with ThreadPoolExecutor(max_workers=2) as pool:
            greys = [*known, *pool.map(read_grey, pictures[len(known) :])]
    except PictureError as error:
        raise InputError(str(error)) from None
    for file, grey in zip(pictures, greys, strict=True):
        check_size(file, grey, camera)
    return greys


def check_size(name: Path | str, grey: Grey, camera: Camera) -> None:
    """Raise InputError unless a picture called `name` has its camera's size."""
    if grey.shape != (camera.height_px, camera.width_px):
        raise InputError(
            f"{name}: {grey.shape[1]}x{grey.shape[0]} pixels, its camera has"
            f" {camera.width_px}x{camera.height_px}; give pictures of one camera, calibrated at"
            " their size"
        )


def _names(pictures: Sequence[Path]) -> tuple[str, ...]:
    """Return file names where they differ, else whole paths."""
    short = tuple(file.name for file in pictures)
    return short if len(set(short)) == len(short) else tuple(str(file) for file in pictures)


def model_of(
    names: Sequence[str],
    cameras: Sequence[Camera],
    camera_of_picture: Sequence[int],
    result: Reconstruction,
) -> Model:
    """Return the posed pictures of a result, its points and views as a model."""
    posed = [i for i, pose in enumerate(result.camera_from_world) if pose is not None]
    index = np.full(len(names), -1, dtype=np.int64)
    index[posed] = np.arange(len(posed))
    poses: list[Any] = [result.camera_from_world[i] for i in posed]
    return Model(
        cameras=tuple(cameras),
        names=tuple(names[i] for i in posed),
        camera_index=np.array([camera_of_picture[i] for i in posed], dtype=np.int64),
        camera_from_world=tuple(poses),
        points_in_world=result.points_in_world,
        colors=np.repeat(result.greys[:, None], 3, axis=1),
        picture=index[result.view_pictures],
        point=result.view_points.astype(np.int64),
        pixel_px=result.view_px.astype(np.float64),
    )
