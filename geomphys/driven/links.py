"""Link data of the objective: weight, centre and second moments of the surface, and levers of joints.

A link is weighted by the area of its collision surface, and represented by six points with the surface's second moments. As
the objective is quadratic in them, only their mean and covariance are stored. A rotation of the base link of chains takes all
links of the chains along: its second moments are a share of those of all that it carries.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.query import outline
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.numerics.transforms import compose, matrix_from_frame
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, DRIVEN, HULL, JOINT_FIXED, JOINT_PRISMATIC, SPHERE, Scene
from geomphys.scene.tessellation import triangulate_faces
from geomphys.scene.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHORTEST_LEVER = 0.02  # m


class Links(NamedTuple):
    """Constant data of the links of driven trees; zero for other bodies."""

    weight: Floats  # (B,) 1 on average over links with geometry
    centre: Floats  # (B, 3) m, mean of the surface, link frame
    second_moment: Floats  # (B, 9) m², of the surface about the centre, link frame, row by row
    pivot: Ints  # (T,) the link about whose centre the root rotates: the base of the chains, else the heaviest
    lever: Floats  # (Q,) m per rad: how far a joint moves the farthest centre beyond it; 1 for prismatic joints
    mean_lever: Floats  # (Q,) m per rad: of the revolute joints of a tree, root mean square; 1 for prismatic joints
    is_unknown: Ints  # (Q,) 1 for joints that are unknowns of the problem
    periodic: Ints  # (Q,) 1 for joints with period 2π
    tip: Ints  # (B,) 1 for links without a moving child at the end of a chain of moving joints
    palm: Ints  # (B,) of a tip: the first link above it that carries other tips too, else the root
    weld_body: Ints  # (B,) the link that a body is fixed to: itself, if it has a moving joint or is a root


def _triangles(points: Floats) -> tuple[float, Floats, Floats]:
    """Area, first and second moments about the origin of triangles (n, 3, 3)."""
    area = 0.5 * np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1)
    mean = points.mean(axis=1)
    first = area @ mean
    corners = np.einsum("n,nki,nkj->ij", area, points, points)
    second = (corners + 9.0 * np.einsum("n,ni,nj->ij", area, mean, mean)) / 12.0
    return float(area.sum()), first, second


def _surface(scene: Scene, i: int) -> tuple[float, Floats, Floats]:
    """Area [m²], first and second moments of the surface of piece i in its own frame."""
    pieces = scene.pieces
    kind, (r, h, _) = int(pieces.kind[i]), pieces.size[i]
    if kind in (BOX, HULL):
        corners = pieces.vertices[pieces.vertex_start[i] : pieces.vertex_start[i + 1]]
        loop_start = pieces.loop_start[pieces.face_start[i] : pieces.face_start[i + 1] + 1]
        vertices, faces = triangulate_faces(corners, pieces.loops, loop_start)
        return _triangles(vertices[faces])
    if kind not in (SPHERE, CAPSULE, CYLINDER):
        from scipy.spatial import ConvexHull

        points = outline(pieces, i)
        return _triangles(points[ConvexHull(points).simplices])
    side = 4.0 * np.pi * r * h if kind != SPHERE else 0.0
    caps = 4.0 * np.pi * r * r if kind in (SPHERE, CAPSULE) else 2.0 * np.pi * r * r
    across, along = side * r * r / 2.0, side * h * h / 3.0
    if kind == SPHERE:
        across, along = caps * r * r / 3.0, caps * r * r / 3.0
    elif kind == CAPSULE:
        across, along = across + caps * r * r / 3.0, along + caps * (h * h + h * r + r * r / 3.0)
    else:
        across, along = across + caps * r * r / 4.0, along + caps * h * h
    return side + caps, np.zeros(3), np.diag([across, across, along])


def _link_surface(scene: Scene, body: int) -> tuple[float, Floats, Floats]:
    """Area, mean and covariance of the surfaces of a body's pieces, body frame."""
    area, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for i in range(scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]):
        a, m, s = _surface(scene, i)
        rotation, translation = scene.pieces.local[i, :9].reshape(3, 3), scene.pieces.local[i, 9:]
        m = rotation @ m
        second += (
            rotation @ s @ rotation.T
            + np.outer(m, translation)
            + np.outer(translation, m)
            + a * np.outer(translation, translation)
        )
        first += m + a * translation
        area += a
    if area == 0.0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mean = first / area
    return area, mean, second / area - np.outer(mean, mean)


