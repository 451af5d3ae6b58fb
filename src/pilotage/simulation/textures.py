# SPDX-License-Identifier: Apache-2.0
"""Textures of MJCF's materials: decoded by MuJoCo, laid on shapes as its own renderer lays them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage import _core
from pilotage.errors import InputError

WHITE = 65535
ROLES = (int(mujoco.mjtTextureRole.mjTEXROLE_RGB), int(mujoco.mjtTextureRole.mjTEXROLE_RGBA))
FLAT = int(mujoco.mjtTexture.mjTEXTURE_2D)
ROUND = (
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
)
# MuJoCo draws the others as shapes of half length 1 and stretches them.
IN_METRES = (
    mujoco.mjtGeom.mjGEOM_PLANE,
    mujoco.mjtGeom.mjGEOM_HFIELD,
    mujoco.mjtGeom.mjGEOM_MESH,
)


class TexturePainter:
    """Adds a model's textures to one scene, each once."""

    def __init__(self, scene: _core.Scene, model: Any) -> None:
        self._scene = scene
        self._model = model
        self._indices: dict[int, int] = {}

    def index(self, material: int) -> int:
        """Return the scene's texture of a material of the model, -1 without one."""
        texture = _texture_of(self._model, material)
        if texture < 0:
            return -1
        if texture not in self._indices:
            texels = read_texels(self._model, texture)
            self._indices[texture] = self._scene.add_texture(texels)
        return self._indices[texture]

    def scale(self, geom: int) -> list[float]:
        """Return how a geom's texture is stretched, in the words of Scene.add_shape."""
        model, material = self._model, int(self._model.geom_matid[geom])
        texture = _texture_of(model, material)
        if texture < 0:
            return [1.0, 1.0, 1.0]
        kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom].copy()
        if kind in ROUND:
            size = size[[0, 0, 0 if kind == mujoco.mjtGeom.mjGEOM_SPHERE else 1]]
        is_uniform = bool(model.mat_texuniform[material])
        if model.tex_type[texture] == FLAT:
            repeats, extent = model.mat_texrepeat[material], np.where(size > 0, size, 1.0)[:2]
            if _is_laid_flat(model, geom):
                per_m = 0.5 * repeats / (1.0 if is_uniform else extent)
                return [*per_m.tolist(), 1.0]
            return [*(repeats * (extent if is_uniform else 1.0)).tolist(), 1.0]
        if kind in IN_METRES:
            return size.tolist() if is_uniform else [1.0, 1.0, 1.0]
        return [1.0, 1.0, 1.0] if is_uniform else (1 / size).tolist()


def read_texels(model: Any, texture: int) -> NDArray[np.uint16]:
    """Return (faces, H, W, 3) texels of a texture of the model: one face, or a cube's six.

    InputError when its file, left for later by `embed="false"`, cannot be read, or when it is
    encoded for another renderer.
    """
    name = model.tex(texture).name
    if _file_of(model, texture).lower().endswith(".ktx"):
        raise InputError(f"texture {name!r}: KTX cannot be drawn; give a PNG")
    try:
        values, colour_space = mujoco.mj_loadTexture(model, texture)
    except ValueError as error:
        raise InputError(f"texture {name!r}: {error}; check the file") from error
    height, width, channels = values.shape
    colours = values[..., [0, 0, 0] if channels < 3 else [0, 1, 2]]
    is_srgb = colour_space == int(mujoco.mjtColorSpace.mjCOLORSPACE_SRGB)
    texels: NDArray[np.uint16] = _linear_table(is_srgb=is_srgb)[colours]
    if model.tex_type[texture] == FLAT:
        return texels.reshape(1, height, width, 3)
    if height == width:
        return np.tile(texels, (6, 1, 1, 1))
    return texels.reshape(6, width, width, 3)


def read_mesh(
    model: Any, mesh: int
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32] | None]:
    """Return vertices (N, 3), faces (M, 3) and places in a texture (N, 2), None without.

    Where a texture is cut, MuJoCo names several places for one vertex: here it is then several.
    """
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
    first, texture = int(model.mesh_texcoordadr[mesh]), None
    if first >= 0:
        places = model.mesh_texcoord[first : first + model.mesh_texcoordnum[mesh]]
        named = model.mesh_facetexcoord[face : face + model.mesh_facenum[mesh]]
        corners = np.column_stack([faces.ravel(), named.ravel()])
        pairs, numbers = np.unique(corners, axis=0, return_inverse=True)
        vertices, faces = vertices[pairs[:, 0]], numbers.reshape(-1, 3)
        texture = np.ascontiguousarray(places[pairs[:, 1]], np.float32)
    return (
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(faces, np.int32),
        texture,
    )


def _is_laid_flat(model: Any, geom: int) -> bool:
    """Return whether a geom has no places in a texture of its own: it then lies on x and y."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return bool(model.mesh_texcoordadr[model.geom_dataid[geom]] < 0)
    is_endless = kind == mujoco.mjtGeom.mjGEOM_PLANE and min(model.geom_size[geom, :2]) <= 0
    return bool(is_endless or kind == mujoco.mjtGeom.mjGEOM_HFIELD)


def _texture_of(model: Any, material: int) -> int:
    if material < 0:
        return -1
    return max((int(model.mat_texid[material, role]) for role in ROLES), default=-1)


def _file_of(model: Any, texture: int) -> str:
    """Return the name of a texture's file, empty for one that MuJoCo made."""
    first = int(model.tex_pathadr[texture])
    return bytes(model.paths[first:]).split(b"\0", 1)[0].decode() if first >= 0 else ""


def _linear_table(*, is_srgb: bool) -> NDArray[np.uint16]:
    """Return the brightness of each of 256 values."""
    values = np.arange(256) / 255
    if is_srgb:
        values = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    return np.round(WHITE * values).astype(np.uint16)
