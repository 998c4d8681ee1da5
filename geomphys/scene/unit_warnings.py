"""Warnings about bodies whose size suggests a wrong unit or scale."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.arrays import FIXED
from geomphys.scene.scene_file import ObjectTable
from geomphys.scene.tessellation import Triangles
from geomphys.scene.trees import Tree, TreeBody

Floats = NDArray[np.float64]

MAX_PLAUSIBLE = 5.0
"""m; longer bodies are probably in millimetres"""
MIN_PLAUSIBLE = 5e-4
"""m; shorter bodies have probably been scaled twice"""


def unit_warnings(trees: Sequence[Tree]) -> Iterator[str]:
    """One warning for each object or model with a body longer than `MAX_PLAUSIBLE` or shorter than `MIN_PLAUSIBLE`.

    Fixed primitives may be long (a floor, a wall): they are judged by their shortest side.
    """
    for tree in trees:
        sizes = [_size(body) for body in tree.bodies]
        for is_large in (True, False):
            suspicious = [
                (size, body)
                for size, body in zip(sizes, tree.bodies, strict=True)
                if (size > MAX_PLAUSIBLE if is_large else 0.0 < size < MIN_PLAUSIBLE)
            ]
            if isinstance(tree.table, ObjectTable) and tree.skeleton is None:
                yield from (
                    _object_warning(tree.table, size, is_large)
                    for size, body in suspicious
                    if _counts(tree, body, is_large)
                )
            elif suspicious:
                yield _model_warning(tree, suspicious, is_large)


def _counts(tree: Tree, body: TreeBody, is_large: bool) -> bool:
    table = tree.table
    assert isinstance(table, ObjectTable)
    if is_large and table.scale == 1.0 and "scale" in table.model_fields_set:
        return False  # the scene file says that the mesh is in metres
    if table.mesh is not None or tree.role != FIXED or not is_large:
        return True
    return float(_sides(body.geometry.triangles).min()) > MAX_PLAUSIBLE


def _object_warning(table: ObjectTable, size: float, is_large: bool) -> str:
    prefix = f"object {table.name!r} is {_length(size)} long; lengths are in metres"
    if table.mesh is None:
        return (
            f"{prefix}: if its {table.shape} is in millimetres, divide it by 1000"
            if is_large
            else f"{prefix}: check it"
        )
    if is_large:
        otherwise = ", and if in metres scale = 1" if table.scale == 1.0 else ""
        return f"{prefix}: if {table.mesh} is in millimetres, say scale = {1e-3 * table.scale:g}{otherwise}"
    scale_text = f"scale = {table.scale:g} is applied" if table.scale != 1.0 else "no scale is applied"
    return f"{prefix}: check scale ({scale_text} to {table.mesh})"


def _model_warning(tree: Tree, suspicious: list[tuple[float, TreeBody]], is_large: bool) -> str:
    assert tree.skeleton is not None
    size, body = max(suspicious, key=lambda o: o[0]) if is_large else min(suspicious, key=lambda o: o[0])
    count_text = "a link is" if len(suspicious) == 1 else f"{len(suspicious)} links are"
    limit = f"more than {_length(MAX_PLAUSIBLE)}" if is_large else f"less than {_length(MIN_PLAUSIBLE)}"
    link = body.name.partition("/")[2]
    prefix = f"{tree.skeleton.path}: {count_text} {limit} long, {link!r} {_length(size)}; lengths are in metres"
    if is_large:
        return (
            f'{prefix}: if its meshes are in millimetres, say scale="0.001 0.001 0.001" in each <mesh> (scale = 0.001)'
        )
    return f"{prefix}: check the scale of its meshes, which may be applied twice"


def _size(body: TreeBody) -> float:
    """Longest side of the bounding boxes of collision and display geometry, m."""
    return max(float(_sides(triangles).max()) for triangles in (body.geometry.triangles, body.visual))


def _sides(triangles: Triangles) -> Floats:
    vertices, _ = triangles
    sides: Floats = np.ptp(vertices, axis=0) if len(vertices) else np.zeros(3)
    return sides


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 0.01 else f"{1e3 * metres:.3g} mm"
