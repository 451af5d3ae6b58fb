# SPDX-License-Identifier: Apache-2.0
# Long: one test a rule of MuJoCo's mapping, and the scenes they share.
"""Textures of MJCF materials: where MuJoCo lays them, and as bright as they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from pilotage import Camera
from pilotage.errors import InputError
from pilotage.simulation import Simulation, load_world
from pilotage.simulation.pictures import Pictures, camera_rays
from pilotage.simulation.textures import read_texels
from pilotage.simulation.world import World

Array = NDArray[np.float64]
WIDTH, HEIGHT = 320, 240
FOCAL_PX = 290.0
CHECKER = '<texture name="t" type="2d" builtin="checker" rgb1=".9 .9 .9" rgb2="0 0 0" {size}/>'
TURN = 'pos="0.1 -0.05 0.2" euler="20 -15 30" contype="0" conaffinity="0"'
# x right, y up in the picture: from above.
SEEN = 'contype="0" conaffinity="0"'
CAMERA = '<camera name="eye" pos="0 0 2" xyaxes="1 0 0 0 1 0" fovy="45"/>'


def world_of(assets: str, geoms: str, camera: str = CAMERA) -> World:
    """Return an evenly lit world; the robot stands far aside."""
    return World(
        "textured",
        0,
        f"""<mujoco>
        <visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
        <quality numslices="128" numstacks="64"/></visual>
        <custom><numeric name="start" data="0 -30 0"/></custom>
        <asset>{assets}
        <hfield name="hills" nrow="4" ncol="4" size="0.5 0.4 0.2 0.1"
        elevation="0 0 0 0 0 1 2 0 0 1 1 0 0 0 0 0"/>
        <mesh name="wedge" vertex="-.4 -.3 -.2 .4 -.3 -.2 .4 .3 -.2 -.4 .3 -.2 -.4 0 .3 .4 0 .3"/>
        <mesh name="card" inertia="shell" vertex="-.4 -.3 0 .4 -.3 0 .4 .3 0 -.4 .3 0"
        face="0 1 2 0 2 3" texcoord="0.1 0.9 1.3 0.9 1.3 0.2 0.1 0.2"/></asset>
        <worldbody><geom name="ground" type="plane" size="0 0 1" pos="0 0 -1" rgba="1 1 1 1"/>
        {geoms} {camera}</worldbody></mujoco>""",
    )


def look(world: World, channels: int = 3) -> tuple[Simulation, Array, Array]:
    """Return the simulation, radiance and depth of its camera `eye`."""
    simulation = Simulation(world, "rover")
    pictures = Pictures(simulation)
    rays = camera_rays(
        Camera(
            width_px=WIDTH,
            height_px=HEIGHT,
            fx_px=FOCAL_PX,
            fy_px=FOCAL_PX,
            cx_px=(WIDTH - 1) / 2,
            cy_px=(HEIGHT - 1) / 2,
        )
    )
    seen = pictures.radiance(rays, simulation.camera_pose("eye", 0), channels=channels)
    return simulation, seen, pictures.depth_m("eye", rays, at_ns=0)


def without_textures(world: World) -> World:
    return World(world.name, 0, re.sub(r' texture="\w+"', "", world.mjcf))


def shown(world: World, channels: int = 3) -> tuple[Simulation, Array, Array, Array]:
    """Return the simulation, what textures show (radiance over that without), where, and depth."""
    simulation, seen, depth_m = look(world, channels)
    plain = look(without_textures(world), channels)[1]
    where = seen != plain
    return simulation, seen / plain, where.any(axis=2) if channels == 3 else where, depth_m


def points_in_geom(simulation: Simulation, depth_m: Array) -> Array:
    """Return (H, W, 3) what each pixel sees, in the axes of the geom called `thing`."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.dstack(
        [
            (x - (WIDTH - 1) / 2) / FOCAL_PX,
            (y - (HEIGHT - 1) / 2) / FOCAL_PX,
            np.ones((HEIGHT, WIDTH)),
        ]
    )
    world_from_camera = simulation.camera_pose("eye", 0).matrix()
    points = (rays * depth_m[..., None]) @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    thing = simulation.model.geom("thing").id
    turn = simulation.data.geom_xmat[thing].reshape(3, 3)
    return (points - simulation.data.geom_xpos[thing]) @ turn


