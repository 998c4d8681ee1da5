"""URDF texts for viewers: of the avatars, of articulated objects, and of the plain objects of the scene.

Viewers place a URDF's links by the frame ids of ``/tf``. So links are named here as their frames are (that differs
from the file where there are several avatars, and for objects), and meshes are referred to by absolute ``file://``
addresses, the only ones that the rerun viewer opens. The URDFs as they are stand in the output's attachments.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from defusedxml import ElementTree as SafeTree
from defusedxml.common import DefusedXmlException
from lxml import etree

from geomphys.errors import ModelError
from geomphys.sinks.colours import Colour, of_trees
from geomphys.world.scene import World
from geomphys.world.scene_file import ObjectTable
from geomphys.world.urdf_file import mesh_file

WORLD = "world"


def descriptions(world: World) -> dict[str, str]:
    """Topic -> URDF text: ``/robot_description`` of the only avatar, ``/NAME/robot_description`` of all others.

    Objects without a URDF of their own stand together in ``/objects/robot_description``. Raises ModelError or
    MeshError if a URDF cannot be read.
    """
    texts: dict[str, str] = {}
    palette = of_trees(world.file)
    for tree, name in enumerate(world.tree_names):
        if name in world.urdfs:
            topic = "/robot_description" if tree == 0 and world.avatar_count == 1 else f"/{name}/robot_description"
            texts[topic] = urdf_for_viewers(world.urdfs[name], _frames_of(world, tree), palette[name])
    plain = [table for table in world.file.object if table.name not in world.urdfs]
    if plain:
        name = "objects"
        while name in world.tree_names:
            name += "_"
        texts[f"/{name}/robot_description"] = urdf_of_objects(name, plain, world.path.absolute().parent, palette)
    return texts


def urdf_for_viewers(path: Path, frames: dict[str, str], colour: Colour) -> str:
    """Text of the URDF at `path` with links named as in `frames` (link name -> frame id) and meshes by ``file://``.

    What has no colour of its own gets `colour`. Raises ModelError, and MeshError for a mesh of another
    machine.
    """
    try:
        data = path.read_bytes()
        SafeTree.fromstring(data)  # refuses what an XML file can do to its reader
        tree = etree.fromstring(data)
    except (OSError, SafeTree.ParseError, DefusedXmlException, etree.XMLSyntaxError) as problem:
        raise ModelError(f"{path}: cannot be read as a URDF ({problem})") from problem
    for link in tree.iter("link"):
        _rename(link, "name", frames)
    for joint in tree.iter("joint"):
        for end in ("parent", "child"):
            for element in joint.findall(end):
                _rename(element, "link", frames)
    for mesh in tree.iter("mesh"):
        mesh.set("filename", mesh_file(mesh.get("filename", ""), path.absolute().parent).resolve().as_uri())
    for visual in tree.iter("visual"):
        if visual.find("material") is None:
            visual.append(_material(colour))
    text: str = etree.tostring(tree, encoding="unicode")
    return text + "\n"


def urdf_of_objects(name: str, tables: Sequence[ObjectTable], folder: Path, palette: dict[str, Colour]) -> str:
    """URDF in which every object is a link of its name that floats in the link ``world``; `folder` is the scene's."""
    robot = etree.Element("robot", name=name)
    etree.SubElement(robot, "link", name=WORLD)
    for table in tables:
        link = etree.SubElement(robot, "link", name=table.name)
        for geometry, height in _geometries(table, folder):
            visual = etree.SubElement(link, "visual")
            if height:
                etree.SubElement(visual, "origin", xyz=f"0 0 {height!r}", rpy="0 0 0")
            etree.SubElement(visual, "geometry").append(geometry)
            visual.append(_material(palette[table.name]))
        joint = etree.SubElement(robot, "joint", name=f"{WORLD} {table.name}", type="floating")
        etree.SubElement(joint, "parent", link=WORLD)
        etree.SubElement(joint, "child", link=table.name)
    text: str = etree.tostring(robot, encoding="unicode", pretty_print=True)
    return text


def _geometries(table: ObjectTable, folder: Path) -> list[tuple[etree._Element, float]]:
    """Elements and the height each is moved up by; a capsule is a cylinder and two spheres."""
    if table.mesh is not None:
        scale = f"{table.scale!r} {table.scale!r} {table.scale!r}"
        address = (folder / table.mesh).resolve().as_uri()
        return [(etree.Element("mesh", filename=address, scale=scale), 0.0)]
    if table.box is not None:
        return [(etree.Element("box", size=" ".join(map(repr, table.box))), 0.0)]
    if table.sphere is not None:
        return [(etree.Element("sphere", radius=repr(table.sphere)), 0.0)]
    radius, length = table.cylinder or table.capsule or (0.0, 0.0)
    body = (etree.Element("cylinder", radius=repr(radius), length=repr(length)), 0.0)
    if table.cylinder is not None:
        return [body]
    return [body, *((etree.Element("sphere", radius=repr(radius)), side * length / 2) for side in (1.0, -1.0))]


def _material(colour: Colour) -> etree._Element:
    red, green, blue, opacity = (channel / 255 for channel in colour)
    material = etree.Element("material", name="colour {} {} {}".format(*colour))
    etree.SubElement(material, "color", rgba=f"{red:.3f} {green:.3f} {blue:.3f} {opacity:.3f}")
    return material


def _frames_of(world: World, tree: int) -> dict[str, str]:
    """Link name -> frame id of a tree's bodies."""
    name = world.tree_names[tree]
    start, end = world.scene.trees.body_start[tree : tree + 2]
    bodies = range(int(start), int(end))
    return {world.body_names[b].removeprefix(f"{name}/"): world.frame_names[b] for b in bodies}


def _rename(element: etree._Element, attribute: str, names: dict[str, str]) -> None:
    name = element.get(attribute)
    if name is not None:
        element.set(attribute, names.get(name, name))
