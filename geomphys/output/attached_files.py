"""Files of a scene that are attached to its outputs: the scene file, the URDFs and all meshes that can be read.

A mesh is attached as ``meshes/DIGEST/NAME``, with the buffers of a glTF file beside it; DIGEST is made from the bytes, so the
same mesh is attached once and no path of this machine gets into the file. The attachment `INDEX` maps the names in
the scene file and the URDFs to attachments. A URDF that was scaled to points has absolute names of meshes: those become the
names of the attachments.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import unquote

from geomphys.errors import MeshError, OutputError
from geomphys.scene.gltf_file import BufferResolver
from geomphys.scene.meshes import MAX_FILE_BYTES, SUFFIXES
from geomphys.scene.ros_packages import MeshResolver
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath

INDEX = "attachments.json"
"""Attachment: ``meshes`` (object -> attachment of its mesh; tree with a URDF -> name of a mesh in it -> attachment) and
``zero_pose_overlaps`` (pairs of body names)."""

_MEDIA_TYPES = {
    "stl": "model/stl", "obj": "model/obj", "dae": "model/vnd.collada+xml", "glb": "model/gltf-binary", "gltf": "model/gltf+json",
}  # fmt: skip
_BINARY = "application/octet-stream"


class Attachment(NamedTuple):
    """A file inside an output."""

    name: str
    media_type: str
    data: bytes


@lru_cache(maxsize=1)
def scene_files(world: World) -> tuple[Attachment, ...]:
    """Read the scene file, the URDFs and the meshes of a world. Raises OutputError if one cannot be read.

    A visual's mesh that is missing or of an unsupported format is omitted: it is not shown either.
    """
    meshes: dict[str, str | dict[str, str]] = {}
    found: dict[AnyPath, tuple[Attachment, ...]] = {}

    def attach(path: AnyPath) -> str:
        if path not in found:
            found[path] = _mesh_files(path)
        return found[path][0].name

    try:
        texts = [Attachment(world.path.name, "application/toml", world.path.read_bytes())]
        for table in world.facts.objects:
            if table.mesh is not None:
                meshes[table.name] = attach((world.path.parent / table.mesh).resolve())
        for tree, urdf in sorted(world.urdfs.items()):
            data, attached = urdf.read_bytes(), {name: attach(path) for name, path in _meshes_of_urdf(urdf)}
            if tree in world.keypoint_scale:
                data, attached = _renamed_meshes(data, attached), {name: name for name in attached.values()}
            texts.append(Attachment(f"{tree}.urdf", "application/xml", data))
            meshes[tree] = attached
    except OSError as problem:
        raise OutputError(f"{problem.filename}: cannot be attached to the output ({problem.strerror})") from problem
    index = {"meshes": meshes, "zero_pose_overlaps": world.zero_pose_overlaps}
    texts.append(Attachment(INDEX, "application/json", json.dumps(index, sort_keys=True, indent=1).encode()))
    files_of_meshes = {file.name: file for group in found.values() for file in group}
    return (*texts, *(files_of_meshes[name] for name in sorted(files_of_meshes)))


def write_attachments(files: dict[str, bytes], folder: Path) -> dict[str, Path]:
    """Write attached meshes below a folder; returns where each is.

    A name that leads out of it is skipped; geomphys never writes one.
    """
    written = {}
    for name, data in files.items():
        parts = PurePosixPath(name).parts
        if len(parts) > 2 and parts[0] == "meshes" and ".." not in parts and "\0" not in name:
            path = written[name] = folder.joinpath(*parts)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    return written


def _meshes_of_urdf(urdf: AnyPath) -> Iterator[tuple[str, AnyPath]]:
    """Name and file of the meshes in a URDF that exist in a supported format."""
    from defusedxml import ElementTree

    resolver = MeshResolver(urdf.absolute().parent)
    for mesh in ElementTree.fromstring(urdf.read_bytes()).iter("mesh"):
        name = mesh.get("filename", "")
        try:
            path = resolver.find(name).resolve()
        except MeshError:
            continue
        if path.suffix[1:].lower() in SUFFIXES and path.is_file() and path.stat().st_size <= MAX_FILE_BYTES:
            yield name, path


def _renamed_meshes(urdf: bytes, attached: dict[str, str]) -> bytes:
    """A URDF whose meshes have the names of their attachments, or the last part of their own where there is none."""
    from xml.etree.ElementTree import tostring

    from defusedxml import ElementTree

    root = ElementTree.fromstring(urdf)
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        mesh.set("filename", attached.get(name, PurePosixPath(name).name))
    text: bytes = tostring(root)
    return text


def _mesh_files(path: AnyPath) -> tuple[Attachment, ...]:
    """A mesh file and, of glTF, its buffers."""
    suffix, data = path.suffix[1:].lower(), path.read_bytes()
    buffers = [] if suffix != "gltf" else list(_buffers(path, data))
    digest = hashlib.sha256(data + b"".join(buffer for _, buffer in buffers)).hexdigest()[:16]
    main = Attachment(f"meshes/{digest}/{path.name}", _MEDIA_TYPES.get(suffix, _BINARY), data)
    return (main, *(Attachment(f"meshes/{digest}/{name}", _BINARY, buffer) for name, buffer in buffers))


def _buffers(path: AnyPath, data: bytes) -> Iterator[tuple[str, bytes]]:
    """Name and bytes of the buffers that a glTF file keeps beside it; those that cannot be read are left out."""
    resolver = BufferResolver(path.parent, MAX_FILE_BYTES)
    for name in dict.fromkeys(_buffer_names(data)):
        try:
            yield name, resolver.get(name)
        except (FileNotFoundError, ValueError):
            continue


def _buffer_names(data: bytes) -> Sequence[str]:
    try:
        tree: Any = json.loads(data)
        names = [buffer.get("uri", "") for buffer in tree.get("buffers", [])]
    except (ValueError, AttributeError, TypeError):
        return []  # a visual that is no glTF file, and not shown
    return [unquote(name) for name in names if isinstance(name, str) and name and not name.startswith("data:")]
