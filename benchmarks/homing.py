# SPDX-License-Identifier: Apache-2.0
# Long: plan, walk, judgement and table of one benchmark, which nothing else uses.
"""Does a Nao know where home is after a walk, with people about, and when it was carried away?

    python benchmarks/homing.py --rooms 100 --out homing.jsonl
    python benchmarks/homing.py --rooms 2 --width 320 --path square-4m    # as in CI

Each room is an office of its own. The robot walks a closed path of 10 m, stops each 0.57 m, looks
three ways with both cameras, and comes home; people in patterned clothes walk beside its way. Its
steps are told with a further error of a tenth, drawn for the walk and for each step. The walk
is reconstructed from the recording as `pilotage reconstruct` does it; printed is how far off the
last stop is from the first, beside what the steps alone say. Then some stops are left out, as if
somebody had carried the robot from one to the next: that must be declared, and no stop may be
answered with a wrong place. Rooms that --out holds already are not walked again.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import math
import re
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from simulated_drives import append_done, read_done, run

from pilotage import StopFate, Transform, _core
from pilotage.behaviors.stop_and_go import StopPlan, record_stops
from pilotage.behaviors.walk import PlacedWalk, place_walk
from pilotage.behaviors.walk_account import RecordedWalk, read_walk
from pilotage.behaviors.walk_folder import against_truth, true_stops
from pilotage.recordings import open_pictures
from pilotage.simulation import (
    Drive,
    FreeFloor,
    Simulation,
    load_world,
    read_sensor,
    robot_model,
)
from pilotage.simulation.paths import parse_path
from pilotage.simulation.scene import SURFACE_PREFIX, WALK_PREFIX
from pilotage.simulation.walkers import Walk
from pilotage.simulation.walkers import read_walk as read_walker
from pilotage.simulation.world import World

HOME_M, HOME_DEG = 0.05, 2.0
# A pose is wrong when it is off by more than this and five of its own standard errors.
WRONG_M = 0.10
STEP_ERROR = 0.10
# Half of its variance is common to a walk.
COMMON = math.sqrt(0.5)
ROOM = {"person": "walk", "length_m": 12.0, "width_m": 11.0}
FIRST_SEED = 5001
APART_M = (0.7, 0.9)  # of the path from those who walk beside it
PERSON_M = (0.25, 1.7)  # radius and height of the upright cylinder a person fills


@dataclass(frozen=True)
class Room:
    """One walk; all of it follows from its seed."""

    number: int
    seed: int


def rooms_of(count: int, path: str, people: int) -> list[Room]:
    """Return rooms in which the path fits, in the order of their seeds."""
    rooms: list[Room] = []
    for seed in range(FIRST_SEED, FIRST_SEED + 20 * count + 20):
        if len(rooms) == count:
            break
        world, _ = crowded(seed, path, people)
        if FreeFloor(world, robot_model("nao").radius_m).first_touch(path) is None:
            rooms.append(Room(len(rooms), seed))
    if len(rooms) < count:
        sys.exit(f"only {len(rooms)} of {count} rooms have place for {path} and {people} people")
    return rooms


def crowded(seed: int, path: str, people: int) -> tuple[World, tuple[Walk, ...]]:
    """Return an office with so many people who walk round the middle of the path."""
    world = load_world("office", seed=seed, options=ROOM)
    root = ElementTree.fromstring(world.mjcf)
    bodies, notes = root.find("worldbody"), root.find("custom")
    assert bodies is not None
    assert notes is not None
    person = next(body for body in bodies if body.get("name") == "person")
    note = next(text for text in notes if text.get("name") == f"{WALK_PREFIX}person")
    bodies.remove(person)
    notes.remove(note)
    drive = parse_path(path)
    from_middle = drive.points[:: len(drive.points) // 36][:-1] - drive.centre()
    reach_m = np.linalg.norm(from_middle, axis=1, keepdims=True)
    random = np.random.default_rng([77, world.seed])
    walkers = []
    for number in range(people):
        # Two outside of the path for one inside: it looks ahead, where those outside are.
        apart_m = random.uniform(*APART_M)
        if number % 3 == 2 and reach_m.min() > 2 * apart_m:
            apart_m = -apart_m
        points = drive.centre() + from_middle * (1 + apart_m / reach_m)
        begin = int(len(points) * (number + random.uniform(0, 0.6)) / people)
        points = np.roll(points, begin, axis=0)[:: int(random.choice([-1, 1]))]
        walkers.append(Walk(f"person_{number}", points, float(random.uniform(0.3, 0.7))))
        body = copy.deepcopy(person)
        body.set("name", walkers[-1].body)
        _dress(root, body, f"shirt_{number}", int(random.integers(1, 2**31)))
        bodies.append(body)
        name, data = walkers[-1].note()
        ElementTree.SubElement(notes, "text", name=name, data=data)
        walkers[-1] = read_walker(name, data)
    mjcf = ElementTree.tostring(root, encoding="unicode")
    return dataclasses.replace(world, mjcf=mjcf), tuple(walkers)


def _dress(root: ElementTree.Element, body: ElementTree.Element, name: str, seed: int) -> None:
    """Give a person clothes of a pattern of their own, all over."""
    asset, notes = root.find("asset"), root.find("custom")
    assert asset is not None
    assert notes is not None
    for parent, attribute, old in (
        (asset, "name", "shirt"),
        (notes, "name", f"{SURFACE_PREFIX}shirt"),
    ):
        made = copy.deepcopy(next(e for e in parent if e.get(attribute) == old))
        made.set(attribute, old.replace("shirt", name))
        if parent is notes:
            made.set("data", re.sub(r"seed=\d+", f"seed={seed}", made.get("data", "")))
        parent.append(made)
    for geom in body.iter("geom"):
        if geom.get("material") in {"shirt", "trousers"}:
            geom.set("material", name)


def walk_of(world: World, path: str, width: int, out: Path) -> RecordedWalk:
    model = robot_model("nao")
    simulation = Simulation(world, "nao", seed=world.seed)
    record_stops(
        simulation=simulation,
        robot=model,
        drive=Drive(simulation, path, speed_m_s=model.speed_m_s),
        out=out,
        width_px=width,
        plan=StopPlan(),
        sensor=read_sensor("good"),
        on_moment=lambda _: None,
    )
    return misled(read_walk(open_pictures(out)), world.seed)


def misled(walk: RecordedWalk, seed: int) -> RecordedWalk:
    """Return the walk whose steps are told with a further error of a tenth."""
    random = np.random.default_rng([78, seed])
    common = COMMON * STEP_ERROR * random.standard_normal()
    told = [first.odom_from_robot for first in walk.firsts]
    places = [told[0]]
    for before, after in pairwise(told):
        step = before.inverse() @ after
        factor = 1 + common + COMMON * STEP_ERROR * random.standard_normal()
        way_m = float(np.linalg.norm(step.translation_m))
        yaw_rad = STEP_ERROR * way_m * random.standard_normal()
        turn = Transform(quaternion_wxyz=[math.cos(yaw_rad / 2), 0, 0, math.sin(yaw_rad / 2)])
        longer = Transform(
            translation_m=factor * np.array(step.translation_m),
            quaternion_wxyz=step.quaternion_wxyz,
        )
        places.append(places[-1] @ longer @ turn)
    return with_places(walk, places)


def with_places(walk: RecordedWalk, places: list[Transform]) -> RecordedWalk:
    pictures = tuple(
        dataclasses.replace(picture, odom_from_robot=places[stop])
        for picture, stop in zip(walk.pictures, walk.stop_of_picture, strict=True)
    )
    return dataclasses.replace(walk, pictures=pictures)


def carried(walk: RecordedWalk, first: int, last: int) -> RecordedWalk:
    """Return the walk without the stops from `first` to before `last`: it was carried over them.

    Its steps say that it walked on from the stop before as it had done until then.
    """
    told = [picture.odom_from_robot for picture in walk.firsts]
    usual = told[first - 2].inverse() @ told[first - 1]
    moved = told[first - 1] @ usual @ told[last].inverse()
    places = [place if stop < first else moved @ place for stop, place in enumerate(told)]
    kept = [stop for stop in range(len(told)) if stop < first or stop >= last]
    new = {stop: number for number, stop in enumerate(kept)}
    shifted = with_places(walk, places)
    left = [i for i, stop in enumerate(walk.stop_of_picture) if stop in new]
    return dataclasses.replace(
        shifted,
        pictures=tuple(shifted.pictures[i] for i in left),
        stop_of_picture=tuple(new[walk.stop_of_picture[i]] for i in left),
    )


def wrong_stops(placed: PlacedWalk) -> int:
    """Return how many stops are answered with a place that is wrong and does not say so."""
    true = true_stops(placed.walk)
    assert true is not None
    estimate = placed.world_from_stop
    known = [i for i in range(len(estimate)) if not np.isnan(estimate[i, 0, 0])]
    wrong = 0
    for i in known:
        wanted = np.linalg.inv(true[known[0]]) @ true[i]
        off_m = float(np.linalg.norm(wanted[:3, 3] - estimate[i][:3, 3]))
        sigma_m = math.sqrt(float(np.trace(placed.stops[i].covariance[:3, :3])))
        wrong += off_m > max(WRONG_M, 5 * sigma_m)
    return wrong


def share_on_people(walk: RecordedWalk, walkers: tuple[Walk, ...]) -> list[float]:
    """Return for each picture of the top camera which part of its corners are on people."""
    shares = []
    for picture in walk.pictures:
        if picture.camera != "top":
            continue
        truth = walk.recording.truth(picture.camera)
        assert truth is not None
        at = int(np.abs(truth.timestamps_ns - picture.timestamp_ns).argmin())
        pose = truth.poses[at]
        camera = walk.recording.cameras[picture.camera]
        corners = _core.detect_corners(image=picture.picture)[:, :2].astype(float)
        if len(corners) == 0:
            shares.append(0.0)
            continue
        plane = np.column_stack(
            [
                (corners[:, 0] - camera.cx_px) / camera.fx_px,
                (corners[:, 1] - camera.cy_px) / camera.fy_px,
                np.ones(len(corners)),
            ]
        )
        rays = plane @ pose[:3, :3].T
        hit = np.zeros(len(corners), dtype=bool)
        for walker in walkers:
            hit |= _hits(pose[:3, 3], rays, walker.pose(1e-9 * picture.timestamp_ns)[0])
        shares.append(float(hit.mean()))
    return shares


def _hits(origin: Any, rays: Any, place: Any) -> Any:
    """Tell which rays meet a person's cylinder."""
    radius_m, height_m = PERSON_M
    to_axis = origin[:2] - place
    a = (rays[:, :2] ** 2).sum(axis=1)
    b = rays[:, :2] @ to_axis
    root = b**2 - a * (to_axis @ to_axis - radius_m**2)
    along = (-b - np.sqrt(np.maximum(root, 0))) / np.maximum(a, 1e-12)
    height = origin[2] + along * rays[:, 2]
    return (root > 0) & (along > 0) & (height > 0) & (height < height_m)


