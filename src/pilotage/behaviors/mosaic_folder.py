# SPDX-License-Identifier: Apache-2.0
"""A stop of a recording, or a folder of pictures, in; a folder with their wide view out."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from pilotage import __version__
from pilotage.atomic_files import write_atomically, write_each
from pilotage.behaviors.model_folder import camera_of, read_first
from pilotage.behaviors.mosaic import Link
from pilotage.behaviors.reconstruct import read_greys
from pilotage.behaviors.stops import read_stop
from pilotage.behaviors.sweep import View
from pilotage.behaviors.wide_view import Moving, WideView, look_wide
from pilotage.errors import InputError
from pilotage.provenance import program_commit
from pilotage.recordings.motion import find_mcap
from pilotage.recordings.pictures import list_pictures
from pilotage.recordings.single import open_pictures
from pilotage.results import SUMMARY, check_free, claim_folder, write_json

if TYPE_CHECKING:
    from pilotage.recordings.frames import Grey

MOSAIC, MOSAIC_MOVING, TABLE = "mosaic.png", "mosaic_moving_centres.png", "features.csv"
COLUMNS = "picture,x_px,y_px,fixed_x_px,fixed_y_px,moving_x_px,moving_y_px,distance_m,is_measured"
MOST_PICTURES = 60


def mosaic_folder(  # noqa: PLR0913, all by name
    *,
    source: Path,
    out: Path,
    stop: int | None = None,
    calibration: Path | None = None,
    fov_deg: float | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Write the wide view of a recording's stop, or of a folder's pictures, to `out`.

    Returns the summary. A recording brings its own calibration, and its head's angles for the
    model with moving centres; pictures need one, in a file beside them, or a field of view.
    InputError for what cannot be a call, RunError where a file cannot be written.
    """
    is_recording = find_mcap(source) is not None
    if is_recording and (calibration is not None or fov_deg is not None):
        raise InputError(
            f"{source}: a recording holds its own calibration; leave out --calibration and"
            " --fov-deg"
        )
    if not is_recording and stop is not None:
        raise InputError(f"{source}: only a recording has stops; leave out --stop")
    check_free(out, overwrite=overwrite)
    start, start_cpu = time.perf_counter(), time.process_time()
    told: dict[str, Any] = {
        "source": str(source.resolve()),
        "stop": None,
        "bad_pictures": [],
        "other_pictures": 0,
    }
    if is_recording:
        found = read_stop(open_pictures(source), stop or 0)
        views, others, floor_z_m = found.views, found.others, found.floor_z_m
        told |= {"stop": found.number, "bad_pictures": found.bad, "other_pictures": len(others)}
    else:
        views, others, floor_z_m = _views_of(source, calibration, fov_deg), [], None
    _check_count(views, source)
    wide = look_wide(views, others=others, floor_z_m=floor_z_m)
    cost = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - start_cpu}
    summary = _summary(wide) | told | cost
    claim_folder(out, (MOSAIC, MOSAIC_MOVING, TABLE))
    errors = write_each(_writes(out, wide, summary))
    if errors:
        raise errors[0]
    return summary


def _views_of(folder: Path, calibration: Path | None, fov_deg: float | None) -> list[View]:
    files = list_pictures(folder)
    if not files:
        raise InputError(f"{folder}: holds no pictures; give a folder of them, or a recording")
    first = read_first(files[0])
    camera = camera_of(first, folder, calibration, fov_deg)
    greys = read_greys(files, camera, first=first)
    return [
        View(name=file.name, grey=grey, lens=camera)
        for file, grey in zip(files, greys, strict=True)
    ]


def _check_count(views: Sequence[View], source: Path) -> None:
    if not 2 <= len(views) <= MOST_PICTURES:
        raise InputError(
            f"{source}: {len(views)} picture{'' if len(views) == 1 else 's'}; a wide view takes 2"
            f" to {MOST_PICTURES}, say the six of a head's sweep"
        )


