"""Mass, centre of mass and inertia tensor of solids of uniform density."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.transforms import quaternion_from_rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

DIAGONAL_TOLERANCE = 1e-12
"""Share of the largest moment below which products of inertia are rounding: the frame's axes are principal then."""


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties of a solid in some frame; all zero without volume."""

    mass: float  # kg
    com: Floats  # (3,) m
    inertia: Floats  # (3, 3) kg m², about the centre of mass, along the frame's axes

    def scaled(self, factor: float) -> MassProperties:
        """The same solid of another density."""
        return MassProperties(self.mass * factor, self.com, self.inertia * factor)

    def with_mass(self, mass: float) -> MassProperties:
        """The same solid with its density chosen so that it has this mass."""
        return MassProperties(mass, self.com, self.inertia * (mass / self.mass))

    def transformed(self, a_from_b: Floats) -> MassProperties:
        """In frame a, of properties in frame b; `a_from_b` (4, 4)."""
        rotation = a_from_b[:3, :3]
        return MassProperties(self.mass, rotation @ self.com + a_from_b[:3, 3], rotation @ self.inertia @ rotation.T)

    def principal(self) -> tuple[Floats, Floats]:
        """Principal moments (3,) and body_from_principal quaternion (4,) x y z w.

        The frame's own axes in their order where the tensor is diagonal; else moments ascend, and each axis points
        where its largest component is positive (the third completes the right hand).
        """
        tensor = 0.5 * (self.inertia + self.inertia.T)
        off = np.abs(tensor - np.diag(np.diag(tensor))).max()
        if off <= DIAGONAL_TOLERANCE * np.abs(np.diag(tensor)).max():
            return np.diag(tensor).copy(), np.array([0.0, 0.0, 0.0, 1.0])
        moments, axes = np.linalg.eigh(tensor)
        for k in range(2):
            if axes[np.argmax(np.abs(axes[:, k])), k] < 0:
                axes[:, k] = -axes[:, k]
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        return moments, quaternion_from_rotation(axes)


ZERO_MASS = MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))


def combined(parts: Sequence[MassProperties]) -> MassProperties:
    """Several solids as one body (parallel axes theorem). Where they overlap the mass counts twice."""
    mass = math.fsum(p.mass for p in parts)
    if mass == 0.0:
        return ZERO_MASS
    com = sum((p.mass * p.com for p in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for p in parts:
        offset = p.com - com
        inertia += p.inertia + p.mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset))
    return MassProperties(mass, com, inertia)


def _about_origin(mass: float, x: float, y: float, z: float) -> MassProperties:
    return MassProperties(mass, np.zeros(3), np.diag([x, y, z]))


def of_sphere(radius: float, density: float) -> MassProperties:
    """Ball about the origin: I = 2/5 m r²."""
    mass = density * 4.0 / 3.0 * math.pi * radius**3
    return _about_origin(mass, *[0.4 * mass * radius**2] * 3)


def of_box(size: tuple[float, float, float], density: float) -> MassProperties:
    """Box of full edge lengths about the origin: I_x = m (y² + z²) / 12."""
    x, y, z = size
    mass = density * x * y * z
    return _about_origin(mass, mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)


def of_cylinder(radius: float, height: float, density: float) -> MassProperties:
    """Cylinder of full height along z about the origin: I_z = m r² / 2, I_x = m (3 r² + h²) / 12."""
    mass = density * math.pi * radius**2 * height
    side = mass * (3 * radius**2 + height**2) / 12
    return _about_origin(mass, side, side, 0.5 * mass * radius**2)


def of_capsule(radius: float, height: float, density: float) -> MassProperties:
    """Capsule along z about the origin, `height` without its caps: a cylinder and two half balls.

    A half ball's centre of mass lies 3/8 r above its flat side; its moment about a diameter of that side is 2/5 m r².
    """
    cylinder = density * math.pi * radius**2 * height
    caps = density * 4.0 / 3.0 * math.pi * radius**3  # both caps together
    side = cylinder * (3 * radius**2 + height**2) / 12
    side += caps * (0.4 * radius**2 + 0.25 * height**2 + 0.375 * radius * height)
    return _about_origin(cylinder + caps, side, side, 0.5 * cylinder * radius**2 + 0.4 * caps * radius**2)


def of_mesh(vertices: Floats, faces: Ints, density: float) -> MassProperties:
    """Solid bounded by a closed triangle mesh: sums over tetrahedra between its triangles and an inner point.

    The triangles must be wound alike; wound inwards, they count as wound outwards.
    """
    shift = vertices.mean(axis=0)
    a, b, c = (vertices[faces[:, k]] - shift for k in range(3))
    volumes6 = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = math.fsum(volumes6) / 6.0
    if volume == 0.0:
        return ZERO_MASS
    com = np.einsum("i,ij->j", volumes6, a + b + c) / (24.0 * volume)
    total = a + b + c
    second = np.einsum("i,ij,ik->jk", volumes6, total, total)
    for corner in (a, b, c):
        second += np.einsum("i,ij,ik->jk", volumes6, corner, corner)
    second = second / 120.0 - volume * np.outer(com, com)
    inertia = np.trace(second) * np.eye(3) - second
    sign = math.copysign(density, volume)
    return MassProperties(sign * volume, com + shift, sign * inertia)
