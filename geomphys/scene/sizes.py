"""Bodies so large or so small that their lengths are probably not metres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.arrays import FIXED
from geomphys.scene.scene_file import ObjectTable
from geomphys.scene.tessellation import Triangles
from geomphys.scene.trees import Tree, TreeBody

Floats = NDArray[np.float64]

LARGE = 5.0
"""m; what is longer is probably in millimetres"""
SMALL = 5e-4
"""m; what is shorter has probably been scaled twice"""


def size_warnings(trees: Sequence[Tree]) -> Iterator[str]:
    """A line for each object, and each model, of which something is longer than `LARGE` or shorter than `SMALL`.

    A fixed primitive may be long (a floor, a wall): it counts by its shortest side.
    """
    for tree in trees:
        sizes = [_size(body) for body in tree.bodies]
        for large in (True, False):
            odd = [
                (size, body)
                for size, body in zip(sizes, tree.bodies, strict=True)
                if (size > LARGE if large else 0.0 < size < SMALL)
            ]
            if isinstance(tree.table, ObjectTable) and tree.skeleton is None:
                yield from (_of_object(tree.table, size, large) for size, body in odd if _counts(tree, body, large))
            elif odd:
                yield _of_model(tree, odd, large)


def _counts(tree: Tree, body: TreeBody, large: bool) -> bool:
    table = tree.table
    assert isinstance(table, ObjectTable)
    if table.mesh is not None or tree.role != FIXED or not large:
        return True
    return float(_sides(body.geometry.triangles).min()) > LARGE


def _of_object(table: ObjectTable, size: float, large: bool) -> str:
    long = f"object {table.name!r} is {_length(size)} long; lengths are in metres"
    if table.mesh is None:
        return f"{long}: if its {table.shape} is in millimetres, divide it by 1000" if large else f"{long}: check it"
    if large:
        return f"{long}: if {table.mesh} is in millimetres, say scale = {1e-3 * table.scale:g}"
    again = f"scale = {table.scale:g} is applied" if table.scale != 1.0 else "no scale is applied"
    return f"{long}: check scale ({again} to {table.mesh})"


def _of_model(tree: Tree, odd: list[tuple[float, TreeBody]], large: bool) -> str:
    assert tree.skeleton is not None
    size, body = max(odd, key=lambda o: o[0]) if large else min(odd, key=lambda o: o[0])
    many = "a link is" if len(odd) == 1 else f"{len(odd)} links are"
    limit = f"more than {_length(LARGE)}" if large else f"less than {_length(SMALL)}"
    link = body.name.partition("/")[2]
    what = f"{tree.skeleton.path}: {many} {limit} long, {link!r} {_length(size)}; lengths are in metres"
    if large:
        return f'{what}: if its meshes are in millimetres, say scale="0.001 0.001 0.001" in each <mesh> (scale = 0.001)'
    return f"{what}: check the scale of its meshes, which may be applied twice"


def _size(body: TreeBody) -> float:
    """Longest side of what collides or is shown, m."""
    return max(float(_sides(triangles).max()) for triangles in (body.geometry.triangles, body.shown))


def _sides(triangles: Triangles) -> Floats:
    vertices, _ = triangles
    sides: Floats = np.ptp(vertices, axis=0) if len(vertices) else np.zeros(3)
    return sides


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 0.01 else f"{1e3 * metres:.3g} mm"
