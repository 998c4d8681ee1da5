"""Makes the robot descriptions (URDF texts) of the output: avatars, articulated objects, plain objects.

Viewers pose a URDF's links by the frame ids of ``/tf``. Links are therefore renamed to their frame ids (these differ
from the file with several avatars, and for objects). A mesh would have to be a file on the viewer's machine, so
links that have one are shown by primitives (`primitive_fit.py`): the text is self-contained. The original URDFs and
meshes are attachments of the output, the surfaces are in ``/meshes``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from defusedxml import ElementTree as SafeTree
from defusedxml.common import DefusedXmlException
from lxml import etree

from geomphys.errors import ModelError
from geomphys.numerics.transforms import rotation_about
from geomphys.output.colours import Colour, colours_of_trees
from geomphys.output.primitive_fit import PlacedPrimitive, primitives_of_body, raised
from geomphys.scene.free_joints import joint_ends, links_above_free_joint
from geomphys.scene.primitives import PRIMITIVES, PrimitiveShape, attributes_of
from geomphys.scene.scene_facts import ObjectFacts
from geomphys.scene.urdf_elements import SHAPES
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath

WORLD = "world"


@lru_cache(maxsize=1)
def descriptions(world: World) -> Mapping[str, str]:
    """Topic -> URDF text: ``/robot_description`` of the only avatar, ``/NAME/robot_description`` of all others.

    Objects without a URDF of their own share ``/objects/robot_description``. Raises ModelError or
    MeshError if a URDF cannot be read.
    """
    texts: dict[str, str] = {}
    palette = colours_of_trees(world.facts)
    for tree, name in enumerate(world.tree_names):
        if name in world.urdfs:
            topic = "/robot_description" if tree == 0 and world.avatar_count == 1 else f"/{name}/robot_description"
            texts[topic] = urdf_for_viewers(world.urdfs[name], _links_of(world, tree), palette[name])
    plain = [table for table in world.facts.objects if table.name not in world.urdfs]
    if plain:
        name = "objects"
        while name in world.tree_names:
            name += "_"
        texts[f"/{name}/robot_description"] = urdf_of_objects(name, plain, world, palette)
    return texts


class ShownLink(NamedTuple):
    """How a link is shown."""

    frame: str  # frame id
    primitives: Sequence[PlacedPrimitive]  # in place of meshes


def urdf_for_viewers(path: AnyPath, links: Mapping[str, ShownLink], colour: Colour) -> str:
    """Text of the URDF at `path` with links renamed to their frame ids, and primitives in place of meshes.

    What has no colour of its own gets `colour`. A capsule, which few viewers know, becomes a cylinder and two spheres;
    links above a free joint of the whole model are omitted, and visuals without a shape that can be drawn. Raises
    ModelError.
    """
    try:
        data = path.read_bytes()
        SafeTree.fromstring(data)  # refuses entities and DTDs
        tree = etree.fromstring(data)
    except (OSError, SafeTree.ParseError, DefusedXmlException, etree.XMLSyntaxError) as problem:
        raise ModelError(f"{path}: cannot be read as a URDF ({problem})") from problem
    _drop_above_free_joint(tree)
    for element in list(tree.iter("visual")):
        _make_drawable(element)
    for link in tree.iter("link"):
        _keep_shown_geometry(link)
    for element in list(tree.iter("visual")):  # those that were collision geometry
        _make_drawable(element)
    frames = {name: link.frame for name, link in links.items()}
    for link in tree.iter("link"):
        _replace_meshes(link, links)
        _rename(link, "name", frames)
    for joint in tree.iter("joint"):
        for end in ("parent", "child"):
            for element in joint.findall(end):
                _rename(element, "link", frames)
    for visual in tree.iter("visual"):
        if visual.find("material") is None:
            visual.append(_material(colour))
    text: str = etree.tostring(tree, encoding="unicode")
    return text + "\n"


def _keep_shown_geometry(link: etree._Element) -> None:
    """Leave a link's visuals, or its collision geometry as visuals if there are none: both drawn in one place flicker."""
    collisions = link.findall("collision")
    has_visual = bool(link.findall("visual"))
    for collision in collisions:
        if has_visual:
            link.remove(collision)
        else:
            collision.tag = "visual"


def _replace_meshes(link: etree._Element, links: Mapping[str, ShownLink]) -> None:
    """Write a link's visual meshes as primitives, in the place and with the material of the first of them."""
    meshes = [v for v in link.findall("visual") if v.find("geometry/mesh") is not None]
    shown = links.get(link.get("name", ""))
    if meshes and shown is not None:
        at = link.index(meshes[0])
        for shape in reversed(shown.primitives):
            visual = visual_of(shape)
            visual.extend(deepcopy(material) for material in meshes[0].findall("material"))
            link.insert(at, visual)
    for visual in meshes:
        link.remove(visual)


def visual_of(shape: PlacedPrimitive) -> etree._Element:
    """A visual element of a primitive, without a material; lengths to 1 µm, so that no rounding of a library shows."""
    matrix = shape.body_from_shape
    if abs(matrix[2, 0]) > 1.0 - 1e-9:  # roll and yaw rotate about one axis
        rpy = (0.0, math.copysign(math.pi / 2, -matrix[2, 0]), math.atan2(-matrix[0, 1], matrix[1, 1]))
    else:
        rpy = (math.atan2(matrix[2, 1], matrix[2, 2]), math.asin(-matrix[2, 0]), math.atan2(matrix[1, 0], matrix[0, 0]))
    visual = etree.Element("visual")
    etree.SubElement(visual, "origin", xyz=_text(matrix[:3, 3]), rpy=_text(rpy))
    etree.SubElement(etree.SubElement(visual, "geometry"), shape.tag, attributes_of(shape.tag, shape.sizes, _rounded))
    return visual