def _pivot(scene: Scene, tree: int, weight: Floats) -> int:
    """The link that is the base of most chains; without chains the heaviest one fixed to the root."""
    first, last = int(scene.trees.body_start[tree]), int(scene.trees.body_start[tree + 1])
    if scene.trees.chains[tree] == 1:
        children = np.zeros(last - first, np.int64)
        for chain in np.flatnonzero(scene.chains.tree == tree):
            base = int(scene.bodies.parent[scene.chains.bodies[scene.chains.body_start[chain]]])
            children[base - first] += 1
        if children.any():
            return first + int(np.argmax(children))
    stays = [first]
    for body in range(first + 1, last):
        if scene.bodies.parent[body] in stays and scene.bodies.joint[body] == JOINT_FIXED:
            stays.append(body)
    return max(stays, key=lambda body: (weight[body], -body))


def _zero_poses(scene: Scene) -> Floats:
    """root_from_body (B, 4, 4) with all joints at zero."""
    poses = np.tile(np.eye(4), (len(scene.bodies.parent), 1, 1))
    origins = matrix_from_frame(scene.bodies.origin)
    for body, parent in enumerate(scene.bodies.parent):
        if parent >= 0:
            poses[body] = compose(poses[parent][None], origins[body][None])[0]
    return poses


def _supported_moments(
    scene: Scene, poses: Floats, base: int, area: Floats, centre: Floats, second_moment: Floats
) -> Floats:
    """(9,) m², second moments of a base link and all that it carries, at `poses` (B, 4, 4), about its centre, in its frame."""
    supported, total, moments = {base}, 0.0, np.zeros((3, 3))
    for body in range(base, len(scene.bodies.parent)):
        if body != base and int(scene.bodies.parent[body]) not in supported:
            continue
        supported.add(body)
        rotation = poses[base, :3, :3].T @ poses[body, :3, :3]
        arm = poses[base, :3, :3].T @ (poses[body, :3, 3] - poses[base, :3, 3]) + rotation @ centre[body] - centre[base]
        moments += area[body] * (rotation @ second_moment[body].reshape(3, 3) @ rotation.T + np.outer(arm, arm))
        total += area[body]
    supported_moments: Floats = moments.reshape(9) / total if total > 0.0 else np.zeros(9)
    return supported_moments


def make_links(scene: Scene, weights: Weights = WEIGHTS) -> Links:
    """Measure the links of a scene's driven trees; `weights` has those of the base link of chains."""
    bodies, dofs = len(scene.bodies.role), len(scene.dofs.lower)
    weight, centre, second_moment = np.zeros(bodies), np.zeros((bodies, 3)), np.zeros((bodies, 9))
    for body in np.flatnonzero(scene.bodies.role == DRIVEN):
        weight[body], centre[body], covariance = _link_surface(scene, int(body))
        second_moment[body] = covariance.reshape(9)
    if (weight > 0.0).any():
        weight /= weight[weight > 0.0].mean()
    pivot, poses = scene.trees.body_start[:-1].copy(), _zero_poses(scene)
    for tree in np.flatnonzero(scene.trees.role == DRIVEN):
        pivot[tree] = _pivot(scene, int(tree), weight)
    for tree in np.flatnonzero((scene.trees.chains == 1) & (scene.trees.role == DRIVEN)):
        if (scene.chains.tree == tree).any():
            base = int(pivot[tree])
            second_moment[base] = weights.supported * _supported_moments(
                scene, poses, base, weight, centre, second_moment
            )
            weight[base] *= weights.base
    lever, is_unknown = np.full(dofs, SHORTEST_LEVER), np.zeros(dofs, np.int64)
    tip = np.zeros(bodies, np.int64)
    for body in np.flatnonzero(scene.bodies.role == DRIVEN):
        at = poses[body, :3, :3] @ centre[body] + poses[body, :3, 3]
        joint = int(body)
        while joint >= 0:
            q = scene.bodies.dof[joint]
            if q >= 0 and scene.bodies.joint[joint] != JOINT_FIXED and scene.bodies.multiplier[joint] != 0.0:
                is_unknown[q] = 1
                if scene.bodies.joint[joint] == JOINT_PRISMATIC:
                    lever[q] = 1.0
                elif weight[body] > 0.0:
                    far = float(np.linalg.norm(at - poses[joint, :3, 3])) * abs(scene.bodies.multiplier[joint])
                    lever[q] = max(lever[q], far + 0.01)
            joint = int(scene.bodies.parent[joint])
    mean_lever = _average_levers(scene, lever, is_unknown)
    _find_tips(scene, tip)
    weld_body = np.arange(bodies, dtype=np.int64)
    for k in range(bodies):
        if scene.bodies.parent[k] >= 0 and scene.bodies.joint[k] == JOINT_FIXED:
            weld_body[k] = weld_body[scene.bodies.parent[k]]
    palm, periodic = _find_palms(scene, tip), _full_rotations(scene)
    return Links(weight, centre, second_moment, pivot, lever, mean_lever, is_unknown, periodic, tip, palm, weld_body)


