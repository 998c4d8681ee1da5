"""Rebuilds the world of an output from the files attached to it: scene, URDFs and meshes."""

from __future__ import annotations

import errno
import json
import tomllib
from pathlib import Path
from tempfile import gettempdir
from typing import Any
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException, ElementTree

from geomphys.errors import InputError, LogError, SceneError
from geomphys.load import load_world
from geomphys.output.attached_files import INDEX, write_attachments
from geomphys.output.output_log import OutputLog
from geomphys.scene.assembly import assemble, exclude_pairs
from geomphys.scene.scene_file import SceneFile, parse_scene
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath
from geomphys.storage.temporary_folders import TemporaryFolder

_NOT_WRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)


def world_of_output(output: OutputLog, scene: AnyPath | None = None) -> World:
    """Load the world of an output: its names, surfaces and display meshes.

    Without `scene` everything comes out of the output, and no other file is read. Meshes are then not decomposed: the
    convex pieces of a mesh are its hull.

    Raises
    ------
    SceneError
        The output has no scene attached, or it cannot be rebuilt. With `scene`: that file is wrong.
    ModelError, MeshError
        A URDF or a mesh cannot be read; pass `scene` then.
    """
    mode = {"auto": "auto", "rigid": "rigid", "chains": "chains"}.get(output.metadata.get("mode", ""))
    number = output.metadata.get("seed", "0")
    if not (number.isdecimal() and len(number) < 20):
        raise LogError(f"{output.path}: its metadata has no valid seed; replay the log again")
    if scene is not None:
        return load_world(scene, mode=mode, seed=int(number))
    files = output.attachments()
    names = [name for name in files if name.endswith(".toml")]
    if len(names) != 1:
        raise SceneError(f"{output.path}: has no scene file attached; name it with --scene")
    try:
        with TemporaryFolder() as folder:
            return _attached(folder, names[0], files, mode)
    except (DefusedXmlException, LookupError, ParseError, TypeError, ValueError, OSError) as problem:
        if isinstance(problem, OSError) and problem.errno in _NOT_WRITABLE:
            reason = f"its meshes cannot be written to {gettempdir()} ({problem.strerror})"
            raise SceneError(f"{output.path}: {reason}; set TMPDIR to another folder") from problem
        raise SceneError(
            f"{output.path}: its scene cannot be rebuilt from its attachments ({type(problem).__name__}); "
            "replay the log again, or name the scene with --scene"
        ) from problem
    except InputError as problem:
        problem.add_note(f"this is the scene attached to {output.path}; name one whose files exist with --scene")
        raise


def _attached(folder: Path, name: str, files: dict[str, bytes], mode: str | None) -> World:
    """The world of the attached files, which are written to `folder`."""
    path = folder / name
    text = files[name].decode()
    parse_scene(text, path)
    table = tomllib.loads(text)
    content = json.loads(files[INDEX])
    meshes = content["meshes"]
    written = write_attachments(files, folder)
    for entry in [*table.get("object", []), *table.get("avatar", [])]:
        if "urdf" in entry:
            urdf = folder / f"{entry['name']}.urdf"
            urdf.write_bytes(_with_meshes(files[urdf.name], meshes[entry["name"]], written, folder))
            entry["urdf"] = str(urdf)
        elif "mesh" in entry:
            entry["mesh"] = str(written[meshes[entry["name"]]])
    file: Any = SceneFile.model_validate(table)
    world = assemble(file, path, mode=mode, surfaces_only=True)
    index = {body: number for number, body in enumerate(world.body_names)}
    return exclude_pairs(world, [(index[a], index[b]) for a, b in content["zero_pose_overlaps"]])


def _with_meshes(urdf: bytes, attached: dict[str, str], written: dict[str, Path], folder: Path) -> bytes:
    """A URDF whose meshes are the attached ones. No other files are used."""
    root = ElementTree.fromstring(urdf)
    for mesh in root.iter("mesh"):
        path = written.get(attached.get(mesh.get("filename", ""), ""), folder / "not_attached")
        mesh.set("filename", str(path))
    return ElementTree.tostring(root)  # type: ignore[no-any-return]
