# SPDX-License-Identifier: Apache-2.0
"""Stereo recordings rendered with truth, for every test that needs pictures.

recording = make_recording(folder, layout="euroc", frames=40, seed=3)
recording.world_from_left   # (40, 4, 4), relative to the first left camera
"""

from __future__ import annotations

import csv
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from rendering import PinholeCamera, Renderer, room, street

# x right, y down, z forward of a camera whose robot looks along x.
ROBOT_FROM_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])


@dataclass(frozen=True)
class Options:
    """What to render. Angles in degrees, lengths in metres, faults by picture number."""

    layout: Literal["kitti", "euroc"] = "kitti"
    path: Literal["straight", "loop"] = "straight"  # a street, or a closed circle in a room
    frames: int = 20
    seed: int = 0
    width: int = 480
    height: int = 240
    focal_px: float | None = None  # default 0.62 * width
    baseline_m: float = 0.20
    step_m: float = 0.12
    turn_deg: float = 0.6  # largest heading change a picture on the straight path
    shake_deg: float = 0.3  # amplitude of pitch and roll
    rate_hz: float = 10.0
    # Brown k1 k2 p1 p2 k3 of both cameras; None: no lens for kitti, a wide lens for euroc.
    distortion: tuple[float, ...] | None = None
    noise_grey: float = 1.5
    brightness_change: float = 0.0  # relative amplitude over the recording, right picture included
    right_shift_px: float = 0.0  # right picture moved to larger x than the calibration says
    right_shift_y_px: float = 0.0  # right picture moved to larger y than the calibration says
    dropped: tuple[int, ...] = ()  # never written; the times keep their gap
    dark: tuple[int, ...] = ()  # almost black
    truncated: tuple[int, ...] = ()  # left file cut short
    jpeg_quality: int | None = None  # default: PNG
    right_rotation_deg: tuple[float, float, float] | None = None  # default: none, euroc a little


@dataclass(frozen=True)
class SyntheticRecording:
    """A written recording and what is true of it."""

    path: Path
    timestamps_ns: np.ndarray  # (N,) int64
    world_from_left: np.ndarray  # (N, 4, 4), world = first left camera
    left: PinholeCamera
    right: PinholeCamera
    right_from_left: np.ndarray  # (4, 4)
    options: Options


def rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Return the robot's (3, 3) world_from_robot, radians: about z, then y, then x."""
    cz, sz, cy, sy, cx, sx = (f(a) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return about_z @ about_y @ about_x


def camera_path(options: Options) -> np.ndarray:
    """Return (N, 4, 4) poses of the left camera in the rendered world, 0.7 m above its floor."""
    index = np.arange(options.frames)
    if options.path == "loop":
        yaw = 2 * np.pi * index / options.frames + np.pi / 2
        radius = options.step_m * options.frames / (2 * np.pi)
        x, y = radius * np.cos(yaw - np.pi / 2), radius * np.sin(yaw - np.pi / 2)
    else:
        # An S every 40 pictures: the heading swings, the way follows the heading.
        rate = np.deg2rad(options.turn_deg) * np.cos(2 * np.pi * index / 40)
        yaw = np.cumsum(rate) - rate[0]
        x = np.cumsum(options.step_m * np.cos(yaw)) - options.step_m
        y = np.cumsum(options.step_m * np.sin(yaw))
        y -= y[0]
    shake = np.deg2rad(options.shake_deg)
    poses = np.tile(np.eye(4), (options.frames, 1, 1))
    for i in index:
        pitch, roll = shake * np.sin(0.7 * i), shake * np.sin(0.45 * i + 1)
        poses[i, :3, :3] = rotation(yaw[i], pitch, roll) @ ROBOT_FROM_CAMERA
        poses[i, :3, 3] = x[i], y[i], 0.7 + 0.3 * shake * np.sin(0.31 * i)
    return poses


def cameras(options: Options) -> tuple[PinholeCamera, PinholeCamera, np.ndarray]:
    """Return left, right and right_from_left; the euroc rig is not rectified."""
    euroc = options.layout == "euroc"
    lens = options.distortion or ((-0.28, 0.074, 2e-4, 2e-5, 0.0) if euroc else (0.0,) * 5)
    focal = options.focal_px or 0.62 * options.width
    w, h = options.width, options.height
    left = PinholeCamera(w, h, focal, focal, w / 2 - 0.5, h / 2 - 0.5, tuple(lens))
    right = left
    if euroc:
        left = PinholeCamera(w, h, focal, 0.997 * focal, w / 2 - 4.3, h / 2 + 3.1, tuple(lens))
        right = PinholeCamera(
            w, h, 0.998 * focal, 0.995 * focal, w / 2 + 2.2, h / 2 - 1.4, left.distortion
        )
    degrees = options.right_rotation_deg or ((0.4, -0.7, 0.3) if euroc else (0.0, 0.0, 0.0))
    right_from_left = np.eye(4)
    right_from_left[:3, :3] = cv2.Rodrigues(np.deg2rad(degrees))[0]
    right_from_left[:3, 3] = right_from_left[:3, :3] @ [-options.baseline_m, 0, 0]
    return left, right, right_from_left


def make_recording(folder: str | os.PathLike[str], **choices: Any) -> SyntheticRecording:
    """Render and write a recording; `choices` are the fields of `Options`."""
    options = Options(**choices)
    path = Path(folder)
    left, right, right_from_left = cameras(options)
    world_from_left = camera_path(options)
    timestamps_ns = (np.arange(options.frames) * round(1e9 / options.rate_hz)).astype(np.int64)
    if options.layout == "euroc":
        timestamps_ns += 1_403_636_579_763_555_584
    kept = np.setdiff1d(np.arange(options.frames), options.dropped)
    names = _picture_names(options, timestamps_ns[kept], path)
    pairs = _render_pairs(options, world_from_left, kept)
    for (left_file, right_file), index, pair in zip(names, kept, pairs, strict=True):
        for file, picture in zip((left_file, right_file), pair, strict=True):
            file.parent.mkdir(parents=True, exist_ok=True)
            parameters = [cv2.IMWRITE_JPEG_QUALITY, options.jpeg_quality or 0]
            cv2.imwrite(str(file), picture, parameters if options.jpeg_quality else [])
        if index in options.truncated:
            left_file.write_bytes(left_file.read_bytes()[: left_file.stat().st_size // 3])
    relative = np.linalg.inv(world_from_left[0]) @ world_from_left[kept]
    recording = SyntheticRecording(
        path, timestamps_ns[kept], relative, left, right, right_from_left, options
    )
    if options.layout == "kitti":
        _write_kitti(recording)
    else:
        _write_euroc(recording, world_from_left[kept])
    return recording


def make_long_recording(
    folder: str | os.PathLike[str], base: SyntheticRecording, frames: int
) -> SyntheticRecording:
    """Return `base` (kitti) played forwards and backwards to `frames` pairs, by hard links."""
    path = Path(folder)
    count = len(base.timestamps_ns)
    order = np.resize(np.r_[0:count, count - 2 : 0 : -1], frames)
    spacing_ns = round(1e9 / base.options.rate_hz)
    timestamps_ns = (np.arange(frames) * spacing_ns).astype(np.int64)
    suffix = ".jpg" if base.options.jpeg_quality else ".png"
    for side in ("image_0", "image_1"):
        (path / side).mkdir(parents=True, exist_ok=True)
        for new, old in enumerate(order):
            os.link(base.path / side / f"{old:06d}{suffix}", path / side / f"{new:06d}{suffix}")
    recording = SyntheticRecording(
        path, timestamps_ns, base.world_from_left[order], base.left, base.right,
        base.right_from_left, base.options,
    )  # fmt: skip
    _write_kitti(recording)
    return recording


def _render_pairs(options: Options, world_from_left: np.ndarray, kept: np.ndarray) -> Any:
    rng = np.random.default_rng(options.seed)
    if options.path == "loop":
        world = room(options.step_m * options.frames / (2 * np.pi), rng)
    else:
        world = street(options.step_m * options.frames, rng)
    left, right, right_from_left = cameras(options)
    shift_px = (options.right_shift_px, options.right_shift_y_px)
    renderers = (
        (Renderer(world, left, options.seed), np.eye(4)),
        (Renderer(world, right, options.seed, shift_px), np.linalg.inv(right_from_left)),
    )
    noise = np.random.default_rng(options.seed + 2)
    for index in kept:
        gain = 1 + options.brightness_change * np.sin(2 * np.pi * index / options.frames)
        gain *= 0.02 if index in options.dark else 1.0
        pair = []
        for side, (renderer, left_from_camera) in enumerate(renderers):
            grey = renderer.render(world_from_left[index] @ left_from_camera)
            grey = grey * (gain * (1 + 0.2 * side * options.brightness_change))
            grey = grey + noise.normal(0, options.noise_grey, grey.shape)
            pair.append(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
        yield pair


def _picture_names(
    options: Options, timestamps_ns: np.ndarray, path: Path
) -> list[tuple[Path, Path]]:
    suffix = ".jpg" if options.jpeg_quality else ".png"
    if options.layout == "kitti":
        stems = [f"{i:06d}" for i in range(len(timestamps_ns))]
        folders = ("image_0", "image_1")
    else:
        stems = [str(t) for t in timestamps_ns]
        folders = ("mav0/cam0/data", "mav0/cam1/data")
    return [(path / folders[0] / (s + suffix), path / folders[1] / (s + suffix)) for s in stems]


def _write_kitti(recording: SyntheticRecording) -> None:
    camera, baseline_m = recording.left, recording.options.baseline_m
    lines = []
    for side in (0, 1):
        p = np.array([[camera.fx, 0, camera.cx, -side * camera.fx * baseline_m],
                      [0, camera.fy, camera.cy, 0], [0, 0, 1, 0]])  # fmt: skip
        lines.append(f"P{side}: " + " ".join(f"{value:.12e}" for value in p.ravel()))
    (recording.path / "calib.txt").write_text("\n".join(lines) + "\n")
    np.savetxt(recording.path / "times.txt", recording.timestamps_ns * 1e-9, fmt="%.9f")
    poses = recording.world_from_left[:, :3].reshape(-1, 12)
    np.savetxt(recording.path / "poses.txt", poses, fmt="%.12e")


def _write_euroc(recording: SyntheticRecording, world_from_left: np.ndarray) -> None:
    """Write sensor.yaml, data.csv and the truth of a body that sits askew to the cameras."""
    body_from_left = np.eye(4)
    body_from_left[:3, :3] = cv2.Rodrigues(np.array([0.02, -0.015, 1.55]))[0]
    body_from_left[:3, 3] = -0.0216, -0.0647, 0.0098
    body_from_right = body_from_left @ np.linalg.inv(recording.right_from_left)
    root = recording.path / "mav0"
    suffix = ".jpg" if recording.options.jpeg_quality else ".png"
    sides = ((recording.left, body_from_left), (recording.right, body_from_right))
    for side, (camera, body_from_camera) in enumerate(sides):
        rows = [f"{t},{t}{suffix}" for t in recording.timestamps_ns]
        text = "\n".join(["#timestamp [ns],filename", *rows]) + "\n"
        (root / f"cam{side}" / "data.csv").write_text(text)
        numbers = ", ".join(f"{value:.15g}" for value in body_from_camera.ravel())
        (root / f"cam{side}" / "sensor.yaml").write_text(
            "sensor_type: camera\n"
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers}]\n"
            f"rate_hz: {recording.options.rate_hz:g}\n"
            f"resolution: [{camera.width}, {camera.height}]\ncamera_model: pinhole\n"
            f"intrinsics: [{camera.fx!r}, {camera.fy!r}, {camera.cx!r}, {camera.cy!r}]\n"
            "distortion_model: radial-tangential\n"
            f"distortion_coefficients: {list(camera.distortion)}\n"
        )
    _write_asl_truth(recording, world_from_left @ np.linalg.inv(body_from_left), root)


def _write_asl_truth(
    recording: SyntheticRecording, world_from_body: np.ndarray, root: Path
) -> None:
    folder = root / "state_groundtruth_estimate0"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "data.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["#timestamp", "p_RS_R_x [m]", "p_RS_R_y [m]", "p_RS_R_z [m]",
                         "q_RS_w []", "q_RS_x []", "q_RS_y []", "q_RS_z []"])  # fmt: skip
        for timestamp_ns, pose in zip(recording.timestamps_ns, world_from_body, strict=True):
            writer.writerow([timestamp_ns, *pose[:3, 3], *quaternion_wxyz(pose[:3, :3])])


def quaternion_wxyz(matrix: np.ndarray) -> np.ndarray:
    """Return the unit quaternion of a rotation matrix, through its axis and angle."""
    rotation_rad = cv2.Rodrigues(matrix)[0].ravel()
    angle = float(np.linalg.norm(rotation_rad))
    axis = rotation_rad / angle if angle > 0 else rotation_rad
    return np.r_[np.cos(angle / 2), np.sin(angle / 2) * axis]