def _summary(wide: WideView) -> dict[str, Any]:
    joined, virtual = wide.joined, wide.virtual
    reason, remedy = "", ""
    if wide.stitched is None:
        reason = "no two of the pictures could be joined by a homography"
        remedy = "let neighbours overlap by a third, and look at things with detail, not too near"
    return {
        "program": "pilotage", "version": __version__, "commit": program_commit(), "state": "done",
        "status": "joined" if wide.stitched or wide.moving else "refused",
        "reason": reason, "remedy": remedy,
        "middle": wide.views[joined.middle].name, "joined": joined.joined,
        "pictures": [_picture(wide, number) for number in range(len(wide.views))],
        "links": [_link(wide, link) for link in joined.links],
        "virtual_camera": {
            "width_px": virtual.width_px, "height_px": virtual.height_px,
            "focal_px": virtual.fx_px, "cx_px": virtual.cx_px, "cy_px": virtual.cy_px,
        },
        "features": sum(len(f.pixels) for f in wide.features),
        "mosaic": _shares(wide),
        "moving_centres": None if wide.moving is None else _moving(wide, wide.moving),
    }  # fmt: skip


def _picture(wide: WideView, number: int) -> dict[str, Any]:
    view, map_ = wide.views[number], wide.joined.middle_from_view[number]
    return {
        "name": view.name, "camera": view.camera,
        "yaw_deg": None if view.head is None else math.degrees(view.head.yaw_rad),
        "pitch_deg": None if view.head is None else math.degrees(view.head.pitch_rad),
        "features": len(wide.features[number].pixels),
        "is_joined": map_ is not None, "reason": wide.joined.reasons[number],
        # Of unit rays, up to a factor.
        "middle_from_picture": None if map_ is None else map_.tolist(),
    }  # fmt: skip


def _link(wide: WideView, link: Link) -> dict[str, Any]:
    return {
        "a": wide.views[link.a].name, "b": wide.views[link.b].name, "matches": link.matches,
        "inliers": link.inliers, "rms_px": link.rms_px, "is_used": link.b_from_a is not None,
        "reason": link.reason,
    }  # fmt: skip


def _shares(wide: WideView) -> dict[str, float] | None:
    if wide.stitched is None:
        return None
    return {"seen": wide.stitched.share_seen, "inpainted": wide.stitched.share_filled}


def _moving(wide: WideView, moving: Moving) -> dict[str, Any]:
    refined = moving.refined
    turned_deg = np.degrees(refined.turned_rad).tolist()
    return {
        "points": len(refined.points_in_stop), "rms_px": refined.rms_px,
        "reason": refined.reason,
        "measured_features": int(sum(seen.is_measured.sum() for seen in moving.seen)),
        "turned": [
            {"picture": view.name, "left_deg": left, "down_deg": down}
            for view, (left, down) in zip(wide.views, turned_deg, strict=False)
        ],
    }  # fmt: skip


def _writes(out: Path, wide: WideView, summary: dict[str, Any]) -> list[Callable[[], object]]:
    writes: list[Callable[[], object]] = []
    moving = None if wide.moving is None else wide.moving.stitched
    for name, stitched in ((MOSAIC, wide.stitched), (MOSAIC_MOVING, moving)):
        if stitched is not None:
            writes.append(functools.partial(write_atomically, out / name, _png(stitched.grey)))
    if summary["status"] == "joined":
        writes.append(functools.partial(write_atomically, out / TABLE, _table(wide)))
    # Last: a summary that says "done" vouches for the rest.
    return [*writes, functools.partial(write_json, out / SUMMARY, summary)]


def _png(grey: Grey) -> bytes:
    return cv2.imencode(".png", grey)[1].tobytes()


def _table(wide: WideView) -> str:
    lines = [COLUMNS]
    for number, (view, of_view) in enumerate(zip(wide.views, wide.features, strict=True)):
        count = len(of_view.pixels)
        moving, distance, measured = (
            np.full((count, 2), np.nan),
            np.full(count, np.nan),
            [""] * count,
        )
        if wide.moving is not None:
            seen = wide.moving.seen[number]
            moving, distance = wide.moving.pixels[number], seen.distance_m
            measured = [str(int(value)) for value in seen.is_measured]
        columns = np.column_stack([of_view.pixels, wide.fixed_px[number], moving, distance])
        for row, flag in zip(columns, measured, strict=True):
            cells = ",".join("" if math.isnan(value) else f"{value:.6g}" for value in row)
            lines.append(f"{_quoted(view.name)},{cells},{flag}")
    return "\n".join(lines) + "\n"


def _quoted(name: str) -> str:
    """Return a cell as CSV wants it (RFC 4180): file names may hold anything."""
    if not set(name) & set(',"\n\r'):
        return name
    return '"' + name.replace('"', '""') + '"'
