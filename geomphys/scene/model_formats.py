"""Recognises files that are no URDF (xacro, SDF, MJCF, USD, …), for errors that say what to do."""

from __future__ import annotations

import re
from typing import Any

from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer
from geomphys.storage.remote_files import AnyPath

EXPRESSION = re.compile(r"\$[({]")
"""Start of a xacro expression."""
XACRO_USE = re.compile(rb"<\s*/?\s*xacro:")

_OTHER_MODELS = {
    "sdf": "is an SDF model: name the URDF it was made from, or convert it to one",
    "gazebo": "is an SDF model: name the URDF it was made from, or convert it to one",
    "mujoco": "is a MuJoCo model (MJCF): name the URDF of the same robot, or convert it to one",
    "mujocoinclude": "is a part of a MuJoCo model (MJCF): name the URDF of the same robot, or convert it to one",
    "COLLADA": "is a COLLADA mesh: name the URDF that uses it",
    "html": "is a web page: download the file itself",
}
_IGNORED_ELEMENTS = {
    "gazebo",
    "transmission",
    "ros2_control",
    "material",
    "visual",
    "sensor",
    "plugin",
    "mujoco",
    "drake",
}
"""Elements that are not used, in which unexpanded expressions are allowed."""


def other_format(data: bytes) -> str:
    """Format of a file that is recognisably no URDF by its first bytes, as error text; "" otherwise."""
    if not data.strip():
        return "is empty: fetch or export it again"
    if is_lfs_pointer(data):
        return IS_POINTER
    if data.startswith((b"PXR-USDC", b"#usda")):
        return "is a USD file: name the URDF it was made from, or export one"
    if data.startswith(b"PK\x03\x04"):
        return "is a packed file (ZIP or USDZ): unpack it and name the URDF in it"
    if data.startswith(b"\x89MCAP"):
        return "is an MCAP log, expected a URDF"
    if data[:200].lstrip()[:14].lower().startswith((b"<!doctype html", b"<html")):
        return _OTHER_MODELS["html"]
    return ""


def other_model(tag: str) -> str:
    """Format of a model file by the tag of its root element, as error text; "" if unknown."""
    return _OTHER_MODELS.get(tag.rpartition("}")[2], "")


def xacro_advice(path: AnyPath, evidence: str) -> str:
    """Error text for a xacro file; `evidence` says how it was recognised."""
    name = path.name.removesuffix(".xacro")
    expanded = f"{name.removesuffix('.urdf')}.urdf"
    target = expanded if expanded != path.name else f"{path.stem}_expanded.urdf"
    return f"is a xacro file ({evidence}), not a URDF: run `xacro {path.name} > {target}` and name {target}"


def xacro_remnant(root: Any) -> str:
    """First unexpanded xacro element or expression in the used part of a ``<robot>`` element; "" if none."""
    stack = [root]
    while stack:
        element = stack.pop()
        tag = str(element.tag)
        if "xacro" in tag:
            return f"it has <xacro:{tag.rpartition('}')[2]}>"
        if tag in _IGNORED_ELEMENTS:
            continue
        for key, value in element.attrib.items():
            if EXPRESSION.search(value):
                shortened = "".join(c if c.isprintable() else " " for c in value)
                return f"it has {key}={(shortened if len(shortened) <= 60 else shortened[:57] + '...')!r}"
        stack += reversed(list(element))
    return ""
