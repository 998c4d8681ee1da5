"""Files that are named as a URDF and are none: what they are instead, and what to do."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer

EXPRESSION = re.compile(r"\$[({]")
"""How an expression begins that only xacro fills in."""
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
"""Elements from which nothing is needed, so that an expression left in them does no harm."""


def other_format(data: bytes) -> str:
    """What a file is whose first bytes tell that it is no XML of a URDF; "" where they do not."""
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
    """What a model file is by the name of its outermost element; "" where that is not known."""
    return _OTHER_MODELS.get(tag.rpartition("}")[2], "")


def xacro_advice(path: Path, evidence: str) -> str:
    """What to say of a xacro file; `evidence` tells by what it was recognised."""
    name = path.name.removesuffix(".xacro")
    expanded = f"{name.removesuffix('.urdf')}.urdf"
    target = expanded if expanded != path.name else f"{path.stem}_expanded.urdf"
    return f"is a xacro file ({evidence}), not a URDF: run `xacro {path.name} > {target}` and name {target}"


def xacro_remnant(root: Any) -> str:
    """An element or expression of xacro in what is read of a robot's tree, as it stands there; "" without."""
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
