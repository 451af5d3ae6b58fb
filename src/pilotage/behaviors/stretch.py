# SPDX-License-Identifier: Apache-2.0
"""How patches are stretched between two pictures, as the matches around them tell."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[Any]

AROUND = 16  # nearest matches, of which a stretch is made
# Matches farther off than this from what their neighbours tell are of another thing, px.
OFF_PX = 1.5
ROUNDS = 6  # in which that limit narrows, from sixteen times as much
MOST = 2.0  # times that anything becomes longer or shorter; beyond, the matches are wrong
WIDE_PX = 4.0  # of the neighbours' scatter, in its narrowest direction: with less nothing is told


def find_stretches(first_px: Array, second_px: Array) -> NDArray[np.float32]:
    """Return (N, 2, 2) `first_from_second`: offsets from each match in the second picture to first.

    It is the affine map that fits the nearest matches (N, 2) in both pictures best, those that fit
    badly with little weight; identity where they tell nothing.
    """
    count = min(AROUND, len(first_px) - 1)
    unknown = np.tile(np.eye(2, dtype=np.float32), (len(first_px), 1, 1))
    if count < AROUND // 2:
        return unknown
    _, near = cKDTree(second_px).query(second_px, k=count + 1)
    # About their own middle: the match itself errs as much as each of the others.
    first, second = first_px[near], second_px[near]
    weight = np.ones(near.shape)
    for limit_px in OFF_PX * 2.0 ** np.linspace(4, 0, ROUNDS):
        share = (weight / weight.sum(axis=1, keepdims=True))[..., None]
        there = first - (share * first).sum(axis=1, keepdims=True)
        here = second - (share * second).sum(axis=1, keepdims=True)
        scatter = np.swapaxes(here, 1, 2) @ (share * here)
        is_wide = np.linalg.eigvalsh(scatter)[:, 0] > WIDE_PX**2
        scatter[~is_wide] = np.eye(2)
        # Transposed: rows are points.
        stretch = np.linalg.solve(scatter, np.swapaxes(here, 1, 2) @ (share * there))
        off_px = np.linalg.norm(there - here @ stretch, axis=2)
        weight = 1 / (1 + (off_px / limit_px) ** 2) ** 2
    times = np.linalg.svd(stretch, compute_uv=False)
    is_told = is_wide & (times[:, 0] < MOST) & (times[:, 1] > 1 / MOST)
    is_told &= np.linalg.det(stretch) > 0
    unknown[is_told] = np.swapaxes(stretch, 1, 2)[is_told]
    return unknown
