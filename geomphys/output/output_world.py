"""Rebuilds the world of an output from the scene file and URDFs attached to it."""

from __future__ import annotations

import tomllib
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException, ElementTree

from geomphys.errors import InputError, LogError, SceneError
from geomphys.load import load_world, zero_pose_overlaps
from geomphys.output.output_log import OutputLog
from geomphys.output.provenance import sha256_of_world
from geomphys.scene.arrays import World
from geomphys.scene.assembly import assemble, exclude_pairs
from geomphys.scene.free_joints import joint_ends, links_above_free_joint
from geomphys.scene.scene_file import SceneFile, parse_scene
from geomphys.storage.remote_files import AnyPath
from geomphys.storage.temporary_folders import TemporaryFolder


def world_of_output(output: OutputLog, scene: AnyPath | None = None) -> World:
    """Load the world of an output.

    Without `scene`, the scene file and the URDFs are those attached to the output, and meshes are read from the paths
    in the output's robot descriptions.

    Raises
    ------
    SceneError
        The output has no scene attached, or its hash differs from that of the replay because a mesh or a URDF has
        changed. With `scene`: that file is wrong.
    ModelError, MeshError
        A URDF or a mesh cannot be read, for example because it was moved; pass `scene` then.
    """
    mode = {"auto": "auto", "rigid": "rigid", "chains": "chains"}.get(output.metadata.get("mode", ""))
    number = output.metadata.get("seed", "0")
    if not (number.isdecimal() and len(number) < 20):
        raise LogError(f"{output.path}: its metadata has no valid seed; replay the log again")
    seed = int(number)
    if scene is not None:
        return load_world(scene, mode=mode, seed=seed)
    files = output.attachments()
    names = [name for name in files if name.endswith(".toml")]
    if len(names) != 1:
        raise SceneError(f"{output.path}: has no scene file attached; name it with --scene")
    try:
        with TemporaryFolder() as folder:
            world = _attached(output, folder, names[0], files, mode, seed)
    except (DefusedXmlException, LookupError, ParseError, TypeError, ValueError) as problem:
        raise SceneError(
            f"{output.path}: its scene cannot be rebuilt from its attachments ({type(problem).__name__}); "
            "name the scene with --scene"
        ) from problem
    except InputError as problem:
        problem.add_note(f"this is the scene attached to {output.path}; name one whose files exist with --scene")
        raise
    if sha256_of_world(world) != output.metadata.get("world_sha256"):
        raise SceneError(
            f"{output.path}: a mesh or URDF of its scene has changed since the replay; name the scene with --scene"
        )
    return world


def _attached(
    output: OutputLog, folder: AnyPath, name: str, files: dict[str, bytes], mode: str | None, seed: int
) -> World:
    """The world of the attached files, their paths made absolute."""
    path = folder / name
    text = files[name].decode()
    parse_scene(text, path)
    table = tomllib.loads(text)
    texts = output.descriptions()
    meshes = _meshes_of_objects(texts)
    for entry in [*table.get("object", []), *table.get("avatar", [])]:
        if "urdf" in entry:
            urdf = folder / f"{entry['name']}.urdf"
            urdf.write_bytes(_with_meshes(files[urdf.name], _description(texts, entry["name"])))
            entry["urdf"] = str(urdf)
        elif "mesh" in entry:
            entry["mesh"] = meshes.get(entry["name"], entry["mesh"])
    file: Any = SceneFile.model_validate(table)
    world = assemble(file, path, mode=mode, seed=seed)
    return exclude_pairs(world, zero_pose_overlaps(world))


def _meshes_of_objects(texts: dict[str, str]) -> dict[str, str]:
    """Object -> mesh file, of the objects without a URDF."""
    found: dict[str, str] = {}
    for text in texts.values():
        for link in ElementTree.fromstring(text).iter("link"):
            for mesh in link.iter("mesh"):
                found.setdefault(link.get("name", ""), _path(mesh.get("filename", "")))
    return found


def _description(texts: dict[str, str], tree: str) -> str:
    """The description of a tree, which is the only avatar's if it has none of its own."""
    return texts.get(f"/{tree}/robot_description") or texts["/robot_description"]


def _with_meshes(urdf: bytes, description: str) -> bytes:
    """A URDF whose meshes are named as in the description made from it: the same elements in the same order."""
    root = ElementTree.fromstring(urdf)
    above = links_above_free_joint(joint_ends(root))  # which the description leaves out
    named = [m for part in root if not (part.tag == "link" and part.get("name") in above) for m in part.iter("mesh")]
    for mesh, described in zip(named, ElementTree.fromstring(description).iter("mesh"), strict=True):
        mesh.set("filename", _path(described.get("filename", "")))
    return ElementTree.tostring(root)  # type: ignore[no-any-return]


def _path(address: str) -> str:
    """The path of a ``file://`` address; anything else as it is."""
    return unquote(address.removeprefix("file://")) if address.startswith("file://") else address
