"""Reads URDF files: XML validated (no entities, no DTDs), parsed by yourdfpy, mesh names resolved to local paths."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, ParseError, tostring

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import ModelError
from geomphys.scene.model_formats import XACRO_USE, other_format, xacro_advice
from geomphys.scene.primitives import PrimitiveShape
from geomphys.scene.ros_packages import MeshResolver
from geomphys.scene.source_files import track_contents
from geomphys.scene.urdf_elements import checked_robot
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

MAX_FILE_BYTES = 64 * 2**20
"""bytes"""


@dataclass(frozen=True)
class MeshShape:
    """A mesh file and its scale."""

    path: AnyPath
    scale: tuple[float, float, float]


Shape = PrimitiveShape | MeshShape


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
    not_shown: tuple[str, ...]  # problems of skipped visuals


def read_urdf(path: AnyPath) -> Urdf:
    """Read and validate the elements of a URDF; the tree structure is checked by `load_skeleton`.

    Elements that are not used are not validated. A capsule's length is without its caps.

    Raises ModelError (file, element, what is wrong) and MeshError (names of collision meshes that cannot be resolved).
    """
    checked = checked_robot(path, _parsed_xml(path, _read(path)))
    import yourdfpy

    try:
        urdf = yourdfpy.URDF.load(BytesIO(tostring(checked.root)), build_scene_graph=False, load_meshes=False)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, SyntaxError, TypeError, ValueError) as error:
        raise ModelError(f"{path}: not a URDF that can be read ({type(error).__name__})") from None
    robot = urdf.robot

    def posed_shapes(link: str, kind: str, elements: list[Any]) -> list[tuple[Shape, Floats]]:
        return [
            (checked.primitives.get((link, kind, k)) or _mesh(e.geometry.mesh, checked.resolver), _origin(e.origin))
            for k, e in enumerate(elements)
        ]

    links = [
        UrdfLink(
            link.name,
            posed_shapes(link.name, "visual", link.visuals),
            posed_shapes(link.name, "collision", link.collisions),
        )
        for link in robot.links
    ]
    return Urdf(robot.name, links, robot.joints, tuple(checked.not_shown))


def _origin(matrix: Any) -> Floats:
    return np.eye(4) if matrix is None else np.asarray(matrix, dtype=np.float64) + 0.0


def _read(path: AnyPath) -> bytes:
    try:
        if not path.is_file():
            raise ModelError(f"{path}: is not a file, expected a URDF" if path.exists() else f"{path}: no such URDF")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ModelError(f"{path}: is larger than {MAX_FILE_BYTES // 2**20} MiB, too large for a URDF")
        return track_contents(path, path.read_bytes())
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError:
        raise ModelError(f"{path}: is not a path") from None


def _parsed_xml(path: AnyPath, data: bytes) -> Element:
    """Parse the XML; ModelError if it is malformed or declares entities or a DTD."""
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    if format_problem := other_format(data):
        raise ModelError(f"{path}: {format_problem}")
    try:
        tree: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException as error:
        raise ModelError(f"{path}: declares entities or a DTD ({type(error).__name__}), which is refused") from None
    except ParseError as error:
        if XACRO_USE.search(data):
            raise ModelError(f"{path}: {xacro_advice(path, 'it has xacro elements')}") from None
        line = f"line {error.position[0]}" if error.position else "somewhere"
        raise ModelError(f"{path}: not well-formed XML at {line}, expected a URDF") from None
    except (ValueError, LookupError):
        raise ModelError(f"{path}: not XML text in a known encoding, expected a URDF") from None
    return tree


def _mesh(mesh: Any, resolver: MeshResolver) -> MeshShape:
    scale = np.broadcast_to(np.float64(1.0) if mesh.scale is None else mesh.scale, 3)
    return MeshShape(resolver.find(mesh.filename), (float(scale[0]), float(scale[1]), float(scale[2])))
