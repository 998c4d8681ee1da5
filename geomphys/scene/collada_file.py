"""Checks a COLLADA file before it is parsed: no archive, entities or DTD, bounded nodes and triangles; and reads its unit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple
from xml.etree.ElementTree import Element
from zipfile import is_zipfile

import numpy as np

MAX_VISITS = 2_000
"""Nodes and meshes that a scene may have once those that it names again and again are counted each time, or four for each
node in the file."""
MAX_WAITING = 100_000
"""Nodes of the library times nodes that it names before they are defined: the parser tries all again for each."""


class ColladaFile(NamedTuple):
    """What is known of a file before it is parsed."""

    unit: float  # of length, m
    problem: str  # "" if none


class _Size(NamedTuple):
    nodes: int
    triangles: int

    def __add__(self, other: _Size) -> _Size:  # type: ignore[override]
        return _Size(self.nodes + other.nodes, self.triangles + other.triangles)


def check_collada(data: bytes, max_triangles: int) -> ColladaFile:
    """Length unit (``<unit meter=...>`` of the asset; default 1 m), and what is wrong.

    ``<up_axis>`` is ignored, as in RViz: coordinates are taken as they are. Nodes may name nodes, so a short file can hold more
    than any machine. Raises ValueError, LookupError or ParseError for what is no XML, an archive, an entity or a DTD, nodes in
    a circle, or a unit that is none.
    """
    from defusedxml.ElementTree import fromstring

    if is_zipfile(BytesIO(data)):  # the parser would unpack it, whatever stands around it
        raise ValueError("an archive")
    root = fromstring(data, forbid_dtd=True)
    elements = list(root.iter())
    limit = max(MAX_VISITS, 4 * sum(_local(element) == "node" for element in elements))
    size = _size_of_scene(elements)
    problem = ""
    if size.nodes > limit:
        count = f"{_about(size.nodes)} nodes and meshes"
        problem = f"has a scene of {count}, at most {limit} are read: apply the instances when exporting it"
    elif size.triangles > max_triangles:
        problem = f"has up to {_about(size.triangles)} triangles, at most {max_triangles} are read: simplify it"
    elif _waiting(elements) > MAX_WAITING:
        problem = "names too many nodes before they are defined: apply the instances when exporting it"
    return ColladaFile(_unit(root), problem)


def _unit(root: Element) -> float:
    for asset in root:
        for unit in asset if _local(asset) == "asset" else ():
            if _local(unit) == "unit" and unit.get("meter") is not None:
                metres = float(unit.get("meter", "").strip())
                if not (math.isfinite(metres) and 1e-9 <= metres <= 1e6):
                    raise ValueError("unit")
                return metres
    return 1.0


def _waiting(elements: list[Element]) -> int:
    """How often a parser looks at nodes of the library until it knows them all, if each that is named later costs a pass."""
    nodes, named, passes = 0, set[str | None](), 0
    for element in elements:
        if _local(element) == "node":
            nodes += 1
            named.add(element.get("id"))
        elif _local(element) == "instance_node":
            passes += element.get("url", "").removeprefix("#") not in named
    return nodes * passes


def _size_of_scene(elements: list[Element]) -> _Size:
    """Nodes of the largest scene, each as often as it occurs there, and triangles in them, or more."""
    named = {element.get("id"): element for element in elements if _local(element) in ("node", "geometry")}
    sizes: dict[Element, _Size] = {}
    open_nodes: set[Element] = set()
    largest = _Size(0, 0)
    for scene in elements:
        if _local(scene) != "visual_scene":
            continue
        waiting = [scene]
        while waiting:  # a node is left when all that it holds has a size
            node = waiting[-1]
            held = list(_held(node, named))
            missing = [one for one in held if one not in sizes]
            if node in sizes or not missing:
                if node not in sizes:
                    own = _triangles(node) if _local(node) == "geometry" else 0
                    sizes[node] = sum((sizes[one] for one in held), _Size(1, own))
                open_nodes.discard(node)
                waiting.pop()
                continue
            if node in open_nodes:
                raise ValueError("nodes in a circle")
            open_nodes.add(node)
            waiting += missing
        largest = max(largest, sizes[scene])
    return largest


def _held(node: Element, named: dict[str | None, Element]) -> Iterator[Element]:
    """Nodes and geometries in a node, as often as it holds them."""
    for child in node:
        if _local(child) == "node":
            yield child
        elif _local(child) in ("instance_node", "instance_geometry"):
            found = named.get(child.get("url", "").removeprefix("#"))
            if found is not None:
                yield found


def _triangles(geometry: Element) -> int:
    """Triangles of a geometry, or more: polygons have fewer than corners."""
    total = 0
    for primitive in geometry.iter():
        offsets = [int(one.get("offset") or 0) for one in primitive if _local(one) == "input"]
        numbers = sum(_count(one.text or "") for one in primitive if _local(one) == "p")
        corners = numbers // (1 + max(offsets, default=0))
        total += corners // 3 if _local(primitive) == "triangles" else corners
    return total


def _count(text: str) -> int:
    """How many numbers stand in a text, between spaces."""
    filled = np.frombuffer(text.encode(), np.uint8) > ord(" ")
    return int(np.count_nonzero(filled[1:] & ~filled[:-1])) + int(filled[:1].sum())


def _about(number: int) -> str:
    return str(number) if number < 10**9 else "more than a billion"


def _local(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]
