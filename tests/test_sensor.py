# SPDX-License-Identifier: Apache-2.0
"""What a simulated sensor does wrong, each seen in pictures and stamps."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_scenes import LEFT, PERIOD_NS, RIGHT, WIDTH_PX, group_of, shots, small_world
from numpy.typing import NDArray

from pilotage.errors import InputError
from pilotage.simulation import Fault, Motion, Simulation, World, load_world
from pilotage.simulation.parallel import in_parallel
from pilotage.simulation.sensor import PRESETS, Sensor, make_sensor, read_sensor

STEADY = Sensor.ideal()
TURNING = Motion(0, 0, 1.2)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return small_world(tmp_path_factory.mktemp("sensor"))


def noise_of(world: World, sensor: Sensor, **options: object) -> float:
    """Return the standard deviation (grey) of what differs between pictures of the same view."""
    a, b = shots(world, sensor=sensor, count=5, **options)[-2:]  # type: ignore[arg-type]
    difference = a.pictures[LEFT].astype(float) - b.pictures[LEFT]
    return float(difference.std() / np.sqrt(2))


def sharpness(picture: NDArray[np.uint8], axis: int) -> float:
    """Return the mean square of the slope along an axis."""
    return float((np.diff(picture.astype(float), axis=axis) ** 2).mean())


def test_the_same_seed_gives_the_same_bits_and_another_does_not(world: World):
    a, b, c = (
        shots(world, sensor=Sensor.realistic(), motion=TURNING, seed=s)[-1] for s in (1, 1, 2)
    )
    assert (a.stamps_ns, a.taken_ns) == (b.stamps_ns, b.taken_ns)
    assert a.stamps_ns != c.stamps_ns
    for name in (LEFT, RIGHT):
        assert (a.pictures[name] == b.pictures[name]).all()
        assert (a.pictures[name] != c.pictures[name]).any()


def test_an_ideal_sensor_repeats_a_view_exactly(world: World):
    a, b = shots(world, sensor=STEADY, count=9)[-2:]
    difference = a.pictures[LEFT].astype(int) - b.pictures[LEFT]
    # The parked rover creeps by micrometres, so that an edge may pass a pixel's middle.
    assert (np.abs(difference) > 1).mean() < 0.01
    assert a.pictures[LEFT].mean() == pytest.approx(STEADY.target_grey, abs=5)


def test_noise_is_as_strong_as_it_is_said_to_be(world: World):
    read = replace(STEADY, read_noise=4.0)
    # The gain is what 10 us of light need.
    gain = 110 / noise_free_grey(world)
    assert noise_of(world, read) == pytest.approx(4 * gain, rel=0.15)
    assert noise_of(world, replace(STEADY, pattern=0.1)) < 2


def noise_free_grey(world: World) -> float:
    picture = shots(world, sensor=replace(STEADY, largest_gain=1.0), count=1)[0].pictures[LEFT]
    return float(picture.mean())


def test_beyond_the_longest_exposure_gain_takes_over_and_noise_grows(world: World):
    sensor = replace(Sensor(), blur_px=0.0)
    bright, dark = (
        shots(world, sensor=sensor, faults=faults, count=1)[0]
        for faults in ((), [Fault("darkness", 0, 0.98)])
    )
    assert bright.exposure_s < 0.3 * sensor.longest_exposure_s
    assert dark.exposure_s == sensor.longest_exposure_s
    assert dark.pictures[LEFT].mean() == pytest.approx(bright.pictures[LEFT].mean(), rel=0.05)
    faults = [Fault("darkness", 0, 0.98)]
    assert noise_of(world, sensor, faults=faults) > 1.7 * noise_of(world, sensor)


def test_the_exposure_follows_the_light_step_by_step(world: World):
    faults = [Fault("darkness", 0.25, 0.7)]
    taken = shots(world, faults=faults, count=14)
    means = [float(shot.pictures[LEFT].mean()) for shot in taken]
    assert means[2] < 0.45 * means[1]
    assert all(later > earlier - 0.5 for earlier, later in pairwise(means[2:]))
    assert means[-1] == pytest.approx(means[1], rel=0.1)


def test_a_long_exposure_smears_along_the_motion_only(world: World):
    short, long = (
        replace(STEADY, exposure_s=exposure_s, exposure_at_white_s=5 * exposure_s)
        for exposure_s in (1e-5, 0.04)
    )
    a, b = (
        shots(world, sensor=s, motion=TURNING, count=8)[-1].pictures[LEFT] for s in (short, long)
    )
    # 0.04 s at 0.9 rad/s and 107 px focal length are some 4 px.
    assert sharpness(b, 1) < 0.3 * sharpness(a, 1)
    assert sharpness(b, 0) > 2 * sharpness(b, 1)
    still_a, still_b = (shots(world, sensor=s)[-1].pictures[LEFT] for s in (short, long))
    assert sharpness(still_b, 1) == pytest.approx(sharpness(still_a, 1), rel=0.02)


def shift_px(a: NDArray[np.uint8], b: NDArray[np.uint8], rows: slice) -> float:
    """Return how far the rows of `b` lie to the right of those of `a`."""
    first, second = (np.asarray(p[rows], np.float32) for p in (a, b))
    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    return float(cv2.phaseCorrelate(first, second, window)[0][0])


def test_how_many_processors_there_are_changes_no_bit(
    world: World, monkeypatch: pytest.MonkeyPatch
):
    taken = []
    for count in (1, 2, 5):
        monkeypatch.setattr("pilotage.simulation.parallel.processors", lambda count=count: count)
        taken.append(shots(world, sensor=Sensor.realistic(), motion=TURNING, count=4, seed=3))
    for one, other in (pair for others in taken[1:] for pair in zip(taken[0], others, strict=True)):
        assert one.stamps_ns == other.stamps_ns
        assert one.pictures.keys() == other.pictures.keys()
        for name, picture in one.pictures.items():
            np.testing.assert_array_equal(picture, other.pictures[name])


def test_jobs_come_back_in_order_and_the_first_error_is_raised():
    def fail(threads: int) -> int:
        raise ValueError(f"job on {threads}")

    assert in_parallel([lambda threads, k=k: (k, threads >= 1) for k in range(5)]) == [
        (k, True) for k in range(5)
    ]
    assert in_parallel([]) == []
    with pytest.raises(ValueError, match="job on"):
        in_parallel([lambda threads: threads, fail, fail])


def test_a_rolling_shutter_sees_the_lower_rows_later(world: World):
    turning = Motion(0, 0, -0.8)
    at_once, by_rows = (
        shots(world, sensor=replace(STEADY, readout_s=s), motion=turning, count=6)[-1]
        for s in (0.0, 0.04)
    )
    pictures = at_once.pictures[LEFT], by_rows.pictures[LEFT]
    wall, floor = (shift_px(*pictures, rows) for rows in (slice(0, 36), slice(84, 120)))
    # It turns right by some 0.6 rad/s, so that what is seen moves left: 107 px focal length.
    assert floor - wall == pytest.approx(-0.04 * 84 / 120 * 0.6 * 107, rel=0.3)


def test_stamps_jitter_about_the_true_time_and_lag_by_the_offset(world: World):
    sensor = replace(STEADY, stamp_jitter_s=0.002, stamp_offset_s=0.03, readout_s=0.02)
    taken = shots(world, sensor=sensor, count=60)
    late_s = np.array([s.stamps_ns[LEFT] - s.taken_ns for s in taken]) / 1e9
    assert late_s.mean() == pytest.approx(0.03, abs=0.001)
    assert late_s.std() == pytest.approx(0.002, rel=0.25)
    true_ns = [number * PERIOD_NS - 10_005_000 for number in range(1, 61)]
    assert [s.taken_ns for s in taken] == true_ns
    assert all(s.stamps_ns[LEFT] == s.stamps_ns[RIGHT] for s in taken)


def test_frames_are_dropped_as_often_as_said(world: World):
    taken = shots(world, sensor=replace(STEADY, drop_share=0.3), count=60)
    counts = [len(s.pictures) for s in taken]
    assert set(counts) == {0, 2}
    assert 8 <= counts.count(0) <= 28


def test_cameras_differ_in_gain_and_pixels_in_sensitivity(world: World):
    def ratio(sensor: Sensor) -> NDArray[np.float64]:
        pictures = shots(world, sensor=sensor, count=1)[0].pictures
        return np.array([pictures[name].mean() for name in (LEFT, RIGHT)])

    same, apart = ratio(STEADY), ratio(replace(STEADY, gain_mismatch=0.2))
    assert same[0] == pytest.approx(same[1], rel=0.06)
    assert abs(apart[0] / apart[1] - same[0] / same[1]) > 0.05
    even, uneven = (
        shots(world, sensor=replace(STEADY, pattern=p), count=1)[0].pictures[LEFT].astype(float)
        for p in (0.0, 0.05)
    )
    middle = (even > 60) & (even < 200)
    assert (uneven / np.maximum(even, 1))[middle].std() == pytest.approx(0.05, rel=0.15)


def test_colour_pictures_are_blue_green_red_and_jpeg_changes_them_little(world: World):
    colour, squeezed = (
        shots(world, sensor=replace(STEADY, pictures="colour", jpeg_quality=q), count=1)[0]
        for q in (0, 85)
    )
    picture = colour.pictures[LEFT].astype(int)
    assert picture.shape == (120, WIDTH_PX, 3)
    is_mark = picture[..., 2] > 3 * picture[..., 0] + 20
    assert 100 < is_mark.sum() < 2000  # the red mark, and nothing is as blue
    assert (picture[..., 0] > 3 * picture[..., 2] + 20).sum() == 0
    error = squeezed.pictures[LEFT].astype(int) - picture
    assert 0.5 < error.std() < 12


def test_the_first_shot_is_of_the_start_and_each_is_newer_than_the_last(world: World):
    simulation = Simulation(world)
    group = group_of(simulation, replace(STEADY, readout_s=0.04))
    first = group.take()
    assert first is not None
    assert first.taken_ns == 0
    simulation.advance(18_000_000)
    assert group.take() is None  # its middle lies before the start as well
    simulation.advance(40_000_000)
    second = group.take()
    assert second is not None
    assert second.taken_ns == 19_995_000
    assert group.take() is None


def test_indoors_there_is_less_light():
    office = load_world("office", seed=1, options={"person": "none"})
    shot = shots(office, sensor=Sensor(), count=1)[0]
    assert shot.exposure_s == Sensor().longest_exposure_s
    assert 60 < shot.pictures[LEFT].mean() < 150


def test_the_document_shows_every_field_as_it_is():
    text = (Path(__file__).resolve().parents[1] / "docs/cameras.md").read_text()
    text = text.partition("## Faults")[0]
    good, realistic = Sensor(), Sensor.realistic()
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| ([^|]+) \| ([^|]+) \|", text, re.MULTILINE)
    shown = {}
    for row in rows:
        columns = [[word.strip("` ") for word in column.split(", ")] for column in row]
        shown |= {key: values for key, *values in zip(*columns, strict=True)}
    for field in fields(Sensor):
        wanted = [getattr(sensor, field.name) for sensor in (good, realistic)]
        if isinstance(field.default, str):
            assert shown[field.name] == wanted
        else:
            assert [float(value) for value in shown[field.name]] == wanted, field.name


def test_presets_are_named_and_files_change_them(tmp_path: Path):
    assert read_sensor("good") == Sensor()
    assert read_sensor("realistic") == Sensor.realistic()
    assert set(PRESETS) == {"good", "ideal", "realistic"}
    file = tmp_path / "mine.yaml"
    file.write_text("preset: realistic\nreadout_s: 0.01\njpeg_quality: 0\n")
    assert read_sensor(file) == replace(Sensor.realistic(), readout_s=0.01, jpeg_quality=0)
    for text, words in (
        ("readuot_s: 1\n", "mine.yaml.*'readuot_s'.*did you mean 'readout_s'"),
        ("read_noise: -1\n", "mine.yaml: read_noise = -1: must be a number from 0"),
        ("jpeg_quality: 1.5\n", "whole number"),
        ("preset: realstic\n", "did you mean 'realistic'"),
        ("pictures: infrared\n", "grey, colour"),
        ("- 3\n", "mine.yaml"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=words):
            read_sensor(file)
    with pytest.raises(InputError, match="did you mean 'good'"):
        read_sensor("goood")
    with pytest.raises(InputError, match="cannot be read"):
        read_sensor(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="sensor: blur_px"):
        Sensor(blur_px=-1)
    with pytest.raises(InputError, match="'shot_noise'"):
        make_sensor({"shot_noise": 1}, "here")
