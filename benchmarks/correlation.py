# SPDX-License-Identifier: Apache-2.0
"""How good and how fast is the correlation that looks down?

    python benchmarks/correlation.py [PHOTOGRAPH...]

Each surface, photographs and our rendered grounds, is seen twice through the same sensor: moved by
parts of pixels, and by turns up to 30 degrees with shifts up to a third of the picture. Printed is
how well nodes of a grid are found by correlation and by the least-squares fit that follows, and
whether the turn and shift of the whole picture are found without a guess. Where $PILOTAGE_DATA
holds `nao_marks`, the grass below a real Nao's lower camera is one of the surfaces, at each of its
standpoints. Then the kernel is timed against OpenCV's matchTemplate and phaseCorrelate on the same
patches, in turns, on one thread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from decoded import DATA_FOLDER
from surfaces import PIXELS_M, Array, View, camera_of, ground_view, photograph_view, read_grey

from pilotage import _core
from pilotage.simulation.surfaces import SURFACES

Exposing = Callable[[Array, int], Array]

REACH, STEP, MARGIN = 8, 16, 48
# What the Nao sees of the field above its feet, in rows; all that a view turned by 30 degrees and
# shifted by a third of its side covers lies within.
FIELD_ROWS, FIELD_SIDE = 400, 200
RIGHT_PX, RIGHT_DEG = 8.0, 4.0
TRIALS = 12


def nodes_found(first: Array, second: Array, shift: Array) -> dict[str, float]:
    """Find the nodes of a grid again; return how well."""
    grid = np.arange(MARGIN, len(first) - MARGIN, STEP, dtype=np.float32)
    nodes = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    peaks, rivals, coarse, kept = [], [], [], []
    for node in nodes:
        # The patch's middle lies between its pixels 7 and 8.
        x0, y0 = (int(v) - 7 - REACH for v in node)
        places = 2 * REACH + 1
        try:
            scores = _core.correlate(
                image=first, centre_px=node + 0.5, other=second, x_first=x0, y_first=y0,
                width=places, height=places,
            )  # fmt: skip
        except ValueError:  # a patch without texture
            continue
        y, x = np.unravel_index(np.argmax(scores), scores.shape)
        others = scores.copy()
        others[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4] = -1
        peaks.append(scores[y, x])
        rivals.append(others.max() / scores[y, x])
        coarse.append(np.array([x, y]) - REACH - shift)
        kept.append(node)
    points = np.array(kept, np.float32)
    guesses = np.ascontiguousarray(points + np.round(np.array(coarse) + shift), np.float32)
    fine = _core.refine_matches(
        a=first, points_in_a_px=points, b=second, guesses_in_b_px=guesses
    )  # fmt: skip
    errors = (fine["position_px"] - points - shift)[fine["ok"].astype(bool)]
    near = errors[np.abs(errors).max(axis=1) < 1]
    return {
        "peak": float(np.median(peaks)),
        "rival": float(np.quantile(rivals, 0.95)),
        "right": float(np.mean(np.abs(np.array(coarse)).max(axis=1) < 1)),
        "rms_px": float(np.sqrt(np.mean(near**2))),
        "bias_px": float(np.abs(near.mean(axis=0)).max()),
    }


def motions_found(view: View, expose: Exposing, random: np.random.Generator) -> int:
    """Return how many of TRIALS turns and shifts of the whole picture are found."""
    first, found = expose(view(0, 0, 0), 1), 0
    side = len(first)
    centre = np.full(2, (side - 1) / 2)
    for trial in range(TRIALS):
        turn_deg = random.uniform(-30, 30)
        shift = random.uniform(-0.3, 0.3, 2) * side
        second = expose(view(*shift, turn_deg), 100 + trial)
        motions = _core.find_plane_motions(reference=first, current=second, centre_px=centre)
        found += bool(motions) and (
            np.linalg.norm(motions[0].shift_px - shift) < RIGHT_PX
            and abs(np.degrees(motions[0].turn_rad) - turn_deg) < RIGHT_DEG
        )
    return found


def measure(name: str, view: View) -> None:
    """Print a surface's line of the table."""
    shift = np.array([3.4, -2.6])
    expose = camera_of(view)
    first, second = expose(view(0, 0, 0), 1), expose(view(*shift, 0), 2)
    found = nodes_found(first, second, shift)
    right = motions_found(view, expose, np.random.default_rng(3))
    print(
        f"| {name} | {found['peak']:.2f} | {found['rival']:.2f} | {100 * found['right']:.0f} % | "
        f"{found['rms_px']:.3f} | {found['bias_px']:.3f} | {right} of {TRIALS} | "
        f"{_core.self_similarity(first):.2f} |",
        flush=True,
    )


def field_views() -> dict[str, View]:
    """Return views of the field below the Nao by name; none where the pictures are not there."""
    return {
        f"nao_marks, {path.parent.name}": photograph_view(
            read_grey(path.read_bytes())[:FIELD_ROWS], FIELD_SIDE
        )
        for path in sorted(DATA_FOLDER.glob("nao_marks/*/imagebottom.jpg"))
    }


def time_of(call: Callable[[], object], rounds: int) -> float:
    start = time.process_time()
    for _ in range(rounds):
        call()
    return (time.process_time() - start) / rounds


def compare_speed() -> None:
    """Print the time for a search, ours and OpenCV's, in turns; the least of each counts."""
    cv2.setNumThreads(1)
    random = np.random.default_rng(5)
    picture = cv2.GaussianBlur(random.integers(0, 256, (480, 640), np.uint8), (0, 0), 1.5)
    print(
        "\n| places | ours, us | matchTemplate, us | ratio | phaseCorrelate, us | ratio |\n"
        "|---|---|---|---|---|---|"
    )
    for places in (7, 9, 17, 33, 65):
        side = places + 15
        window = np.ascontiguousarray(picture[100 : 100 + side, 100 : 100 + side])
        patch = np.ascontiguousarray(picture[130:146, 130:146])
        floats = window.astype(np.float32)
        centre = np.array([137.5, 137.5], np.float32)
        calls = (
            lambda p=places, c=centre: _core.correlate(
                image=picture,
                centre_px=c,
                other=picture,
                x_first=100,
                y_first=100,
                width=p,
                height=p,
            ),
            lambda w=window, t=patch: cv2.matchTemplate(w, t, cv2.TM_CCOEFF_NORMED),
            lambda f=floats: cv2.phaseCorrelate(f, f),
        )
        rounds = max(20, 20000 // places)
        taken = np.min([[time_of(call, rounds) for call in calls] for _ in range(5)], axis=0) * 1e6
        print(
            f"| {places}x{places} | {taken[0]:.1f} | {taken[1]:.1f} | {taken[1] / taken[0]:.1f} | "
            f"{taken[2]:.1f} | {taken[2] / taken[0]:.1f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photographs", type=Path, nargs="*", help="at least 512 pixels wide")
    parser.add_argument("--surfaces", default=",".join(SURFACES), help="rendered ones")
    arguments = parser.parse_args()
    print(
        "| surface | correlation peak | rival over peak, 95th | nodes right | error of the fit, "
        "px rms | its bias, px | turn and shift right | self-similarity |\n"
        "|---|---|---|---|---|---|---|---|"
    )
    for path in arguments.photographs:
        measure(path.stem, photograph_view(read_grey(path.read_bytes())))
    for name, view in field_views().items():
        measure(name, view)
    for kind in arguments.surfaces.split(","):
        for size, pixel_m in PIXELS_M.items():
            measure(f"{kind}, {size} a pixel", ground_view(kind, pixel_m))
    compare_speed()


if __name__ == "__main__":
    main()