SHAPES = {
    "plane": ('type="plane" size=".5 .4 1"', (0.5, 0.4, 1)),
    "box": ('type="box" size=".5 .4 .1"', (0.5, 0.4, 0.1)),
    "sphere": ('type="sphere" size=".45"', (0.45, 0.45, 0.45)),
    "ellipsoid": ('type="ellipsoid" size=".5 .4 .3"', (0.5, 0.4, 0.3)),
    "capsule": ('type="capsule" size=".3 .2"', (0.3, 0.3, 0.2)),
    "cylinder": ('type="cylinder" size=".4 .2"', (0.4, 0.4, 0.2)),
    "hfield": ('type="hfield" hfield="hills"', (0.5, 0.4, 0.1)),
    "mesh": ('type="mesh" mesh="wedge"', None),
}


def places(shape: str, p: Array, size: Array) -> Array:
    """Return (H, W, 2), where points of a shape lie in a picture that it shows once."""
    x, y, z = np.moveaxis(p / size, 2, 0)
    around = np.arctan2(y, x) / (2 * np.pi) % 1
    if shape == "box":
        is_x, is_y = (np.abs(np.abs(v) - 1) < 1e-3 for v in (x, y))
        s, t = np.where(is_x, y, x), np.where(is_x | is_y, z, y)
        return np.dstack([(1 + s) / 2, (1 - t) / 2])
    if shape in ("sphere", "ellipsoid"):
        return np.dstack([around, 0.5 - np.arctan2(z, np.hypot(x, y)) / np.pi])
    if shape == "cylinder":
        is_end = np.abs(np.abs(z) - 1) < 1e-3
        s, t = np.where(is_end, (1 + x) / 2, around), np.where(is_end, (1 + y) / 2, (1 - z) / 2)
        return np.dstack([s, t])
    if shape == "capsule":
        height = (np.abs(p[..., 2]) - size[2]) / size[0]
        quarters = np.arctan2(height, np.hypot(x, y)) / (np.pi / 2)
        t = np.where(height > 0, np.where(z > 0, 1 - quarters, quarters), (1 - z) / 2)
        return np.dstack([around, t])
    return np.dstack([(1 + x) / 2, (1 - y) / 2])


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize("is_uniform", [False, True])
def test_the_squares_of_a_checker_lie_where_its_repeats_put_them(shape: str, is_uniform: bool):
    uniform = "true" if is_uniform else "false"
    assets = CHECKER.format(size='width="128" height="128"') + (
        f'<material name="m" texture="t" texrepeat="4 3" texuniform="{uniform}"/>'
    )
    geom = f'<geom name="thing" {SHAPES[shape][0]} material="m" {TURN}/>'
    simulation, tone, where, depth_m = shown(world_of(assets, geom))
    points = points_in_geom(simulation, depth_m)
    own = simulation.model.geom_size[simulation.model.geom("thing").id]
    size = np.array(SHAPES[shape][1] or own)
    repeats = np.array([4, 3]) * (size[:2] if is_uniform else 1)
    at = places(shape, points, size)
    if shape in ("hfield", "mesh"):  # repeats count from the middle
        at -= 0.5
        squares = 2 * (repeats * at + 0.5)
    else:
        squares = 2 * repeats * at
    is_white = np.floor(squares).sum(axis=2) % 2 == 0
    # Away from edges by more than what a pixel and its neighbours see.
    numbers = np.floor(squares)
    is_clear = cv2.erode(where.astype(np.uint8), np.ones((5, 5))) > 0
    for axis in (0, 1):
        for step in (-2, 2):
            is_clear &= (np.roll(numbers, step, axis) == numbers).all(axis=2)
    assert is_clear.sum() > 800
    assert 0.2 < is_white[is_clear].mean() < 0.8
    right = (tone[..., 0] > 0.5) == is_white
    assert right[is_clear].mean() > 0.995


