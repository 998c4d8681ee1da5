"""What a mesh file says of itself, before a parser believes it: how long it is, of what kind, in which unit."""

from __future__ import annotations

import math
import re
import struct

from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer

HEAD = 84
"""bytes before the triangles of a binary STL; the last four count them"""
METADATA_RECORD = 50
"""bytes of a triangle in a binary STL"""

_FACET = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_END_FACET = re.compile(rb"\bendfacet\b", re.IGNORECASE)
_END_SOLID = re.compile(rb"\bendsolid\b", re.IGNORECASE)
_PLY_FACES = re.compile(rb"^element\s+face\s+(\d+)", re.MULTILINE)
_OFF_FACES = re.compile(rb"\s*[A-Z0-9]*OFF\s+\d+\s+(\d+)")
_COMMENT = re.compile(rb"#[^\n]*")
_PAGE = (b"<!doctype html", b"<html")


def mesh_fault(data: bytes, suffix: str) -> str:
    """What is wrong with the bytes of a mesh file as a whole; "" where nothing is that can be told without parsing it.

    A file without a byte, a Git LFS pointer, a web page in the file's place, an STL or GLB that is cut off.
    """
    if not data:
        return "is empty (0 bytes): fetch or save it again"
    if is_lfs_pointer(data):
        return IS_POINTER
    if data[:200].lstrip()[:14].lower().startswith(_PAGE):
        return "is a web page, not a mesh: download the file itself"
    if suffix == "stl":
        return _ascii_stl_fault(data) if is_ascii_stl(data) else _binary_stl_fault(data)
    if suffix == "glb" and len(data) >= 12 and data.startswith(b"glTF"):
        announced = int(struct.unpack_from("<I", data, 8)[0])
        if announced > len(data):
            return f"is cut off: {announced} bytes announced, {len(data)} there: fetch or save it again"
    return ""


def is_ascii_stl(data: bytes) -> bool:
    """Whether an STL is text. Binary ones may begin with "solid" too; their length gives them away."""
    if len(data) >= HEAD and len(data) == HEAD + METADATA_RECORD * stl_count(data):
        return False
    start = data[:2048].lstrip().lower()
    return start.startswith(b"solid") and (b"facet" in start or b"endsolid" in start)


def stl_count(data: bytes) -> int:
    """Triangles that the head of a binary STL announces."""
    return int.from_bytes(data[HEAD - 4 : HEAD], "little")


def without_trailer(data: bytes) -> bytes:
    """A binary STL without what some programs write behind its last triangle."""
    if is_ascii_stl(data) or len(data) < HEAD:
        return data
    return data[: HEAD + METADATA_RECORD * stl_count(data)]


def _binary_stl_fault(data: bytes) -> str:
    if len(data) < HEAD:
        return f"is not a readable .stl mesh: it is cut off after {len(data)} bytes, its head alone has {HEAD}"
    count, there = stl_count(data), (len(data) - HEAD) // METADATA_RECORD
    if count > there:
        return f"is cut off: {count} triangles announced, {there} there: fetch or save it again"
    if count == 0 and there:
        return f"announces no triangles, though it has room for {there}: save it again"
    return ""


def _ascii_stl_fault(data: bytes) -> str:
    begun, ended = len(_FACET.findall(data)), len(_END_FACET.findall(data))
    if begun > ended:
        return f"is cut off: {begun} triangles begun, {ended} there: fetch or save it again"
    if not _END_SOLID.search(data):
        return f"is cut off: no `endsolid` after its {ended} triangles: fetch or save it again"
    return ""


def announced_faces(data: bytes, suffix: str) -> int:
    """Faces that the head of a PLY or OFF file announces; 0 where it announces none, or the kind has no head."""
    found = None
    if suffix == "ply":
        found = _PLY_FACES.search(data[: data.find(b"end_header")])
    elif suffix == "off":
        found = _OFF_FACES.match(_COMMENT.sub(b"", data[:10_000]))
    return int(found.group(1)[:12]) if found else 0


def collada_unit(data: bytes) -> float:
    """Metres of a unit of a COLLADA file (``<unit meter=...>`` of its asset; 1 where it names none).

    Its ``<up_axis>`` is not looked at, as RViz does not: the coordinates count as they stand. Raises ValueError,
    LookupError or ParseError for what is no XML, an entity or a DTD, or a unit that is none.
    """
    from defusedxml.ElementTree import fromstring

    root = fromstring(data, forbid_dtd=True)
    for asset in root:
        if _local(asset.tag) == "asset":
            for unit in asset:
                if _local(unit.tag) == "unit" and unit.get("meter") is not None:
                    metres = float(unit.get("meter", "").strip())
                    if not (math.isfinite(metres) and 1e-9 <= metres <= 1e6):
                        raise ValueError("unit")
                    return metres
    return 1.0


def _local(tag: object) -> str:
    return str(tag).rpartition("}")[2]
