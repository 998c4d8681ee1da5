"""Checks mesh files before they are parsed: format, announced size, truncation."""

from __future__ import annotations

import re
import struct

from geomphys.scene.git_lfs import IS_POINTER, is_lfs_pointer

STL_HEADER_BYTES = 84
"""bytes before the triangles of a binary STL; the last four are their count"""
STL_TRIANGLE_BYTES = 50
"""bytes of a triangle in a binary STL"""
MAX_MATERIALS = 500
"""materials of an OBJ that are parsed"""

_FACET = re.compile(rb"\bfacet\s+normal\b", re.IGNORECASE)
_END_FACET = re.compile(rb"\bendfacet\b", re.IGNORECASE)
_END_SOLID = re.compile(rb"\bendsolid\b", re.IGNORECASE)
_PLY_FACES = re.compile(rb"^element\s+face\s+(\d+)", re.MULTILINE)
_OFF_FACES = re.compile(rb"\s*[A-Z0-9]*OFF\s+\d+\s+(\d+)")
_COMMENT = re.compile(rb"#[^\n]*")
_OBJ_MATERIAL = re.compile(rb"^[ \t]*usemtl\b[^\n]*", re.MULTILINE)
_HTML = (b"<!doctype html", b"<html")


def mesh_problem(data: bytes, suffix: str) -> str:
    """Problem of a mesh file that shows without parsing it; "" if none.

    An empty file, a Git LFS pointer, a web page, a truncated STL or GLB.
    """
    if not data:
        return "is empty (0 bytes): fetch or save it again"
    if is_lfs_pointer(data):
        return IS_POINTER
    if data[:200].lstrip()[:14].lower().startswith(_HTML):
        return "is a web page, not a mesh: download the file itself"
    if suffix == "stl":
        return _ascii_stl_fault(data) if is_ascii_stl(data) else _binary_stl_fault(data)
    if suffix == "glb" and len(data) >= 12 and data.startswith(b"glTF"):
        announced = int(struct.unpack_from("<I", data, 8)[0])
        if announced > len(data):
            return f"is cut off: {announced} bytes announced, {len(data)} there: fetch or save it again"
    return ""


def is_ascii_stl(data: bytes) -> bool:
    """Whether an STL is text. Binary files may begin with "solid" too and are recognised by their length."""
    if len(data) >= STL_HEADER_BYTES and len(data) == STL_HEADER_BYTES + STL_TRIANGLE_BYTES * stl_count(data):
        return False
    start = data[:2048].lstrip().lower()
    return start.startswith(b"solid") and (b"facet" in start or b"endsolid" in start)


def stl_count(data: bytes) -> int:
    """Number of triangles in the header of a binary STL."""
    return int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")


def without_trailer(data: bytes) -> bytes:
    """A binary STL without the bytes that some programs append after the last triangle."""
    if is_ascii_stl(data) or len(data) < STL_HEADER_BYTES:
        return data
    return data[: STL_HEADER_BYTES + STL_TRIANGLE_BYTES * stl_count(data)]


def without_many_materials(data: bytes) -> bytes:
    """An OBJ without its materials, which mean nothing to a shape, if they are more than `MAX_MATERIALS`.

    The parser makes a part of each, in a time that grows with the square of their number.
    """
    names = set(_OBJ_MATERIAL.findall(data))
    return _OBJ_MATERIAL.sub(b"", data) if len(names) > MAX_MATERIALS else data


def _binary_stl_fault(data: bytes) -> str:
    if len(data) < STL_HEADER_BYTES:
        return (
            f"is not a readable .stl mesh: it is cut off after {len(data)} bytes, its head alone has {STL_HEADER_BYTES}"
        )
    count, present = stl_count(data), (len(data) - STL_HEADER_BYTES) // STL_TRIANGLE_BYTES
    if count > present:
        return f"is cut off: {count} triangles announced, {present} there: fetch or save it again"
    if count == 0 and present:
        return f"announces no triangles, though the file is long enough for {present}: save it again"
    return ""


def _ascii_stl_fault(data: bytes) -> str:
    started, ended = len(_FACET.findall(data)), len(_END_FACET.findall(data))
    if started > ended:
        return f"is cut off: {started} triangles begun, {ended} there: fetch or save it again"
    if not _END_SOLID.search(data):
        return f"is cut off: no `endsolid` after its {ended} triangles: fetch or save it again"
    return ""


def announced_faces(data: bytes, suffix: str) -> int:
    """Number of faces in the header of a PLY or OFF file; 0 if there is none, and for other formats."""
    found = None
    if suffix == "ply":
        found = _PLY_FACES.search(data[: data.find(b"end_header")])
    elif suffix == "off":
        found = _OFF_FACES.match(_COMMENT.sub(b"", data[:10_000]))
    return int(found.group(1)[:12]) if found else 0