def test_an_edge_is_found_where_it_is():
    assets = CHECKER.format(size='width="512" height="512"') + (
        '<material name="m" texture="t" texrepeat="4 4" texuniform="true"/>'
    )
    geom = f'<geom type="plane" size="0 0 1" pos="0 0 -0.99" material="m" {SEEN}/>'
    _, tone, _, _ = shown(world_of(assets, geom))
    row = cv2.GaussianBlur(tone[..., 0], (0, 0), 0.7)[100]  # a lens as sharp as its pixels
    crossings = []
    for x in np.flatnonzero((row[1:] > 0.45) != (row[:-1] > 0.45)):
        crossings.append(x + (0.45 - row[x]) / (row[x + 1] - row[x]))
    # Squares of 0.25 m from the origin, 2.99 m below the camera.
    edges = (WIDTH - 1) / 2 + FOCAL_PX * 0.25 * np.arange(-9, 10) / 2.99
    edges = edges[(edges > 0) & (edges < WIDTH - 1)]
    assert len(crossings) == len(edges)
    assert np.abs(np.array(crossings) - edges).max() < 0.06


def write_faces(folder: Path) -> tuple[str, dict[str, tuple[int, int, int]]]:
    """Write one picture for each face of a cube; return the texture's MJCF and their colours."""
    colours = {
        "right": (255, 0, 0),
        "left": (0, 255, 0),
        "up": (0, 0, 255),
        "down": (255, 255, 0),
        "front": (255, 0, 255),
        "back": (0, 255, 255),
    }
    for name, colour in colours.items():
        cv2.imwrite(str(folder / f"{name}.png"), np.full((64, 64, 3), colour[::-1], np.uint8))
    files = " ".join(f'file{name}="{folder / name}.png"' for name in colours)
    return f'<texture name="t" type="cube" {files}/>', colours


@pytest.mark.parametrize("shape", ["box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh"])
@pytest.mark.parametrize("is_uniform", [False, True])
def test_a_cube_is_looked_up_by_direction(shape: str, is_uniform: bool, tmp_path: Path):
    texture, colours = write_faces(tmp_path)
    uniform = "true" if is_uniform else "false"
    assets = f'{texture}<material name="m" texture="t" texuniform="{uniform}"/>'
    turn = f'pos="0.1 -0.05 0.2" euler="40 -35 30" {SEEN}'
    world = world_of(assets, f'<geom name="thing" {SHAPES[shape][0]} material="m" {turn}/>')
    simulation, tone, where, depth_m = shown(world)
    points = points_in_geom(simulation, depth_m)
    size = simulation.model.geom_size[simulation.model.geom("thing").id].copy()
    if shape == "sphere":
        size[:] = size[0]
    elif shape in ("capsule", "cylinder"):
        size[:] = size[[0, 0, 1]]
    if shape == "capsule":  # a unit cylinder with unit spheres on it, stretched
        beyond = np.maximum(np.abs(points[..., 2]) - size[2], 0)
        stretched = np.sign(points[..., 2]) * (size[2] + beyond * size[2] / size[0])
        points[..., 2] = np.where(beyond > 0, stretched, points[..., 2])
    if shape == "mesh":
        directions = points * (size if is_uniform else 1)
    else:
        directions = points / (1 if is_uniform else size)
    ordered = np.sort(np.abs(directions), axis=2)
    is_clear = where & (ordered[..., 2] > 1.15 * ordered[..., 1])
    is_clear &= cv2.erode(where.astype(np.uint8), np.ones((5, 5))) > 0
    axis = np.abs(directions).argmax(axis=2)
    is_back = np.take_along_axis(directions, axis[..., None], 2)[..., 0] < 0
    expected = np.array(list(colours.values()))[2 * axis + is_back] / 255
    assert is_clear.sum() > 800
    assert len(np.unique(expected[is_clear], axis=0)) >= 3
    assert np.abs(tone - expected).max(axis=2)[is_clear].max() < 0.02


def write_picture(path: Path) -> Array:
    """Write a picture without any symmetry; return it, (60, 100, 3), red first."""
    random = np.random.default_rng(4)
    tiles = random.integers(30, 256, (6, 10, 3), np.uint8)
    picture = np.kron(tiles, np.ones((10, 10, 1), np.uint8))
    cv2.imwrite(str(path), picture[..., ::-1])
    return picture