def measure(room: Room, *, path: str, width: int, people: int) -> dict[str, Any]:
    world, walkers = crowded(room.seed, path, people)
    with tempfile.TemporaryDirectory(prefix="pilotage-home-") as scratch:
        walk = walk_of(world, path, width, Path(scratch) / "walk.mcap")
        start = time.process_time()
        placed = place_walk(walk)
        cpu_s = time.process_time() - start
        found = against_truth(placed)
        shares = share_on_people(walk, walkers)
        stops = len(placed.stops)
        random = np.random.default_rng([79, room.seed])
        first = int(random.integers(3, stops - 4))
        last = int(random.integers(first + 2, stops - 1))
        away = place_walk(carried(walk, first, last))
        told = [picture.odom_from_robot for picture in walk.firsts]
        by_steps = (told[0].inverse() @ told[-1]).translation_m
        return {
            "number": room.number, "seed": room.seed, "stops": stops,
            "pictures": len(walk.pictures),
            "home_m": found["home_m"] if found else None,
            "home_deg": found["home_deg"] if found else None,
            "largest_m": found["largest_m"] if found else None,
            "placed": sum(s.world_from_stop is not None for s in placed.stops),
            "home_placed": placed.stops[0].world_from_stop is not None
            and placed.stops[-1].world_from_stop is not None,
            "said_carried": sum(s.fate == StopFate.carried for s in placed.stops),
            "wrong": wrong_stops(placed),
            "set_aside": sum(s.set_aside for s in placed.stops),
            "sights": sum(s.sights for s in placed.stops),
            "steps_home_m": float(np.linalg.norm(by_steps)), "cpu_s": cpu_s,
            "on_people": float(np.mean(shares)),
            "on_people_most": float(np.quantile(shares, 0.9)),
            "over_half": float(np.mean(np.array(shares) > 0.5)),
            "carried_from": first, "carried_to": last,
            "carried_declared": away.stops[first].fate != StopFate.placed,
            "carried_found": away.stops[first].world_from_stop is not None,
            "carried_said": away.stops[first].fate.name,
            "carried_wrong": wrong_stops(away),
        }  # fmt: skip


