# SPDX-License-Identifier: Apache-2.0
"""Stretches of patches, as the matches around them tell."""

from __future__ import annotations

import numpy as np

from pilotage.behaviors.stretch import find_stretches

FIRST_FROM_SECOND = np.array([[0.8, 0.05], [-0.1, 0.7]])


def matches(count: int, *, seed: int = 0, noise_px: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels of a floor in two pictures."""
    random = np.random.default_rng(seed)
    second = random.uniform((0, 0), (640, 480), (count, 2))
    first = second @ FIRST_FROM_SECOND.T + (40, 60)
    return first + random.normal(0, noise_px, first.shape), second


def test_the_stretch_of_a_floor_is_found():
    first, second = matches(400)
    found = find_stretches(first, second)
    assert found.shape == (400, 2, 2)
    assert np.sqrt(np.mean((found - FIRST_FROM_SECOND) ** 2)) < 0.015


def test_wrong_matches_and_things_before_the_floor_do_not_spoil_it():
    first, second = matches(400)
    random = np.random.default_rng(1)
    wrong = random.choice(400, 60, replace=False)
    first[wrong] += random.uniform(-60, 60, (60, 2))
    right = np.setdiff1d(np.arange(400), wrong)
    error = np.abs(find_stretches(first, second) - FIRST_FROM_SECOND).max(axis=(1, 2))
    assert np.median(error[right]) < 0.02
    assert np.mean(error[right] < 0.1) > 0.95


def test_what_matches_do_not_tell_is_left_as_it_is():
    unknown = np.eye(2)
    few = find_stretches(*matches(5))
    assert np.array_equal(few, np.tile(unknown, (5, 1, 1)))
    first, second = matches(100)
    along_a_line = np.column_stack([second[:, 0], np.full(100, 200.0)])
    assert np.array_equal(find_stretches(first, along_a_line), np.tile(unknown, (100, 1, 1)))
    # Everything ten times as long, or seen in a mirror, is no patch that could be found again.
    for nonsense in (10 * second, second * (-1, 1)):
        assert np.array_equal(find_stretches(nonsense, second), np.tile(unknown, (100, 1, 1)))