def test_a_picture_hangs_upright_on_a_plane_and_on_a_mesh(tmp_path: Path):
    picture = write_picture(tmp_path / "poster.png")
    assets = f"""<texture name="t" type="2d" file="{tmp_path}/poster.png"/>
        <material name="m" texture="t"/>"""
    for geom in ('type="plane" size=".5 .4 1"', 'type="mesh" mesh="card"'):
        world = world_of(assets, f'<geom name="thing" {geom} material="m" {SEEN}/>')
        simulation, tone, where, depth_m = shown(world)
        x, y, _ = np.moveaxis(points_in_geom(simulation, depth_m), 2, 0)
        if "plane" in geom:
            s, t = 0.5 + x, 0.5 - y / 0.8
        else:
            # MuJoCo turns a mesh's own axes to its inertia's; back to those it was given in.
            turn = simulation.model.mesh_quat[simulation.model.mesh("card").id]
            along = np.zeros(9)
            mujoco.mju_quat2Mat(along, turn)
            given = points_in_geom(simulation, depth_m) @ along.reshape(3, 3).T
            s, t = 0.7 + 1.5 * given[..., 0], 0.55 - 0.7 / 0.6 * given[..., 1]
        column, row = (100 * s) % 100, (60 * t) % 60
        is_clear = cv2.erode(where.astype(np.uint8), np.ones((5, 5))) > 0
        is_clear &= (np.abs(column % 10 - 5) < 3) & (np.abs(row % 10 - 5) < 3)
        assert is_clear.sum() > 1000
        expected = picture[row.astype(int), column.astype(int)] / 255
        assert np.abs(tone - expected)[is_clear].max() < 0.03


def test_colours_multiply_and_grey_is_their_luminance():
    assets = """<texture name="t" type="2d" builtin="flat" rgb1="0.8 0.4 0.2" rgb2="0 0 0"
        width="8" height="8"/><material name="m" texture="t" rgba="0.5 1 0.5 1"/>"""
    own = f'<geom type="plane" size="1 1 1" material="m" {SEEN} {{rgba}}/>'
    centre = HEIGHT // 2, WIDTH // 2
    white = look(world_of("", f'<geom type="plane" size="1 1 1" rgba="1 1 1 1" {SEEN}/>'))[1][
        centre
    ]
    of_material = look(world_of(assets, own.format(rgba="")))[1][centre] / white
    np.testing.assert_allclose(of_material, np.array([0.4, 0.4, 0.1]), atol=0.003)
    # A colour of the geom's own replaces its material's.
    of_geom = look(world_of(assets, own.format(rgba='rgba="1 0.5 1 1"')))[1][centre] / white
    np.testing.assert_allclose(of_geom, np.array([0.8, 0.2, 0.2]), atol=0.003)
    grey = look(world_of(assets, own.format(rgba="")), channels=1)[1][centre] / white[0]
    assert grey == pytest.approx(0.299 * 0.4 + 0.587 * 0.4 + 0.114 * 0.1, abs=0.003)


def test_a_surface_and_a_texture_of_one_material_multiply():
    assets = CHECKER.format(size='width="64" height="64"') + '<material name="m" texture="t"/>'
    note = '<text name="surface:m" data="gravel seed=3"/>'
    world = world_of(assets, f'<geom type="plane" size="2 2 1" material="m" {SEEN}/>')
    rough = World("rough", 0, world.mjcf.replace("<custom>", "<custom>" + note))
    _, seen, _ = look(rough)
    _, checker, _ = look(world)
    is_white = checker[..., 0] > 0.99 * checker.max()
    assert seen[~is_white & (checker[..., 0] == 0)].max() < 0.01
    assert 0.05 < seen[is_white].std() / seen[is_white].mean() < 0.6


