"""The text of a URDF: refused where hostile or wrong, read by yourdfpy, its mesh names turned into local paths."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import InputError, MeshError, ModelError
from geomphys.world.sources import is_there, note_contents

Floats = NDArray[np.float64]

LARGEST_FILE = 64 * 2**20
"""bytes"""
DEEPEST = 32
"""levels of elements"""
MOST_LINKS = 2000
LONGEST_TEXT = 65_536
"""characters of an attribute"""
JOINT_TYPES = ("fixed", "revolute", "continuous", "prismatic")
SHAPES = ("box", "cylinder", "sphere", "mesh")
LARGEST = 1e6
"""m or rad; a larger number in a model is taken for a mistake"""


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


def read_urdf(path: Path) -> Urdf:
    """Read and check a URDF's elements one by one; how they hang together is checked by `load_skeleton`.

    Raises ModelError (file, element, what is wrong) and MeshError (mesh names that are no local mesh path).
    """
    data = _bytes(path)
    _check_elements(path, data)
    import yourdfpy

    try:
        urdf = yourdfpy.URDF.load(BytesIO(data), build_scene_graph=False, load_meshes=False)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, SyntaxError, TypeError, ValueError) as error:
        raise ModelError(f"{path}: not a URDF that can be read ({type(error).__name__})") from None
    robot = urdf.robot
    links = [
        UrdfLink(
            link.name,
            [_element(path, link.name, e) for e in link.visuals],
            [_element(path, link.name, e) for e in link.collisions],
        )
        for link in robot.links
    ]
    return Urdf(robot.name, links, robot.joints)


def mesh_file(name: str, folder: Path) -> Path:
    """Local path of a mesh named in a URDF of this folder.

    `file://` URLs, `package://` URLs and paths relative to the folder. A package is looked for in the folder and those
    above it, as a sub-folder or as the folder itself, and then in $ROS_PACKAGE_PATH and $AMENT_PREFIX_PATH.

    Raises MeshError for other URLs and where a package is not found.
    """
    shown = "".join(c if c.isprintable() else "?" for c in name[:200])
    scheme, sign, rest = name.partition("://")
    if "\0" in name:
        raise MeshError(f"{shown}: is not a path")
    if not sign:
        return folder / name
    if scheme == "file":
        host, slash, local = rest.partition("/")
        if host not in ("", "localhost"):
            raise MeshError(f"{shown}: lies on another machine, only local files are read")
        return Path(unquote(slash + local))
    if scheme != "package":
        raise MeshError(f"{shown}: only file://, package:// and relative paths are read")
    rest = unquote(rest)
    package, _, inner = rest.partition("/")
    for up in (folder, *folder.parents):
        if is_there(up / rest):
            return up / rest
        if up.name == package and is_there(up / inner):
            return up / inner
    for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for entry in os.environ.get(variable, "").split(os.pathsep):
            base = Path(entry) / inside
            if entry and is_there(base / rest):
                return base / rest
            if entry and base.name == package and is_there(base / inner):
                return base / inner
    raise MeshError(
        f"{shown}: package {package!r} was not found in the folders above {folder}, "
        "nor in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH: set one of them or put the files beside the URDF"
    )


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


def _check_elements(path: Path, data: bytes) -> None:
    """What URDF demands of its elements, so that an error can name the one that lacks it."""
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        root = fromstring(data, forbid_dtd=True)
    except DefusedXmlException as error:
        raise ModelError(f"{path}: declares entities or a DTD ({type(error).__name__}), which is refused") from None
    except ParseError as error:
        line = f"line {error.position[0]}" if error.position else "somewhere"
        raise ModelError(f"{path}: not well-formed XML at {line}, expected a URDF") from None
    except (ValueError, LookupError):
        raise ModelError(f"{path}: not XML text in a known encoding, expected a URDF") from None
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise ModelError(f"{path}: elements are nested deeper than {DEEPEST} levels, expected a URDF")
        if any(len(value) > LONGEST_TEXT for element in level for value in element.attrib.values()):
            raise ModelError(f"{path}: an attribute is longer than {LONGEST_TEXT} characters, expected a URDF")
        level = [child for element in level for child in element]
    if root.tag != "robot":
        raise ModelError(f"{path}: the outermost element is <{_shown(str(root.tag))}>, expected <robot>")
    if root.get("name") is None:
        raise ModelError(f"{path}: <robot> has no name")
    count = len(root.findall("link"))
    if not 1 <= count <= MOST_LINKS:
        raise ModelError(f"{path}: has {count or 'no'} links, expected 1 to {MOST_LINKS}")
    for kind in ("link", "joint"):
        seen: set[str] = set()
        for position, element in enumerate(root.findall(kind)):
            name = element.get("name")
            if not name or not name.isprintable() or name != name.strip():
                raise ModelError(f"{path}: {kind} number {position + 1} has no usable name ({_shown(str(name))})")
            if name in seen:
                raise ModelError(f"{path}: two {kind}s are named {name!r}")
            seen.add(name)
            if kind == "joint":
                _check_joint(path, name, element)
            else:
                _check_link(path, name, element)


def _check_joint(path: Path, name: str, element: Any) -> None:
    kind = element.get("type")
    if kind not in JOINT_TYPES:
        raise ModelError(
            f"{path}: joint {name!r} has the type {_shown(str(kind))}, only {', '.join(JOINT_TYPES)} are supported"
        )
    for end in ("parent", "child"):
        found = element.find(end)
        if found is None or not found.get("link"):
            raise ModelError(f"{path}: joint {name!r} has no <{end} link=...>")
    mimic = element.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        raise ModelError(f"{path}: joint {name!r} has a <mimic> without the joint it follows")
    _check_numbers(path, f"joint {name!r}", element)


def _check_link(path: Path, name: str, element: Any) -> None:
    for kind in ("visual", "collision"):
        for entry in element.findall(kind):
            geometry = entry.find("geometry")
            shapes = [] if geometry is None else list(geometry)
            if len(shapes) != 1 or shapes[0].tag not in SHAPES:
                found = ", ".join(_shown(str(s.tag)) for s in shapes) or "nothing"
                raise ModelError(
                    f"{path}: link {name!r} has a <{kind}> of {found}, expected one of {', '.join(SHAPES)}"
                )
            if shapes[0].tag == "mesh" and not shapes[0].get("filename"):
                raise ModelError(f"{path}: link {name!r} has a <mesh> without a filename")
            _check_numbers(path, f"link {name!r}", entry)


# element -> attribute -> how many numbers (None: one or three)
_NUMBERS: dict[str, dict[str, int | None]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {"scale": None},
}
_REQUIRED = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length")}


def _check_numbers(path: Path, where: str, element: Any) -> None:
    for entry in element.iter():
        for key in _REQUIRED.get(entry.tag, ()):
            if entry.get(key) is None:
                raise ModelError(f"{path}: {where}: <{entry.tag}> has no {key}")
        for key, count in _NUMBERS.get(entry.tag, {}).items():
            text = entry.get(key)
            if text is None:
                continue
            words, found = text.replace(",", " ").split(), f"{path}: {where}: <{entry.tag} {key}={_shown(text)}>"
            try:
                numbers = [float(word) for word in words]
            except ValueError:
                raise ModelError(f"{found}, expected numbers") from None
            if len(numbers) not in ((1, 3) if count is None else (count,)):
                raise ModelError(f"{found}, expected {count or '1 or 3'} numbers")
            if any(math.isnan(n) or (abs(n) > LARGEST and entry.tag != "limit") for n in numbers):
                raise ModelError(f"{found}, expected finite numbers of at most {LARGEST:g}")


def _element(path: Path, link: str, element: Any) -> tuple[Shape, Floats]:
    """Shape and link_from_shape of a visual or collision element of yourdfpy."""
    where, geometry = f"link {link!r}", element.geometry
    matrix = np.eye(4) if element.origin is None else np.asarray(element.origin, dtype=np.float64) + 0.0
    shape: Shape
    if geometry.box is not None:
        shape = BoxShape(_lengths(path, where, "box", geometry.box.size))
    elif geometry.sphere is not None:
        shape = SphereShape(_lengths(path, where, "sphere", [geometry.sphere.radius])[0])
    elif geometry.cylinder is not None:
        size = _lengths(path, where, "cylinder", [geometry.cylinder.radius, geometry.cylinder.length])
        shape = CylinderShape(size[0], size[1])
    else:
        scale = np.broadcast_to(np.float64(1.0) if geometry.mesh.scale is None else geometry.mesh.scale, 3)
        if np.any(scale == 0):
            raise ModelError(f"{path}: {where}: a mesh has a scale of 0")
        try:
            file = mesh_file(geometry.mesh.filename, path.parent)
        except InputError as error:
            raise MeshError(f"{path}: {where}: {error}") from None
        shape = MeshShape(file, (float(scale[0]), float(scale[1]), float(scale[2])))
    return shape, matrix


def _lengths(path: Path, where: str, what: str, values: Any) -> Any:
    """Positive lengths."""
    if min(values) < 1e-6:
        raise ModelError(f"{path}: {where}: a {what} of {[float(v) for v in values]} m, expected at least 1e-6")
    return tuple(float(v) for v in values)


def _shown(text: str) -> str:
    shown = "".join(c if c.isprintable() else " " for c in text)
    return repr(shown if len(shown) <= 60 else shown[:57] + "...")
