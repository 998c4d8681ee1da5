"""Validates a glTF file before it is parsed: accessors within their buffers, bounded nodes and instances."""

from __future__ import annotations

import json
import struct
from typing import Any, Literal

from geomphys.scene.source_files import track_contents
from geomphys.storage.remote_files import AnyPath, lies_within

MAX_NODES = 100_000
MAX_DEPTH = 32
"""Nodes within nodes: the parser multiplies the matrices of a chain in a time that grows with the cube of its length."""
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENT_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def gltf_problem(data: bytes, suffix: str, max_corners: int) -> str:
    """Problem of a ``gltf`` or ``glb`` file whose meshes may have `max_corners` triangle corners in total; "" if none.

    Raises ValueError, KeyError, TypeError, IndexError or struct.error for what is no glTF at all.
    """
    tree = json.loads(_json_of(data) if suffix == "glb" else data)
    accessors, views = tree.get("accessors", []), tree.get("bufferViews", [])
    for number, accessor in enumerate(accessors):
        view = accessor.get("bufferView")
        if view is None:
            if int(accessor["count"]) > max_corners:
                return f"accessor {number} has {accessor['count']} entries and no buffer"
            continue
        size = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENT_COUNTS[accessor["type"]]
        if int(accessor["count"]) * size > int(views[view]["byteLength"]):
            return f"accessor {number} reaches beyond its buffer"
        if int(views[view]["byteLength"]) > int(tree["buffers"][views[view]["buffer"]]["byteLength"]):
            return f"buffer view {view} reaches beyond its buffer"
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    if len(nodes) > MAX_NODES:
        return f"has {len(nodes)} nodes, at most {MAX_NODES} are read"
    children = [child for node in nodes for child in node.get("children", [])]
    if len(set(children)) != len(children):
        return "a node is a child twice"
    if (depth := _depth(nodes)) > MAX_DEPTH:
        return f"has nodes {depth} deep in one another, at most {MAX_DEPTH} are read: apply the transforms when exporting it"
    corners = [sum(_corners(p, accessors) for p in mesh.get("primitives", [])) for mesh in meshes]
    total = sum(corners[node["mesh"]] for node in nodes if "mesh" in node)
    return (
        f"has {total} corners of triangles, at most {max_corners} are read: simplify it" if total > max_corners else ""
    )


def _depth(nodes: list[dict[str, Any]]) -> int:
    """Longest chain of nodes of which each is a child of one before; those in a circle count as endless."""
    children = {child for node in nodes for child in node.get("children", [])}
    level, depth, reached = [number for number in range(len(nodes)) if number not in children], 0, 0
    while level:
        depth, reached = depth + 1, reached + len(level)
        level = [child for number in level for child in nodes[number].get("children", [])]
    return depth if reached == len(nodes) else len(nodes)


def _json_of(data: bytes) -> bytes:
    """JSON chunk of a binary glTF."""
    length, kind = struct.unpack_from("<II", data, 12)
    if kind != 0x4E4F534A or 20 + length > len(data):
        raise ValueError("no JSON in a binary glTF")
    return data[20 : 20 + length]


def _corners(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    """Number of triangle corners of a primitive."""
    accessor = primitive.get("indices", primitive.get("attributes", {}).get("POSITION"))
    return 0 if accessor is None else int(accessors[accessor]["count"])


class BufferResolver:
    """trimesh resolver that reads ``.bin`` buffers in or below the folder of a .gltf file, up to `max_bytes`, nothing else."""

    def __init__(self, folder: AnyPath, max_bytes: int) -> None:
        self.folder = folder.resolve()
        self.max_bytes = max_bytes

    def get(self, name: str) -> bytes:
        """The bytes of a buffer; FileNotFoundError for anything else, ValueError for one that is too large."""
        path = (self.folder / name).resolve()
        if path.suffix != ".bin" or not lies_within(path, self.folder) or not path.is_file():
            raise FileNotFoundError(name)
        if path.stat().st_size > self.max_bytes:
            raise ValueError(name)
        return track_contents(path, path.read_bytes())

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)

    def namespaced(self, namespace: Literal[""] | str) -> BufferResolver:
        """Resolver of a sub-folder, as trimesh asks for: the same one."""
        return self