def test_what_mujoco_decoded_is_read(tmp_path: Path):
    write_picture(tmp_path / "a.png")
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((4, 6), 51, np.uint8))
    textures = f"""
        <texture name="linear" type="2d" file="{tmp_path}/a.png" colorspace="linear"/>
        <texture name="srgb" type="2d" file="{tmp_path}/a.png" colorspace="sRGB"/>
        <texture name="grey" type="2d" file="{tmp_path}/grey.png" nchannel="1"/>
        <texture name="rgba" type="2d" file="{tmp_path}/a.png" nchannel="4"/>
        <texture name="spots" type="cube" builtin="gradient" mark="random" random="0.1"
        rgb1="1 0 0" rgb2="0 1 0" markrgb="0 0 1" width="16" height="96"/>"""
    model: Any = world_of(textures, "").spec().compile()
    texels = {
        name: read_texels(model, model.tex(name).id)
        for name in re.findall(r'name="(\w+)"', textures)
    }
    assert texels["linear"].shape == (1, 60, 100, 3)
    assert (texels["linear"] == texels["rgba"]).all()
    assert (texels["srgb"] <= texels["linear"]).all()
    mid = texels["linear"] / 65535
    np.testing.assert_allclose(texels["srgb"] / 65535, ((mid + 0.055) / 1.055) ** 2.4, atol=2e-3)
    assert (texels["grey"] == round(51 / 255 * 65535)).all()
    assert texels["grey"].shape == (1, 4, 6, 3)
    assert texels["spots"].shape == (6, 16, 16, 3)
    assert (texels["spots"][..., 2] == 65535).mean() == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("missing.png", None, "'missing.png'.*put the file beside"),
        ("broken.png", b"no picture", "broken.png.*give a whole PNG"),
        ("odd.txt", b"no picture", "unsupported content type.*textures as PNG"),
    ],
)
def test_a_texture_that_cannot_be_read_is_named(
    file: str, content: bytes | None, said: str, tmp_path: Path
):
    if content is not None:
        (tmp_path / file).write_bytes(content)
    path = tmp_path / "mine.xml"
    path.write_text(f"""<mujoco><asset><texture name="t" type="2d" file="{file}"/></asset>
        <worldbody><geom name="ground" type="plane" size="5 5 1"/></worldbody></mujoco>""")
    with pytest.raises(InputError, match=rf"mine\.xml.*{said}"):
        load_world(path)


GEOMS = [f"{geom} {TURN}" for geom, _ in SHAPES.values()] + [
    f'type="plane" size="0 0 1" pos="0 0 -0.99" {SEEN}',
    f'type="mesh" mesh="card" {TURN}',
]
WITHOUT_CUBE = ["card", "0 0 1"]  # MuJoCo's renderer has no direction for these


@pytest.mark.parametrize("kind", ["2d", "cube"])
@pytest.mark.parametrize("is_uniform", [False, True])
def test_mujocos_own_renderer_draws_the_same(kind: str, is_uniform: bool, tmp_path: Path):
    """Lit from everywhere alike, what both show differs on edges only."""
    write_picture(tmp_path / "poster.png")
    texture = f'<texture name="t" type="2d" file="{tmp_path}/poster.png"/>'
    if kind == "cube":
        texture = write_faces(tmp_path)[0]
    uniform = "true" if is_uniform else "false"
    material = f'<material name="m" texture="t" texrepeat="1 1" texuniform="{uniform}"/>'
    for geom in GEOMS:
        if kind == "cube" and any(word in geom for word in WITHOUT_CUBE):
            continue
        world = world_of(texture + material, f'<geom name="thing" {geom} material="m"/>')
        simulation, tone, where, _ = shown(world)
        theirs = mujoco_picture(simulation)
        inner = cv2.erode(where.astype(np.uint8), np.ones((5, 5))) > 0
        away = np.abs(255 * tone - theirs).max(axis=2)[inner]
        assert len(away) > 1500
        assert np.median(away) < 3, geom
        assert (away < 25).mean() > 0.9, geom


def mujoco_picture(simulation: Simulation) -> Any:
    """Return (H, W, 3) what MuJoCo's renderer shows of `eye`; skip where it cannot draw."""
    model = simulation.model
    eye = simulation.camera_names.index("eye")
    model.cam_fovy[eye] = np.degrees(2 * np.arctan(HEIGHT / 2 / FOCAL_PX))
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    try:
        from mujoco.egl import GLContext

        graphics = GLContext(WIDTH, HEIGHT)
    except Exception as error:  # whatever the graphics library finds missing
        pytest.skip(f"no EGL for MuJoCo's renderer: {error}")
    graphics.make_current()
    try:
        context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        scene, camera = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, eye
        options, every = mujoco.MjvOption(), mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(model, simulation.data, options, None, camera, every, scene)
        area, picture = mujoco.MjrRect(0, 0, WIDTH, HEIGHT), np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_render(area, scene, context)
        mujoco.mjr_readPixels(picture, None, area, context)
        context.free()
    finally:
        graphics.free()
    return picture[::-1].astype(float)
