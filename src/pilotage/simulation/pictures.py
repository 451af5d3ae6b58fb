# SPDX-License-Identifier: Apache-2.0
"""What MuJoCo's model looks like to our rendered cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage import Camera, Transform, _core
from pilotage.errors import InputError
from pilotage.simulation.options import ranged, read_options, unknown
from pilotage.simulation.physics import Simulation, moves
from pilotage.simulation.scene import SURFACE_PREFIX
from pilotage.simulation.surfaces import SURFACES, SurfacePainter
from pilotage.simulation.textures import TexturePainter, read_mesh

LUMINANCE = np.array([0.299, 0.587, 0.114])
EDGE_SAMPLES = 16
HIDDEN_GROUP = 3  # geoms of this group and above are not drawn, as in MuJoCo's own viewer
SUN, SKY, SKY_SLOPE = 0.75, 0.4, 0.4
NO_COLOUR = (0.5, 0.5, 0.5, 1.0)  # of a geom that leaves it to its material
INDOORS, EVEN, LAMP, BACKGROUND = 0.35, 1.0, 1.6, 0.9
KINDS = {
    mujoco.mjtGeom.mjGEOM_PLANE: _core.ShapeKind.plane,
    mujoco.mjtGeom.mjGEOM_HFIELD: _core.ShapeKind.height_field,
    mujoco.mjtGeom.mjGEOM_SPHERE: _core.ShapeKind.sphere,
    mujoco.mjtGeom.mjGEOM_CAPSULE: _core.ShapeKind.capsule,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _core.ShapeKind.ellipsoid,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _core.ShapeKind.cylinder,
    mujoco.mjtGeom.mjGEOM_BOX: _core.ShapeKind.box,
    mujoco.mjtGeom.mjGEOM_MESH: _core.ShapeKind.mesh,
}


@dataclass(frozen=True)
class Grain:
    """What the note of a surface may say beside its kind."""

    seed: int = ranged(0, 0, 2**32 - 1)
    scale: float = ranged(1.0, 0.01, 100.0)


class Pictures:
    """Renders a simulation's cameras; InputError names a surface that is not known."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._model: Any = simulation.model
        self._scene = _core.Scene()
        self._painter = SurfacePainter(self._scene)
        self._textures = TexturePainter(self._scene, self._model)
        self._notes = _surface_notes(self._model)
        self._materials: dict[tuple[int, ...], int] = {}
        self._moving: list[tuple[int, int, Transform]] = []  # body, shape, body_from_geom
        for geom in range(self._model.ngeom):
            self._add_geom(geom)
        self._set_light()

    def motions(self, begin_ns: int, end_ns: int) -> list[_core.ShapeMotion]:
        """Return how what moves by itself does so between two times that are remembered."""
        poses = {
            body: [self._simulation.body_pose(body, at_ns) for at_ns in (begin_ns, end_ns)]
            for body in {body for body, _, _ in self._moving}
        }
        return [
            _core.ShapeMotion(
                shape, begin=poses[body][0] @ body_from_geom, end=poses[body][1] @ body_from_geom
            )
            for body, shape, body_from_geom in self._moving
        ]

    def radiance(
        self,
        rays: _core.CameraRays,
        poses: _core.ShutterPoses,
        *,
        channels: int = 1,
        threads: int = 1,
    ) -> NDArray[np.float32]:
        """Return (H, W) or (H, W, 3) radiance of a camera, the mean over its exposure.

        What `poses` does not move is where it was when this was made. Any number of threads may
        call this at once; how many there are changes nothing.
        """
        seen = _core.render(
            self._scene,
            rays,
            poses,
            channels=channels,
            threads=threads,
            edge_samples=EDGE_SAMPLES,
            with_depth=False,
        )
        return np.asarray(seen["radiance"])

    def depth_m(self, name: str, rays: _core.CameraRays, *, at_ns: int) -> NDArray[np.float32]:
        """Return (H, W) depth along the camera's z, metres; 0 where nothing is seen."""
        pose = _core.RowExposure(self._simulation.camera_pose(name, at_ns))
        poses = _core.ShutterPoses(first=pose, moving=self.motions(at_ns, at_ns))
        seen = _core.render(self._scene, rays, poses, edge_samples=1)
        return np.asarray(seen["depth_m"])

    def _add_geom(self, geom: int) -> None:
        model = self._model
        is_seen = _rgba(model, geom)[3] > 0 and model.geom_group[geom] < HIDDEN_GROUP
        kind = KINDS.get(mujoco.mjtGeom(int(model.geom_type[geom])))
        if not is_seen or kind is None:
            return
        shape = self._scene.add_shape(
            kind=kind,
            size_m=model.geom_size[geom].tolist(),
            material=self._material(geom),
            world_from_shape=self._geom_pose(geom),
            data=self._data(geom, kind),
            texture_scale=self._textures.scale(geom),
        )
        body = int(model.geom_bodyid[geom])
        if moves(model, body):
            body_from_geom = Transform(
                translation_m=model.geom_pos[geom], quaternion_wxyz=model.geom_quat[geom]
            )
            self._moving.append((body, shape, body_from_geom))

    def _geom_pose(self, geom: int) -> Transform:
        pose = np.eye(4)
        pose[:3, :3] = self._simulation.data.geom_xmat[geom].reshape(3, 3)
        pose[:3, 3] = self._simulation.data.geom_xpos[geom]
        return Transform.from_matrix(pose)

    def _data(self, geom: int, kind: _core.ShapeKind) -> int:
        model, number = self._model, self._model.geom_dataid[geom]
        if kind == _core.ShapeKind.height_field:
            rows, columns = model.hfield_nrow[number], model.hfield_ncol[number]
            first = model.hfield_adr[number]
            half_x_m, half_y_m, top_m, _ = model.hfield_size[number].tolist()
            heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
            return self._scene.add_height_field(
                heights_m=np.ascontiguousarray(top_m * heights, np.float32),
                half_x_m=half_x_m,
                half_y_m=half_y_m,
            )
        if kind == _core.ShapeKind.mesh:
            vertices, faces, texture = read_mesh(model, number)
            return self._scene.add_mesh(vertices_m=vertices, faces=faces, texture=texture)
        return -1

    def _material(self, geom: int) -> int:
        """Return the scene's material of a geom: its colour, with its surface and its texture."""
        model, number = self._model, int(self._model.geom_matid[geom])
        rgb = _rgba(model, geom)[:3]
        key = (number, *(255 * rgb).astype(int).tolist())
        if key not in self._materials:
            albedo = max(0.02, float(rgb @ LUMINANCE))
            red, green, blue = (rgb / albedo).tolist()
            note = self._notes.get(model.material(number).name) if number >= 0 else None
            made = _core.Material(
                albedo=albedo,
                colour=(red, green, blue),
                layers=self._painter.layers(note[0], albedo=albedo, seed=note[1], scale=note[2])
                if note
                else [],
                texture=self._textures.index(number),
            )
            self._materials[key] = self._scene.add_material(made)
        return self._materials[key]

    def _set_light(self) -> None:
        model = self._model
        directional = int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
        suns = [i for i in range(model.nlight) if model.light_type[i] == directional]
        lamps = [i for i in range(model.nlight) if model.light_type[i] != directional]
        to_sun = -model.light_dir[suns[0]] if suns else np.array([0.0, 0.0, 1.0])
        is_lit = bool(suns or lamps)
        self._scene.set_light(
            to_sun=to_sun.tolist(),
            sun=SUN if suns else 0.0,
            # Without a light of its own a world is lit evenly; indoors the walls throw light back.
            sky=SKY if suns else INDOORS if is_lit else EVEN,
            sky_slope=SKY_SLOPE if suns else 0.1,
            background=BACKGROUND,
            lamps=[(self._simulation.data.light_xpos[i].tolist(), LAMP) for i in lamps],
        )


