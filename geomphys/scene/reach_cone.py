"""Reach cones (Wilhelms and Van Gelder 2001): spherical polygons that bound the limb direction of a compound joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import SceneError
from geomphys.scene.scene_file import ReachConeTable
from geomphys.scene.skeleton import Skeleton
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

CENTRE_TOLERANCE = 1e-3
"""m; largest distance between the axes of a compound joint."""


@dataclass(frozen=True, eq=False)
class ReachCone:
    """A validated reach cone; joints are given by their child links, root first."""

    links: tuple[int, ...]
    limb: Floats  # (3,) unit, last joint's frame at zero angles
    directions: (
        Floats  # (n, 3) unit, vertices in the frame of the first joint's origin, counter-clockwise seen from outside
    )


def reach_cone(table: ReachConeTable, skeleton: Skeleton, where: str, path: AnyPath) -> ReachCone:
    """Validate a reach cone against its skeleton.

    The joints must be revolute or continuous and no mimic joints, each the descendant of the one before it with only
    fixed joints in between, and their axes must intersect in one centre. The polygon's sides must not cross or touch
    each other, nor be half circles. Its inside is the smaller part of the sphere, for either orientation.

    Raises SceneError that names the file, the cone and the joint or direction.
    """
    by_name = {j.name: link for link, j in enumerate(skeleton.joints) if j is not None}
    links = []
    for name in table.joints:
        if name not in by_name:
            raise SceneError(f"{path}: {where}: no joint {name!r} in {skeleton.path}")
        joint = skeleton.joints[by_name[name]]
        if joint is None or joint.type not in ("revolute", "continuous") or joint.mimics is not None:
            raise SceneError(
                f"{path}: {where}: joint {name!r} is no independent revolute joint, which a reach cone needs"
            )
        links.append(by_name[name])
    _check_compound_joint(links, skeleton, where, path)
    limb = _unit(np.array([table.limb], dtype=np.float64))[0]
    directions = _unit(np.array(table.directions, dtype=np.float64))
    _check_polygon(directions, where, path)
    if area_left_of(directions) > 2.0 * np.pi:
        directions = np.ascontiguousarray(directions[::-1])
    return ReachCone(tuple(links), limb, directions)


def _check_compound_joint(links: Sequence[int], skeleton: Skeleton, where: str, path: AnyPath) -> None:
    """Raise SceneError unless each joint is below the one before it and all rotate about one centre."""
    zero_pose = skeleton.forward()
    centre = zero_pose[links[0], :3, 3]
    for above, link in pairwise(links):
        joint = skeleton.joints[link]
        name = "" if joint is None else joint.name
        ancestor = link
        while ancestor != above:
            entry = skeleton.joints[ancestor]
            if entry is None or (ancestor != link and entry.dof >= 0):
                raise SceneError(f"{path}: {where}: joint {name!r} is not below the joint before it in the list")
            ancestor = entry.parent
        distance = float(np.linalg.norm(zero_pose[link, :3, 3] - centre))
        if distance > CENTRE_TOLERANCE:
            raise SceneError(
                f"{path}: {where}: joint {name!r} sits {distance:.4g} m off the first one, expected one centre"
            )


def _check_polygon(directions: Floats, where: str, path: AnyPath) -> None:
    """Raise SceneError if adjacent vertices coincide or are opposite, or if sides that are not adjacent intersect."""
    count = len(directions)
    following = np.roll(directions, -1, axis=0)
    for k in range(count):
        distance = np.linalg.norm(directions[k] - following[k])
        if distance < 1e-6 or distance > 2.0 - 1e-9:
            problem = "equals" if distance < 1e-6 else "is opposite to"
            raise SceneError(f"{path}: {where}: directions[{k}] {problem} the next one, they span no side of a polygon")
    for i in range(count):
        for j in range(i + 2, count - (i == 0)):
            if _arcs_intersect(directions[i], following[i], directions[j], following[j]):
                raise SceneError(f"{path}: {where}: the sides after directions[{i}] and directions[{j}] cross")


def area_left_of(directions: Floats) -> float:
    """Area [sr] to the left of the polygon's sides: angle sum minus that of a planar polygon (Girard)."""
    previous, following = np.roll(directions, 1, axis=0), np.roll(directions, -1, axis=0)
    to_next = np.cross(directions, following)
    to_previous = np.cross(directions, previous)
    angles = np.arctan2(
        np.einsum("ij,ij->i", np.cross(to_next, to_previous), directions), np.einsum("ij,ij->i", to_next, to_previous)
    )
    return float(np.sum(angles % (2.0 * np.pi)) - (len(directions) - 2) * np.pi)


def _arcs_intersect(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Whether two great-circle arcs, each shorter than a half circle, share a point."""
    first, second = np.cross(a, b), np.cross(c, d)
    point = np.cross(first, second)
    if np.linalg.norm(point) < 1e-12:  # on one circle: an end of one lies on the other
        return any(_on_arc(p, c, d) for p in (a, b)) or any(_on_arc(p, a, b) for p in (c, d))
    return any(_on_arc(p, a, b) and _on_arc(p, c, d) for p in (point, -point))


def _on_arc(point: Floats, a: Floats, b: Floats) -> bool:
    """Whether a point of the arc's circle lies between its ends."""
    normal = np.cross(a, b)
    if abs(float(normal @ point)) > 1e-9 * float(np.linalg.norm(normal) * np.linalg.norm(point)):
        return False
    tolerance = -1e-12 * float(np.linalg.norm(point))
    return bool(np.cross(a, point) @ normal >= tolerance and np.cross(point, b) @ normal >= tolerance)


def _unit(vectors: Floats) -> Floats:
    lengths: Floats = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths == 1.0, vectors, vectors / lengths)
