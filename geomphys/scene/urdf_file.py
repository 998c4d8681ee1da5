"""The text of a URDF: refused where hostile or wrong, read by yourdfpy, its mesh names turned into local paths."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, ParseError, tostring

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import ModelError
from geomphys.scene.packages import MeshFinder
from geomphys.scene.source_files import note_contents
from geomphys.scene.urdf_elements import checked_robot
from geomphys.scene.urdf_kinds import XACRO_USE, expand_xacro, other_kind

Floats = NDArray[np.float64]

LARGEST_FILE = 64 * 2**20
"""bytes"""


@dataclass(frozen=True)
class BoxShape:
    """A box by its full edge lengths, m."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class SphereShape:
    """A sphere, m."""

    radius: float


@dataclass(frozen=True)
class CylinderShape:
    """A cylinder along z by radius and full length, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class CapsuleShape:
    """A capsule along z by radius and length without the caps, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class MeshShape:
    """A mesh file and what its coordinates are multiplied by."""

    path: Path
    scale: tuple[float, float, float]


Shape = BoxShape | SphereShape | CylinderShape | CapsuleShape | MeshShape


class UrdfLink(NamedTuple):
    """A link: shapes with link_from_shape (4, 4)."""

    name: str
    visuals: list[tuple[Shape, Floats]]
    collisions: list[tuple[Shape, Floats]]


class Urdf(NamedTuple):
    """Links and yourdfpy's joints in the order of the file."""

    name: str
    links: list[UrdfLink]
    joints: list[Any]
    not_shown: tuple[str, ...]  # what is wrong with visuals, which are left out


def read_urdf(path: Path) -> Urdf:
    """Read and check a URDF's elements one by one; how they hang together is checked by `load_skeleton`.

    Only what is used is read: whatever else is wrong in the file does no harm. A capsule's length is without its caps.

    Raises ModelError (file, element, what is wrong) and MeshError (names of collision meshes that are no local path).
    """
    checked = checked_robot(path, _tree(path, _bytes(path)))
    import yourdfpy

    try:
        urdf = yourdfpy.URDF.load(BytesIO(tostring(checked.root)), build_scene_graph=False, load_meshes=False)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, SyntaxError, TypeError, ValueError) as error:
        raise ModelError(f"{path}: not a URDF that can be read ({type(error).__name__})") from None
    robot = urdf.robot

    def placed(link: str, kind: str, elements: list[Any]) -> list[tuple[Shape, Floats]]:
        return [
            (_shape(e.geometry, (link, kind, k) in checked.capsules, checked.finder), _origin(e.origin))
            for k, e in enumerate(elements)
        ]

    links = [
        UrdfLink(link.name, placed(link.name, "visual", link.visuals), placed(link.name, "collision", link.collisions))
        for link in robot.links
    ]
    return Urdf(robot.name, links, robot.joints, tuple(checked.not_shown))


def _origin(matrix: Any) -> Floats:
    return np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64) + 0.0


def _bytes(path: Path) -> bytes:
    try:
        if not path.is_file():
            raise ModelError(f"{path}: is not a file, expected a URDF" if path.exists() else f"{path}: no such URDF")
        if path.stat().st_size > LARGEST_FILE:
            raise ModelError(f"{path}: is larger than {LARGEST_FILE // 2**20} MiB, too large for a URDF")
        return note_contents(path, path.read_bytes())
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError:
        raise ModelError(f"{path}: is not a path") from None


def _tree(path: Path, data: bytes) -> Element:
    """The XML tree; ModelError where it is none, or declares entities or a DTD."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    if other := other_kind(data):
        raise ModelError(f"{path}: {other}")
    try:
        tree: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException as error:
        raise ModelError(f"{path}: declares entities or a DTD ({type(error).__name__}), which is refused") from None
    except ParseError as error:
        if XACRO_USE.search(data):
            raise ModelError(f"{path}: {expand_xacro(path, 'it has xacro elements')}") from None
        line = f"line {error.position[0]}" if error.position else "somewhere"
        raise ModelError(f"{path}: not well-formed XML at {line}, expected a URDF") from None
    except (ValueError, LookupError):
        raise ModelError(f"{path}: not XML text in a known encoding, expected a URDF") from None
    return tree


def _shape(geometry: Any, is_capsule: bool, finder: MeshFinder) -> Shape:
    if geometry.box is not None:
        x, y, z = (float(v) for v in geometry.box.size)
        return BoxShape((x, y, z))
    if geometry.sphere is not None:
        return SphereShape(float(geometry.sphere.radius))
    if geometry.cylinder is not None:
        radius, length = float(geometry.cylinder.radius), float(geometry.cylinder.length)
        if is_capsule:
            return CapsuleShape(radius, length) if length > 0.0 else SphereShape(radius)
        return CylinderShape(radius, length)
    scale = np.broadcast_to(np.float64(1.0) if geometry.mesh.scale is None else geometry.mesh.scale, 3)
    return MeshShape(finder.find(geometry.mesh.filename), (float(scale[0]), float(scale[1]), float(scale[2])))
