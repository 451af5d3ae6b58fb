# SPDX-License-Identifier: Apache-2.0
"""Writes MJCF: one scene, its materials with their surfaces, its geoms and lights."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

# Grey-world colours for tools that know nothing of procedural surfaces.
SURFACES: dict[str, tuple[float, float, float]] = {
    "asphalt": (0.24, 0.24, 0.25),
    "soil": (0.36, 0.27, 0.19),
    "sand": (0.72, 0.62, 0.45),
    "carpet": (0.33, 0.36, 0.42),
    "plaster": (0.85, 0.83, 0.78),
    "wood": (0.52, 0.36, 0.21),
    "grass": (0.23, 0.36, 0.14),
    "gravel": (0.48, 0.46, 0.43),
    "brick": (0.55, 0.28, 0.21),
    "poster": (0.80, 0.55, 0.40),
    "bark": (0.30, 0.22, 0.16),
    "leaves": (0.17, 0.33, 0.12),
}
SURFACE_PREFIX = "surface:"
START = "start"  # numeric: x (m), y (m), yaw (rad) of the robot
WALK_PREFIX = "walk:"

Vector = Sequence[float] | NDArray[np.float64]


class Scene:
    """An MJCF document that grows; lengths in metres, angles in radians, z up."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        self.rng = rng
        self._root = ElementTree.Element("mujoco", model=name)
        ElementTree.SubElement(self._root, "compiler", angle="radian", autolimits="true")
        self._visual = ElementTree.SubElement(self._root, "visual")
        self._custom = ElementTree.SubElement(self._root, "custom")
        self._asset = ElementTree.SubElement(self._root, "asset")
        self._world = ElementTree.SubElement(self._root, "worldbody")
        self.world = Part(self._world)
        self._materials: set[str] = set()

    def surface(self, kind: str, *, name: str | None = None, scale: float = 1.0) -> str:
        """Return the name of a material with the procedural surface `kind`, its seed drawn."""
        material = name or kind
        if material not in self._materials:
            seed = int(self.rng.integers(1, 2**31))
            self.note(SURFACE_PREFIX + material, f"{kind} seed={seed} scale={_number(scale)}")
            self.paint(material, SURFACES[kind])
        return material

    def paint(self, name: str, rgb: Vector) -> str:
        """Return the name of a matt material of one colour, `rgb` each 0 to 1."""
        if name not in self._materials:
            self._materials.add(name)
            _add(self._asset, "material", name=name, rgba=[*rgb, 1.0], specular=0.05)
        return name

    def note(self, name: str, text: str) -> None:
        """Add a custom text, which other tools ignore."""
        _add(self._custom, "text", name=name, data=text)

    def start(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Say where the robot begins."""
        _add(self._custom, "numeric", name=START, data=[x_m, y_m, yaw_rad])

    def body(self, name: str, position: Vector, yaw_rad: float = 0, *, mocap: bool = False) -> Part:
        """Add a body to the world, still or (`mocap`) moved by the clock, and return it."""
        attributes: dict[str, Any] = {"pos": position, "quat": yaw_quaternion(yaw_rad)}
        if mocap:
            attributes["mocap"] = "true"
        return Part(_add(self._world, "body", name=name, **attributes))

    def height_field(self, name: str, size: Vector, elevation: NDArray[np.float64]) -> None:
        """Add the asset: half extents, height and depth (m); `elevation` (rows, columns) 0 to 1.

        Its first row lies at the smallest y.
        """
        rows, columns = elevation.shape
        # MJCF gives the rows of a height field from the largest y down.
        values = " ".join(f"{v:.4f}" for v in elevation[::-1].ravel())
        _add(
            self._asset,
            "hfield",
            name=name,
            nrow=rows,
            ncol=columns,
            size=size,
            elevation=values,
        )

    def sun(self, azimuth_rad: float, elevation_rad: float) -> None:
        """Add the sun, whose light comes from that direction, and the sky."""
        level = cos(elevation_rad)
        direction = [
            -level * cos(azimuth_rad),
            -level * sin(azimuth_rad),
            -sin(elevation_rad),
        ]
        _add(
            self._world,
            "light",
            name="sun",
            type="directional",
            dir=direction,
            pos=[-10 * d for d in direction],
            diffuse=[0.9, 0.87, 0.8],
            castshadow="true",
        )
        self._headlight(0.35)
        _add(
            self._asset,
            "texture",
            name="sky",
            type="skybox",
            builtin="gradient",
            rgb1=[0.45, 0.62, 0.85],
            rgb2=[0.85, 0.9, 0.95],
            width=64,
            height=384,
        )

    def lamp(self, name: str, position: Vector) -> None:
        """Add a lamp under a ceiling and, with the first, the light the walls throw back."""
        if self._visual.find("headlight") is None:
            self._headlight(0.45)
        _add(
            self._world,
            "light",
            name=name,
            type="point",
            pos=position,
            dir=[0, 0, -1],
            diffuse=[0.5, 0.48, 0.45],
            attenuation=[1, 0.1, 0.05],
            castshadow="false",
        )

    def text(self) -> str:
        """Return the MJCF."""
        ElementTree.indent(self._root, " ")
        return ElementTree.tostring(self._root, encoding="unicode") + "\n"

    def _headlight(self, ambient: float) -> None:
        _add(
            self._visual,
            "headlight",
            ambient=[ambient] * 3,
            diffuse=[0, 0, 0],
            specular=[0, 0, 0],
        )


class Part:
    """The world or a body in it, whose geoms are given in its own frame."""

    def __init__(self, element: ElementTree.Element) -> None:
        self._element = element

    def geom(
        self,
        kind: str,
        size: Vector,
        position: Vector,
        material: str,
        *,
        solid: bool = True,
        **attributes: Any,
    ) -> None:
        """Add a geom; one that is not `solid` is seen and nothing else."""
        if not solid:
            attributes |= {"contype": 0, "conaffinity": 0}
        attributes |= {"size": size, "pos": position, "material": material}
        _add(self._element, "geom", type=kind, **attributes)


def yaw_quaternion(yaw_rad: float) -> list[float]:
    """Return the quaternion wxyz of a turn about z."""
    return [cos(yaw_rad / 2), 0.0, 0.0, sin(yaw_rad / 2)]


def _add(parent: ElementTree.Element, tag: str, **attributes: Any) -> ElementTree.Element:
    texts = {key: _text(value) for key, value in attributes.items()}
    return ElementTree.SubElement(parent, tag, texts)


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, int | float):
        return _number(value)
    if isinstance(value, Sequence | np.ndarray):
        return " ".join(_number(float(v)) for v in value)
    raise TypeError(f"{value!r} cannot be written as an attribute")


def _number(value: float) -> str:
    # Micrometres: enough for a world, and short; -0 would differ from 0 in the text alone.
    return f"{round(float(value), 6) + 0.0:.10g}"
