"""Primitive shapes by their names in scene files and URDFs: convex piece, mass, triangles, how viewers draw them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

from geomphys.scene.mass import MassProperties, of_box, of_capsule, of_cylinder, of_sphere
from geomphys.scene.pieces import Box, Capsule, Cylinder, Shape, Sphere
from geomphys.scene.tessellation import (
    Triangles,
    box_triangles,
    capsule_triangles,
    cylinder_triangles,
    sphere_triangles,
)

Lengths: TypeAlias = tuple[float, ...]
Part: TypeAlias = tuple[str, Lengths, float]
"""A primitive that every viewer knows, and how far up z it is moved [m]."""


class Primitive(NamedTuple):
    """Properties of one kind. Functions take its lengths [m] in the order of scene files."""

    attributes: dict[str, int]  # of its URDF element: how many of the lengths each holds
    piece: Callable[[Lengths], Shape]
    mass: Callable[[Lengths, float], MassProperties]  # of a density, kg/m³
    triangles: Callable[[Lengths, int], Triangles]  # with so many segments
    parts: Callable[[Lengths], list[Part]] | None = None  # of boxes, spheres and cylinders; None: it is one of them
    without_length: str | None = None  # what it is where its last length is 0; None: that is an error


def _capsule_parts(lengths: Lengths) -> list[Part]:
    radius, length = lengths
    middle: list[Part] = [("cylinder", lengths, 0.0)] if length > 0.0 else []
    return [*middle, *(("sphere", (radius,), 0.5 * side * length) for side in (1.0, -1.0))]


PRIMITIVES = {
    "box": Primitive(
        attributes={"size": 3},
        piece=lambda n: Box((0.5 * n[0], 0.5 * n[1], 0.5 * n[2])),
        mass=lambda n, density: of_box((n[0], n[1], n[2]), density),
        triangles=lambda n, _: box_triangles((n[0], n[1], n[2])),
    ),
    "sphere": Primitive(
        attributes={"radius": 1},
        piece=lambda n: Sphere(n[0]),
        mass=lambda n, density: of_sphere(n[0], density),
        triangles=lambda n, segments: sphere_triangles(n[0], segments),
    ),
    "cylinder": Primitive(
        attributes={"radius": 1, "length": 1},
        piece=lambda n: Cylinder(n[0], 0.5 * n[1]),
        mass=lambda n, density: of_cylinder(n[0], n[1], density),
        triangles=lambda n, segments: cylinder_triangles(n[0], n[1], segments),
    ),
    "capsule": Primitive(
        attributes={"radius": 1, "length": 1},
        piece=lambda n: Capsule(n[0], 0.5 * n[1]),
        mass=lambda n, density: of_capsule(n[0], n[1], density),
        triangles=lambda n, segments: capsule_triangles(n[0], n[1], segments),
        parts=_capsule_parts,
        without_length="sphere",
    ),
}
"""Key of a scene file's object and tag of a URDF's geometry -> what it is. Along z, about the origin."""


@dataclass(frozen=True)
class PrimitiveShape:
    """A primitive: its name among `PRIMITIVES` and its lengths, m."""

    name: str
    lengths: Lengths

    @property
    def kind(self) -> Primitive:
        """Properties of its kind."""
        return PRIMITIVES[self.name]

    @property
    def parts(self) -> list[Part]:
        """The boxes, spheres and cylinders that viewers draw it as."""
        return [(self.name, self.lengths, 0.0)] if self.kind.parts is None else self.kind.parts(self.lengths)


def primitive_shape(name: str, lengths: Lengths) -> PrimitiveShape:
    """A primitive; a capsule without a length is a sphere."""
    if lengths[-1] == 0.0 and (other := PRIMITIVES[name].without_length) is not None:
        return PrimitiveShape(other, lengths[:-1])
    return PrimitiveShape(name, lengths)


def attributes_of(name: str, lengths: Lengths, number: Callable[[float], str] = repr) -> dict[str, str]:
    """Attributes of the URDF element of a primitive; `number` writes a length."""
    left, texts = list(lengths), {}
    for key, count in PRIMITIVES[name].attributes.items():
        texts[key] = " ".join(map(number, left[:count]))
        del left[:count]
    return texts
