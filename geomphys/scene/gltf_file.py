"""Validates a glTF file before it is parsed: accessors within their buffers, bounded nodes and instances."""

from __future__ import annotations

import json
import struct
from collections import Counter
from typing import Any, Literal

from geomphys.scene.source_files import track_contents
from geomphys.storage.remote_files import AnyPath, lies_within

MAX_NODES = 100_000
MAX_DEPTH = 32
"""Nodes within nodes: the parser multiplies the matrices of a chain in a time that grows with the cube of its length."""
MAX_ATTRIBUTE_BYTES = 2**28
"""Bytes of all attributes of vertices, counted each time that they are used."""
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENT_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def gltf_problem(data: bytes, suffix: str, max_corners: int) -> str:
    """Problem of a ``gltf`` or ``glb`` file whose meshes may have `max_corners` triangle corners in total; "" if none.

    Raises ValueError, KeyError, TypeError, IndexError or struct.error for what is no glTF at all.
    """
    tree = json.loads(_json_of(data) if suffix == "glb" else data)
    accessors, views = tree.get("accessors", []), tree.get("bufferViews", [])
    sizes = [int(a["count"]) * _COMPONENT_BYTES[a["componentType"]] * _COMPONENT_COUNTS[a["type"]] for a in accessors]
    for number, (accessor, size) in enumerate(zip(accessors, sizes, strict=True)):
        view = accessor.get("bufferView")
        if size < 0:
            return f"accessor {number} has {accessor['count']} entries"
        if view is None:
            if size > len(data):
                return f"accessor {number} has {accessor['count']} entries and no buffer"
            continue
        if size > int(views[view]["byteLength"]):
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
    uses = Counter(node["mesh"] for node in nodes if "mesh" in node)
    for what, limit, cost in (
        ("corners of triangles", max_corners, lambda primitive: _corners(primitive, accessors)),
        ("vertices", 2 * max_corners, lambda primitive: _vertices(primitive, accessors)),
        (
            "bytes of vertices",
            MAX_ATTRIBUTE_BYTES,
            lambda primitive: sum(sizes[a] for a in _attributes(primitive).values()),
        ),
    ):
        total = sum(count * sum(map(cost, meshes[mesh].get("primitives", []))) for mesh, count in uses.items())
        if total > limit:
            return f"has {total} {what}, at most {limit} are read: simplify it"
    return ""


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


def _attributes(primitive: dict[str, Any]) -> dict[str, int]:
    """Accessors of a primitive's vertices."""
    found: dict[str, int] = primitive.get("attributes", {})
    return found


def _corners(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    """Number of triangle corners of a primitive."""
    accessor = primitive.get("indices")
    return _vertices(primitive, accessors) if accessor is None else int(accessors[accessor]["count"])


def _vertices(primitive: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    """Number of vertices that a primitive brings with it, used or not: others may share them."""
    accessor = _attributes(primitive).get("POSITION")
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
