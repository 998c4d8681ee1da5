"""Distances of points on the links of an avatar from a surface: what a calibration makes zero.

A link is sampled by points with a radius: corners of boxes and hulls, the centres of spheres and of the caps of capsules, rims of
cylinders. The surface is taken as the plane at the point of it that is nearest to the link.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.penetration import Scratch, make_scratch, separation
from geomphys.collision.query import outline
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import pack
from geomphys.numerics.row_vectors import set_vec
from geomphys.numerics.transforms import apply, matrix_from_frame, matrix_from_pose
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Scene
from geomphys.scene.kinematics import joint_origins, pose_pieces_of_tree, pose_tree
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FAR = 10.0
"""m; gaps are measured up to this."""
BEYOND_NEAREST = 0.05
"""m; links that are farther than this beyond the nearest one need not be measured."""
RIM_POINTS = 24


LINK_GAP = np.dtype(
    [
        ("gap", np.float64),  # m
        ("normal", np.float64, 3),  # out of the surface
        ("point", np.float64, 3),  # m, of the surface
    ]
)
"""Gap of a link from a surface, and the plane of the surface where it is nearest to the link, world frame."""


class GapWorkspace(NamedTuple):
    """Arrays of `measure_planes`."""

    origins: Floats  # (B, 7) joint origins
    poses: Floats  # (B, 7)
    frames: Floats  # (P, 12)
    gaps: NDArray[Any]  # (B,) LINK_GAP


@kernel
def measure_planes(
    scene: Scene, space: GapWorkspace, scratch: Scratch, tree: int, surface: int, roots: Floats, angles: Floats
) -> None:
    """Gap of each link of a tree from the bodies of another, negative inside, into `space.gaps`; `FAR` if it is far.

    `roots` (T, 7) and `angles` (Q,) are world poses of roots and joint values.
    """
    for t in (tree, surface):
        pose_tree(scene, space.origins, t, roots, angles, space.poses)
        pose_pieces_of_tree(scene, t, space.poses, space.frames)
    starts, pieces, limit = scene.trees.body_start, scene.bodies.piece_start, FAR
    for body in range(starts[tree], starts[tree + 1]):
        found = space.gaps[body]
        found.gap = FAR
        for i in range(pieces[body], pieces[body + 1]):
            for j in range(pieces[starts[surface]], pieces[starts[surface + 1]]):
                gap, n, _, pb = separation(scene.pieces, space.frames, i, j, limit, (0.0, 0.0, 0.0), scratch)
                if gap < min(found.gap, limit):
                    found.gap = gap
                    set_vec(found.normal, n)
                    set_vec(found.point, pb)
                    limit = min(limit, gap + BEYOND_NEAREST)


class GapMeter:
    """Measures gaps in a world, and samples the surfaces of its bodies."""

    def __init__(self, world: World) -> None:
        scene = world.scene
        self.space = GapWorkspace(
            origins=joint_origins(scene),
            poses=np.zeros((len(scene.bodies.parent), 7)),
            frames=np.zeros((len(scene.pieces.kind), 12)),
            gaps=np.zeros(len(scene.bodies.parent), LINK_GAP),
        )
        self._scene, self._space, self._scratch = pack(scene), pack(self.space), pack(make_scratch())
        self._starts = scene.trees.body_start
        self._bodies, self._centres, self._radii = _sample(scene)

    def _sampled(self, tree: int) -> slice:
        """Rows of the points of a tree."""
        first, last = np.searchsorted(self._bodies, self._starts[tree : tree + 2])
        return slice(int(first), int(last))

    def bodies_of(self, tree: int) -> Ints:
        """(P,) body of each sampled point, counted from the tree's first."""
        bodies: Ints = self._bodies[self._sampled(tree)] - self._starts[tree]
        return bodies

    def radii_of(self, tree: int) -> Floats:
        """(P,) m, radius about each sampled point."""
        return self._radii[self._sampled(tree)]

    def pose(self, tree: int, roots: Floats, angles: Floats) -> tuple[Floats, Floats]:
        """Sampled points (P, 3) m and poses (B, 7) of the bodies of a tree, world frame, for the poses of a frame."""
        pose_tree(self._scene, self.space.origins, tree, roots, angles, self.space.poses)
        rows = self._sampled(tree)
        poses = matrix_from_pose(self.space.poses[self._bodies[rows]])
        centres = np.einsum("nij,nj->ni", poses[:, :3, :3], self._centres[rows]) + poses[:, :3, 3]
        return centres, self.space.poses[slice(*self._starts[tree : tree + 2])].copy()

    def nearest_plane(
        self, tree: int, surface: int, roots: Floats, angles: Floats, link: int = -1
    ) -> tuple[Floats, Floats]:
        """Normal (3,) out of a surface and its point (3,) m that is nearest to a tree, or to one of its links, world frame."""
        measure_planes(self._scene, self._space, self._scratch, tree, surface, roots, angles)
        gaps = self.space.gaps[slice(*self._starts[tree : tree + 2])]
        nearest = gaps[link if link >= 0 and gaps["gap"][link] < FAR else int(gaps["gap"].argmin())]
        return nearest["normal"].copy(), nearest["point"].copy()

    def lowest_gap(self, tree: int, surface: int, roots: Floats, angles: Floats) -> float:
        """Gap [m] of a tree from a surface, negative inside, for the poses of a frame."""
        measure_planes(self._scene, self._space, self._scratch, tree, surface, roots, angles)
        return float(self.space.gaps["gap"][slice(*self._starts[tree : tree + 2])].min())


def _sample(scene: Scene) -> tuple[Ints, Floats, Floats]:
    """Body (n,), centre (n, 3) in its frame and radius (n,) of the sampled points of all pieces."""
    pieces = scene.pieces
    bodies, centres, radii = [], [], []
    for i, kind in enumerate(pieces.kind):
        radius, half = pieces.size[i, 0], pieces.size[i, 1]
        if kind == SPHERE:
            points, r = np.zeros((1, 3)), radius
        elif kind == CAPSULE:
            points, r = np.array([[0, 0, -half], [0, 0, half]]), radius
        elif kind == CYLINDER:
            angle = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
            rim = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(RIM_POINTS, half)])
            points, r = np.concatenate([rim, rim * [1, 1, -1]]), 0.0
        elif kind not in (BOX, HULL):
            points, r = outline(pieces, i), 0.0
        else:
            points, r = pieces.vertices[slice(*pieces.vertex_start[i : i + 2])], 0.0
        centres.append(apply(matrix_from_frame(pieces.local[i]), points))
        bodies.append(np.full(len(points), pieces.body[i]))
        radii.append(np.full(len(points), r))
    if not bodies:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0)
    return np.concatenate(bodies), np.concatenate(centres), np.concatenate(radii)
