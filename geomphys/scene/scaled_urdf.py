"""Scales the links of a URDF: the text with other bone lengths, as it is replayed and attached to outputs."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from xml.etree.ElementTree import Element, tostring

from geomphys.errors import MeshError, ModelError
from geomphys.scene.primitives import PRIMITIVES
from geomphys.scene.ros_packages import MeshResolver
from geomphys.storage.remote_files import AnyPath


def scaled_urdf(path: AnyPath, factors: Mapping[str, float], *, beside: bool = False) -> bytes:
    """Text of a URDF in which a link with a factor is that much larger: its geometry, and where the joints on it are.

    Meshes are named by their ``file://`` URLs, as the text goes to another folder; `beside` the URDF they keep their names.
    Raises ModelError for a file that cannot be read.
    """
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import ParseError, fromstring

    try:
        root: Element = fromstring(path.read_bytes(), forbid_dtd=True)
    except (OSError, ParseError, DefusedXmlException) as problem:
        raise ModelError(f"{path}: cannot be read as a URDF ({problem})") from problem
    resolver = MeshResolver(path.absolute().parent)
    for link in root.findall("link"):
        factor = factors.get(link.get("name", ""), 1.0)
        for mesh in link.iter("mesh"):
            if not beside:
                with suppress(MeshError):  # a visual's: no collision mesh is without its file here
                    mesh.set("filename", resolver.find(mesh.get("filename", "")).resolve().as_uri())
            if factor != 1.0:
                mesh.set("scale", _scaled(mesh.get("scale", "1 1 1"), factor))
        for part in link.iter() if factor != 1.0 else ():
            if part.tag == "origin" and "xyz" in part.attrib:
                part.set("xyz", _scaled(part.get("xyz", ""), factor))
            for name in PRIMITIVES[part.tag].attributes if part.tag in PRIMITIVES else ():
                if name in part.attrib:
                    part.set(name, _scaled(part.get(name, ""), factor))
    for joint in root.findall("joint"):
        parent, origin = joint.find("parent"), joint.find("origin")
        factor = factors.get("" if parent is None else parent.get("link", ""), 1.0)
        if factor != 1.0 and origin is not None and "xyz" in origin.attrib:
            origin.set("xyz", _scaled(origin.get("xyz", ""), factor))
    text: bytes = tostring(root)
    return text


def _scaled(numbers: str, factor: float) -> str:
    return " ".join(repr(float(value) * factor) for value in numbers.split())
