"""What a glTF file claims, before a parser believes it: vertices that no buffer holds, a mesh placed a million times."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Literal

from geomphys.scene.source_files import note_contents

MOST_NODES = 100_000
_SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def gltf_claims(data: bytes, suffix: str, most: int) -> str:
    """Say what is wrong with a ``gltf`` or ``glb`` file whose meshes may have `most` corners in all; "" if nothing is.

    Raises ValueError, KeyError, TypeError, IndexError or struct.error where it is no such file at all.
    """
    tree = json.loads(_json_of(data) if suffix == "glb" else data)
    accessors, views = tree.get("accessors", []), tree.get("bufferViews", [])
    for number, accessor in enumerate(accessors):
        view = accessor.get("bufferView")
        if view is None:
            if int(accessor["count"]) > most:
                return f"accessor {number} has {accessor['count']} entries and no buffer"
            continue
        size = _SIZES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
        if int(accessor["count"]) * size > int(views[view]["byteLength"]):
            return f"accessor {number} reaches beyond its buffer"
        if int(views[view]["byteLength"]) > int(tree["buffers"][views[view]["buffer"]]["byteLength"]):
            return f"buffer view {view} reaches beyond its buffer"
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    if len(nodes) > MOST_NODES:
        return f"has {len(nodes)} nodes, at most {MOST_NODES} are read"
    children = [child for node in nodes for child in node.get("children", [])]
    if len(set(children)) != len(children):
        return "a node is a child twice"
    corners = [sum(_corners(p, accessors) for p in mesh.get("primitives", [])) for mesh in meshes]
    total = sum(corners[node["mesh"]] for node in nodes if "mesh" in node)
    return f"has {total} corners of triangles, at most {most} are read: simplify it" if total > most else ""


def _json_of(data: bytes) -> bytes:
    """The JSON of a binary glTF, its first chunk."""
    length, kind = struct.unpack_from("<II", data, 12)
    if kind != 0x4E4F534A or 20 + length > len(data):
        raise ValueError("no JSON in a binary glTF")
    return data[20 : 20 + length]


def _corners(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    """Corners of triangles of a primitive."""
    place = primitive.get("indices", primitive.get("attributes", {}).get("POSITION"))
    return 0 if place is None else int(accessors[place]["count"])


class Neighbours:
    """Gives a parser the buffers (.bin) that lie beside a .gltf file, up to `largest` bytes, and nothing else."""

    def __init__(self, folder: Path, largest: int) -> None:
        self.folder = folder.resolve()
        self.largest = largest

    def get(self, name: str) -> bytes:
        """The bytes of a buffer; FileNotFoundError for anything else, ValueError for one that is too large."""
        path = (self.folder / name).resolve()
        if path.suffix != ".bin" or not path.is_relative_to(self.folder) or not path.is_file():
            raise FileNotFoundError(name)
        if path.stat().st_size > self.largest:
            raise ValueError(name)
        return note_contents(path, path.read_bytes())

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def namespaced(self, namespace: Literal[""] | str) -> Neighbours:
        """The resolver of a sub-folder; stays where it is."""
        return self