@lru_cache(maxsize=1)
def links_of(world: World, weights: Weights) -> Links:
    """`make_links` of a world's scene: measured once for all replays of a batch."""
    return make_links(world.scene, weights)


def _average_levers(scene: Scene, lever: Floats, is_unknown: Ints) -> Floats:
    """(Q,) of a revolute joint the root mean square of the levers of those of its tree; 1 for prismatic joints."""
    mean, is_prismatic = np.ones(len(lever)), np.zeros(len(lever), np.bool_)
    is_prismatic[scene.bodies.dof[scene.bodies.joint == JOINT_PRISMATIC]] = True
    for tree in range(len(scene.trees.role)):
        revolute = (scene.dofs.tree == tree) & ~is_prismatic
        counted = revolute & (is_unknown == 1)
        if counted.any():
            mean[revolute] = np.sqrt(np.mean(lever[counted] ** 2))
    return mean


def _full_rotations(scene: Scene) -> Ints:
    """(Q,) 1 for degrees of freedom of a single revolute joint, with multiplier 1."""
    periodic, moved = np.zeros(len(scene.dofs.lower), np.int64), np.zeros(len(scene.dofs.lower), np.int64)
    for body in range(len(scene.bodies.parent)):
        q = scene.bodies.dof[body]
        if q < 0 or scene.bodies.joint[body] == JOINT_FIXED:
            continue
        moved[q] += 1
        periodic[q] = int(
            scene.bodies.joint[body] != JOINT_PRISMATIC and scene.bodies.multiplier[body] == 1.0 and moved[q] == 1
        )
    return periodic


def _find_palms(scene: Scene, tip: Ints) -> Ints:
    """(B,) of each tip the first link above it that carries other tips too, or the root; of other links themselves."""
    supported, palm, parent = tip.copy(), np.arange(len(tip), dtype=np.int64), scene.bodies.parent
    for body in range(len(tip) - 1, -1, -1):
        if parent[body] >= 0:
            supported[parent[body]] += supported[body]
    for end in np.flatnonzero(tip):
        while parent[palm[end]] >= 0 and (palm[end] == end or supported[palm[end]] < 2):
            palm[end] = parent[palm[end]]
    return palm


def _find_tips(scene: Scene, tip: Ints) -> None:
    """Mark links with a moving joint above them and none below."""
    moves = np.zeros(len(tip), np.int64)
    for body in range(len(tip) - 1, -1, -1):
        parent = scene.bodies.parent[body]
        rotates = scene.bodies.joint[body] != JOINT_FIXED and scene.bodies.dof[body] >= 0
        if scene.bodies.role[body] == DRIVEN and rotates and moves[body] == 0:
            tip[body] = 1
        if parent >= 0 and (rotates or moves[body] == 1):
            moves[parent] = 1
