# SPDX-License-Identifier: Apache-2.0
"""Whether a point lies inside something: a camera in a wall or below the ground sees nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from pilotage.simulation.body import PREFIX

Array = NDArray[np.float64]
Kind = mujoco.mjtGeom


class Solids:
    """Everything in a model that stays where it is and can be seen or hit, without the robot."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model = model
        geoms = [geom for geom in range(model.ngeom) if _is_fixed(model, geom)]
        self._by_kind = {
            kind: np.array([g for g in geoms if model.geom_type[g] == kind], np.intp)
            for kind in TESTS
        }
        self._positions = data.geom_xpos.copy()
        self._turns = data.geom_xmat.reshape(-1, 3, 3).copy()

    def around(self, point_m: Array) -> str | None:
        """Return the name of what a point (3,) of the world lies in, None when it is free."""
        for kind, geoms in self._by_kind.items():
            if not len(geoms):
                continue
            apart = point_m - self._positions[geoms]
            local = np.einsum("gij,gi->gj", self._turns[geoms], apart)
            inside = TESTS[kind](self._model, geoms, local)
            if inside.any():
                return self._name(int(geoms[np.argmax(inside)]))
        return None

    def _name(self, geom: int) -> str:
        model = self._model
        body, material = int(model.geom_bodyid[geom]), int(model.geom_matid[geom])
        if name := model.geom(geom).name:
            return repr(name)
        if body > 0 and model.body(body).name:
            return f"a geom of body {model.body(body).name!r}"
        if material >= 0:
            return f"a geom of material {model.material(material).name!r}"
        return f"geom {geom}"


def _is_fixed(model: Any, geom: int) -> bool:
    body = model.geom_bodyid[geom]
    is_robot = model.body(model.body_rootid[body]).name.startswith(PREFIX)
    is_solid = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
    if model.geom_type[geom] == Kind.mjGEOM_PLANE and not is_solid:
        return False  # a picture on a wall has no inside
    is_still = model.body_weldid[body] == 0 and model.body_mocapid[body] < 0
    return is_still and not is_robot and (is_solid or model.geom_rgba[geom, 3] > 0)


def _in_plane(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    del model, geoms  # MuJoCo's planes are solid all the way, whatever part of them is shown
    return np.asarray(local[:, 2] < 0)


def _in_sphere(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(local, axis=1) < model.geom_size[geoms, 0])


def _in_capsule(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    radius, half = model.geom_size[geoms, 0], model.geom_size[geoms, 1]
    along = local[:, 2] - np.clip(local[:, 2], -half, half)
    return np.asarray(np.hypot(np.hypot(local[:, 0], local[:, 1]), along) < radius)


def _in_ellipsoid(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(local / model.geom_size[geoms], axis=1) < 1)


def _in_cylinder(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    is_within = np.hypot(local[:, 0], local[:, 1]) < model.geom_size[geoms, 0]
    return np.asarray(is_within & (np.abs(local[:, 2]) < model.geom_size[geoms, 1]))


def _in_box(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    return np.asarray((np.abs(local) < model.geom_size[geoms]).all(axis=1))


def _in_height_field(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    return np.array(
        [_below(model, model.geom_dataid[g], p) for g, p in zip(geoms, local, strict=True)]
    )


def _below(model: Any, field: int, point: Array) -> bool:
    half_x, half_y, top, base = model.hfield_size[field]
    x, y = point[0] / half_x, point[1] / half_y
    if max(abs(x), abs(y)) >= 1 or not -base < point[2] < top:
        return False
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first = model.hfield_adr[field]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    column, row = (x + 1) / 2 * (columns - 1), (y + 1) / 2 * (rows - 1)
    i, j = min(int(row), rows - 2), min(int(column), columns - 2)
    u, v = row - i, column - j
    upper = (1 - v) * heights[i, j] + v * heights[i, j + 1]
    lower = (1 - v) * heights[i + 1, j] + v * heights[i + 1, j + 1]
    return bool(point[2] < top * ((1 - u) * upper + u * lower))


def _in_mesh(model: Any, geoms: NDArray[np.intp], local: Array) -> NDArray[np.bool_]:
    near = np.linalg.norm(local, axis=1) < model.geom_rbound[geoms]
    for index in np.flatnonzero(near):
        near[index] = _is_enclosed(model, int(model.geom_dataid[geoms[index]]), local[index])
    return np.asarray(near)


def _is_enclosed(model: Any, mesh: int, point: Array) -> bool:
    """Tell whether a ray upwards leaves the mesh more often than it enters it."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]] - point
    corners = vertices[model.mesh_face[face : face + model.mesh_facenum[mesh]]]
    a, b, c = (corners[:, k].astype(np.float64) for k in range(3))
    # Signed areas of the triangles that the ray makes with each edge, seen from above.
    ab, bc, ca = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((a, b), (b, c), (c, a)))
    area = ab + bc + ca
    is_hit = ((ab >= 0) & (bc >= 0) & (ca >= 0)) | ((ab <= 0) & (bc <= 0) & (ca <= 0))
    is_hit &= area != 0
    height = (bc * a[:, 2] + ca * b[:, 2] + ab * c[:, 2])[is_hit] / area[is_hit]
    return bool(np.sign(area[is_hit])[height > 0].sum() > 0)


TESTS: dict[Any, Callable[[Any, NDArray[np.intp], Array], NDArray[np.bool_]]] = {
    Kind.mjGEOM_PLANE: _in_plane,
    Kind.mjGEOM_HFIELD: _in_height_field,
    Kind.mjGEOM_SPHERE: _in_sphere,
    Kind.mjGEOM_CAPSULE: _in_capsule,
    Kind.mjGEOM_ELLIPSOID: _in_ellipsoid,
    Kind.mjGEOM_CYLINDER: _in_cylinder,
    Kind.mjGEOM_BOX: _in_box,
    Kind.mjGEOM_MESH: _in_mesh,
}
