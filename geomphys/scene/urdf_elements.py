"""Validates the elements of a URDF, so that errors name the element.

An invalid *visual* is no error: it is skipped and reported.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement

from geomphys.errors import InputError, MeshError, ModelError
from geomphys.scene.free_joints import FREE_TYPES
from geomphys.scene.model_formats import other_model, xacro_advice, xacro_remnant
from geomphys.scene.primitives import PRIMITIVES, PrimitiveShape, primitive_shape
from geomphys.scene.ros_packages import MeshResolver
from geomphys.storage.remote_files import AnyPath

MAX_DEPTH = 32
"""levels of elements"""
MAX_LINKS = 2000
MAX_ATTRIBUTE_LENGTH = 65_536
"""characters of an attribute"""
JOINT_TYPES = ("fixed", "revolute", "continuous", "prismatic")
SHAPES = (*PRIMITIVES, "mesh")
MAX_VALUE = 1e6
"""m or rad; larger numbers are errors"""
MIN_LENGTH = 1e-6
"""m; smaller lengths of shapes are errors"""

# element -> attribute -> how many numbers (None: one or three)
_NUMBERS: dict[str, dict[str, int | None]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "mesh": {"scale": None},
    **{name: dict(primitive.attributes) for name, primitive in PRIMITIVES.items()},
}
_USED_ELEMENTS = {"link": ("visual", "collision"), "joint": ("origin", "parent", "child", "axis", "limit", "mimic")}


class CheckedRobot(NamedTuple):
    """The validated part of a ``<robot>`` element: links and joints only."""

    root: Element
    primitives: dict[tuple[str, str, int], PrimitiveShape]
    """By (link, "visual" or "collision", index): `root` has a sphere in place of each, as the library reads not all of them."""
    not_shown: list[str]  # problems of skipped visuals
    resolver: MeshResolver


def checked_robot(path: AnyPath, root: Any) -> CheckedRobot:
    """Validate the elements of a URDF.

    Raises ModelError (file, element, what is wrong) and MeshError (mesh names that cannot be resolved).
    """
    _check_bounds(path, root)
    if root.tag != "robot":
        what = other_model(str(root.tag))
        raise ModelError(
            f"{path}: the outermost element is <{quoted(str(root.tag))}>, expected <robot>{': it ' + what if what else ''}"
        )
    if remnant := xacro_remnant(root):
        raise ModelError(f"{path}: {xacro_advice(path, remnant)}")
    if root.get("name") is None:
        raise ModelError(f"{path}: <robot> has no name")
    count = len(root.findall("link"))
    if count == 0 and (root.find("group") is not None or root.find("disable_collisions") is not None):
        raise ModelError(f"{path}: is an SRDF, which has no links: name the URDF it belongs to")
    if not 1 <= count <= MAX_LINKS:
        raise ModelError(f"{path}: has {count or 'no'} links, expected 1 to {MAX_LINKS}")
    checked = CheckedRobot(Element("robot", {"name": root.get("name")}), {}, [], MeshResolver(path.parent))
    for kind in ("link", "joint"):
        seen: set[str] = set()
        for position, element in enumerate(root.findall(kind)):
            name = element.get("name")
            if not name or not name.isprintable() or name != name.strip():
                raise ModelError(f"{path}: {kind} number {position + 1} has no usable name ({quoted(str(name))})")
            if name in seen:
                raise ModelError(f"{path}: two {kind}s are named {name!r}")
            seen.add(name)
            target = SubElement(checked.root, kind, dict(element.attrib))
            if kind == "joint":
                _check_joint(path, name, element)
                target.extend(part for part in element if part.tag in _USED_ELEMENTS["joint"])
            else:
                _copy_shapes(path, name, element, target, checked)
    return checked


def _check_bounds(path: AnyPath, root: Any) -> None:
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise ModelError(f"{path}: elements are nested deeper than {MAX_DEPTH} levels, expected a URDF")
        if any(len(value) > MAX_ATTRIBUTE_LENGTH for element in level for value in element.attrib.values()):
            raise ModelError(f"{path}: an attribute is longer than {MAX_ATTRIBUTE_LENGTH} characters, expected a URDF")
        level = [child for element in level for child in element]


def _check_joint(path: AnyPath, name: str, element: Any) -> None:
    kind = element.get("type")
    if kind not in (*JOINT_TYPES, *FREE_TYPES):
        raise ModelError(
            f"{path}: joint {name!r} has the type {quoted(str(kind))}, only {', '.join(JOINT_TYPES)} are supported, "
            f"and {' or '.join(FREE_TYPES)} above the root link"
        )
    for end in ("parent", "child"):
        found = element.find(end)
        if found is None or not found.get("link"):
            raise ModelError(f"{path}: joint {name!r} has no <{end} link=...>")
    mimic = element.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        raise ModelError(f"{path}: joint {name!r} has a <mimic> without the joint it follows")
    _check_numbers(path, f"joint {name!r}", element)


def _copy_shapes(path: AnyPath, name: str, element: Any, target: Element, checked: CheckedRobot) -> None:
    """Copy the valid visuals and all collisions of a link to `target`."""
    for kind in _USED_ELEMENTS["link"]:
        number = 0
        for entry in element.findall(kind):
            try:
                primitive = _check_shape(path, name, kind, entry, checked.resolver)
            except InputError as fault:
                if kind == "collision":
                    raise
                checked.not_shown.append(str(fault))
                continue
            shape = entry.find("geometry")[0]
            copy = SubElement(target, kind)
            if (origin := entry.find("origin")) is not None:
                copy.append(origin)
            tag, attributes = shape.tag, dict(shape.attrib)
            if primitive is not None:
                checked.primitives[name, kind, number] = primitive
                tag, attributes = "sphere", {"radius": "1"}
            SubElement(SubElement(copy, "geometry"), tag, attributes)
            number += 1


def _check_shape(path: AnyPath, name: str, kind: str, entry: Any, resolver: MeshResolver) -> PrimitiveShape | None:
    """Validate a visual or collision element: one known shape with valid numbers. Returns it if it is a primitive."""
    where = f"{path}: link {name!r}"
    geometry = entry.find("geometry")
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in SHAPES:
        found = ", ".join(quoted(str(s.tag)) for s in shapes) or "nothing"
        raise ModelError(f"{where} has a <{kind}> of {found}, expected one of {', '.join(SHAPES)}")
    shape = shapes[0]
    if shape.tag == "mesh" and not shape.get("filename"):
        raise ModelError(f"{where} has a <mesh> without a filename")
    _check_numbers(path, f"link {name!r}", entry)
    if shape.tag == "mesh":
        if 0.0 in _floats(shape.get("scale", "1")):
            raise ModelError(f"{where}: a mesh has a scale of 0")
        try:
            resolver.find(shape.get("filename"))
        except MeshError as error:
            raise MeshError(f"{where}: {error}") from None
        return None
    lengths = tuple(n for key in PRIMITIVES[shape.tag].attributes for n in _floats(shape.get(key)))
    primitive = primitive_shape(shape.tag, lengths)
    if min(primitive.lengths) < MIN_LENGTH:
        raise ModelError(f"{where}: a {shape.tag} of {list(primitive.lengths)} m, expected at least {MIN_LENGTH:g}")
    return primitive


def _check_numbers(path: AnyPath, where: str, element: Any) -> None:
    for entry in element.iter():
        for key in PRIMITIVES[entry.tag].attributes if entry.tag in PRIMITIVES else ():
            if entry.get(key) is None:
                raise ModelError(f"{path}: {where}: <{entry.tag}> has no {key}")
        for key, count in _NUMBERS.get(entry.tag, {}).items():
            text = entry.get(key)
            if text is None:
                continue
            found = f"{path}: {where}: <{entry.tag} {key}={quoted(text)}>"
            try:
                numbers = _floats(text)
            except ValueError:
                raise ModelError(f"{found}, expected numbers") from None
            if len(numbers) not in ((1, 3) if count is None else (count,)):
                raise ModelError(f"{found}, expected {count or '1 or 3'} numbers")
            if any(math.isnan(n) or (abs(n) > MAX_VALUE and entry.tag != "limit") for n in numbers):
                raise ModelError(f"{found}, expected finite numbers of at most {MAX_VALUE:g}")


def _floats(text: str) -> list[float]:
    return [float(word) for word in text.replace(",", " ").split()]


def quoted(text: str) -> str:
    """Text from a file for an error message: quoted, printable, at most 60 characters."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return repr(plain if len(plain) <= 60 else plain[:57] + "...")