def camera_rays(camera: Camera) -> _core.CameraRays:
    """Return the rays of a camera's pixels, made once and used for every picture."""
    return _core.CameraRays(camera)


def _rgba(model: Any, geom: int) -> NDArray[np.float32]:
    """Return a geom's own colour where it has one, else its material's, as MuJoCo does."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    is_own = material < 0 or not np.array_equal(own, NO_COLOUR)
    return np.asarray(own if is_own else model.mat_rgba[material])


def _surface_notes(model: Any) -> dict[str, tuple[str, int, float]]:
    """Return kind, seed and scale by material, from `<custom>` texts."""
    notes = {}
    for i in range(model.ntext):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, i)
        if not name.startswith(SURFACE_PREFIX):
            continue
        first = model.text_adr[i]
        data = bytes(model.text_data[first : first + model.text_size[i]]).rstrip(b"\0").decode()
        material = name.removeprefix(SURFACE_PREFIX)
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MATERIAL, material) < 0:
            raise InputError(f"text {name!r} names no material; write surface:MATERIAL")
        notes[material] = _read_surface(name, data)
    return notes


def _read_surface(name: str, text: str) -> tuple[str, int, float]:
    """Return kind, seed and scale of a note; InputError says how one is written."""
    kind, *settings = text.split() or [""]
    if kind not in SURFACES:
        raise InputError(f"{name}: surface {kind!r} {unknown(kind, SURFACES)}")
    pairs = [setting.partition("=") for setting in settings]
    values = read_options(Grain, {key: value for key, _, value in pairs}, name)
    return kind, values.seed, values.scale