def is_home(row: dict[str, Any]) -> bool:
    """Tell whether the last stop is known as well as it is to be."""
    known = row["home_m"] is not None and row["home_placed"]
    return bool(known and row["home_m"] <= HOME_M and row["home_deg"] <= HOME_DEG)


def table(rows: list[dict[str, Any]]) -> str:
    """Return what is printed of all rooms."""
    home_mm = np.array([1e3 * row["home_m"] for row in rows if row["home_m"] is not None])
    deg = np.array([row["home_deg"] for row in rows if row["home_deg"] is not None])
    far_mm = np.array([1e3 * row["largest_m"] for row in rows if row["largest_m"] is not None])
    steps_mm = np.array([1e3 * row["steps_home_m"] for row in rows])
    on = np.array([row["on_people"] for row in rows])
    most = np.array([row["on_people_most"] for row in rows])
    home = sum(is_home(row) for row in rows)
    declared = sum(row["carried_declared"] for row in rows)
    found = sum(row["carried_found"] for row in rows)
    wrong = sum(row["wrong"] + row["carried_wrong"] for row in rows)
    false_alarms = sum(row["said_carried"] for row in rows)
    lines = [
        "| | |",
        "|---|---|",
        f"| home within {100 * HOME_M:.0f} cm and {HOME_DEG:g} degrees | {home} of {len(rows)} |",
    ]
    if len(home_mm):
        lines += [
            f"| last stop off, mm: median, 95th, largest | {np.median(home_mm):.2f},"
            f" {np.quantile(home_mm, 0.95):.2f}, {home_mm.max():.2f} |",
            f"| last stop turned off, degrees: median, largest | {np.median(deg):.3f},"
            f" {deg.max():.3f} |",
            f"| furthest stop off, mm: median, largest | {np.median(far_mm):.1f},"
            f" {far_mm.max():.1f} |",
        ]
    lines += [
        f"| by the steps alone, mm: median, largest | {np.median(steps_mm):.0f},"
        f" {steps_mm.max():.0f} |",
        "| corners of the top camera that are on people: mean, 90th percentile of pictures |"
        f" {100 * on.mean():.0f} %, {100 * np.median(most):.0f} % |",
        "| its pictures with more than half of their corners on people |"
        f" {100 * np.mean([row['over_half'] for row in rows]):.0f} % |",
        f"| stops placed | {sum(row['placed'] for row in rows)} of"
        f" {sum(row['stops'] for row in rows)} |",
        f"| carried away, declared | {declared} of {len(rows)}, found again {found} |",
        f"| stops answered with a wrong place | {wrong} |",
        f"| stops said to be carried to that were walked to | {false_alarms} |",
        f"| CPU-s a walk, median | {np.median([row['cpu_s'] for row in rows]):.1f} |",
    ]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=100)
    parser.add_argument("--width", type=int, default=640, help="of the pictures, pixels")
    parser.add_argument("--path", default="closed-10m")
    parser.add_argument("--people", type=int, default=12)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, help="file to add results to, one JSON line each")
    arguments = parser.parse_args()
    settings = {
        "path": arguments.path, "width": arguments.width, "people": arguments.people,
    }  # fmt: skip
    rows = read_done(arguments.out, settings) if arguments.out else {}
    rooms = rooms_of(arguments.rooms, arguments.path, arguments.people)
    rows = {number: row for number, row in rows.items() if number < arguments.rooms}
    left = [room for room in rooms if room.number not in rows]
    failed = 0
    for row in run(measure, left, settings, arguments.workers):
        if arguments.out:
            append_done(arguments.out, row, settings)
        if "error" in row:
            failed += 1
            print(f"room {row['number']}: {row['error']}", file=sys.stderr, flush=True)
            continue
        rows[row["number"]] = row
        said = "declared" if row["carried_declared"] else "NOT DECLARED"
        home = "lost" if row["home_m"] is None else f"{1e3 * row['home_m']:.2f} mm"
        print(
            f"[{len(rows)}/{arguments.rooms}] {row['number']:3d} home {home},"
            f" {row['placed']} of {row['stops']} stops, {100 * row['on_people']:.0f} % on people,"
            f" carried {row['carried_from']} to {row['carried_to']} {said},"
            f" {row['wrong'] + row['carried_wrong']} wrong, {row['cpu_s']:.1f} CPU-s",
            file=sys.stderr,
            flush=True,
        )
    if rows:
        print(table([rows[number] for number in sorted(rows)]))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