def _text(numbers: Iterable[float]) -> str:
    return " ".join(map(_rounded, numbers))


def _rounded(number: float) -> str:
    return f"{round(float(number), 6) + 0.0:.9g}"  # + 0.0: no -0


def _drop_above_free_joint(robot: etree._Element) -> None:
    """Remove the links above a floating or planar joint of the whole model, and the joints there."""
    above = links_above_free_joint(joint_ends(robot))
    for joint in robot.findall("joint") if above else []:
        parent = joint.find("parent")
        if parent is not None and parent.get("link") in above:
            robot.remove(joint)
    for link in robot.findall("link"):
        if link.get("name") in above:
            robot.remove(link)


def _make_drawable(element: etree._Element) -> None:
    """Write a visual in shapes that every viewer knows; remove one without any."""
    parent, geometry = element.getparent(), element.find("geometry")
    if parent is None or parent.tag != "link" or (geometry is not None and geometry.find("mesh") is not None):
        return
    shape = geometry[0] if geometry is not None and len(geometry) == 1 else None
    if shape is None or shape.tag not in SHAPES or not _has_size(shape):
        parent.remove(element)
    elif PRIMITIVES[shape.tag].parts is not None:
        at = parent.index(element)
        for part in reversed(_parts(element, shape)):
            parent.insert(at, part)
        parent.remove(element)


def _parts(element: etree._Element, shape: etree._Element) -> list[etree._Element]:
    """A visual of a primitive as visuals of those that every viewer knows."""
    lengths = tuple(
        n for key, count in PRIMITIVES[shape.tag].attributes.items() for n in _numbers(shape.get(key), count)
    )
    origin = element.find("origin")
    middle, rpy = ([0.0] * 3, [0.0] * 3) if origin is None else (_numbers(origin.get(key)) for key in ("xyz", "rpy"))
    roll, pitch, yaw = (rotation_about(axis, angle) for axis, angle in zip(np.eye(3), rpy, strict=True))
    axis_z = (yaw @ pitch @ roll)[:, 2]
    found = []
    for name, part_lengths, height in PrimitiveShape(shape.tag, lengths).parts:
        position = (np.array(middle) + axis_z * height).tolist() if height else middle
        copy = deepcopy(element)
        for child in copy.findall("origin"):
            copy.remove(child)
        xyz, rpy_text = (" ".join(map(repr, values)) for values in (position, rpy))
        copy.insert(0, etree.Element("origin", xyz=xyz, rpy=rpy_text))
        geometry = copy.find("geometry")
        assert geometry is not None
        geometry[0] = etree.Element(name, attributes_of(name, part_lengths))
        found.append(copy)
    return found


def _has_size(shape: etree._Element) -> bool:
    """Whether the lengths of a primitive can be read, and one is above 0."""
    try:
        lengths = [n for key in ("size", "radius", "length") for n in _numbers(shape.get(key, ""), 0)]
    except ValueError:
        return False
    return max(lengths, default=0.0) > 0.0


def _numbers(text: str | None, count: int = 3) -> list[float]:
    """The numbers of an attribute; `count` zeros where it is not there."""
    return [float(word) for word in (text or "").replace(",", " ").split()] or [0.0] * count


def urdf_of_objects(name: str, tables: Sequence[ObjectFacts], world: World, palette: dict[str, Colour]) -> str:
    """URDF in which every object is a link of its name that floats in the link ``world``."""
    robot = etree.Element("robot", name=name)
    etree.SubElement(robot, "link", name=WORLD)
    for table in tables:
        link = etree.SubElement(robot, "link", name=table.name)
        for shape in _primitives_of_object(table, world):
            visual = visual_of(shape)
            visual.append(_material(palette[table.name]))
            link.append(visual)
        joint = etree.SubElement(robot, "joint", name=f"{WORLD} {table.name}", type="floating")
        etree.SubElement(joint, "parent", link=WORLD)
        etree.SubElement(joint, "child", link=table.name)
    text: str = etree.tostring(robot, encoding="unicode", pretty_print=True)
    return text


def _primitives_of_object(table: ObjectFacts, world: World) -> list[PlacedPrimitive]:
    """An object of the scene file in primitives that every viewer knows."""
    if table.primitive is None:
        return primitives_of_body(world, world.body_names.index(table.name))
    return [PlacedPrimitive(name, lengths, raised(height)) for name, lengths, height in table.primitive.parts]


def _material(colour: Colour) -> etree._Element:
    red, green, blue, opacity = (channel / 255 for channel in colour)
    material = etree.Element("material", name="colour {} {} {}".format(*colour))
    etree.SubElement(material, "color", rgba=f"{red:.3f} {green:.3f} {blue:.3f} {opacity:.3f}")
    return material


def _links_of(world: World, tree: int) -> dict[str, ShownLink]:
    """How the links of a tree are shown, by their names in its URDF."""
    name = world.tree_names[tree]
    start, end = world.scene.trees.body_start[tree : tree + 2]
    return {
        world.body_names[b].removeprefix(f"{name}/"): ShownLink(world.frame_names[b], primitives_of_body(world, b))
        for b in range(int(start), int(end))
    }


def _rename(element: etree._Element, attribute: str, names: dict[str, str]) -> None:
    name = element.get(attribute)
    if name is not None:
        element.set(attribute, names.get(name, name))
