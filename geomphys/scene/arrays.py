"""Scene data of the kernels: flat arrays that are constant during a replay.

A scene is a list of kinematic *trees*. An avatar is a tree of links with role DRIVEN, an articulated object a tree of
links with role FIXED, any other object a tree of one link. A link is a *body*; a body is a union of convex *pieces*.
Order: avatars first, in the order of the scene file, then objects. The bodies of a tree are contiguous and in
topological order (parents first); the pieces of a body are contiguous.

Lengths are metres, angles radians, masses kilograms. A *pose* row is ``(px, py, pz, qx, qy, qz, qw)``; a *frame* row
is the rotation's nine floats row by row and then the position's three. All arrays are C-contiguous
float64 or int64; the vertex indices of hulls are int32.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

# roles of a body
FIXED = 0
SIMULATED = 1
DRIVEN = 2

# kinds of a piece
SPHERE = 0
CAPSULE = 1
BOX = 2
CYLINDER = 3
HULL = 4

# kinds of a joint
JOINT_FIXED = 0
JOINT_REVOLUTE = 1
JOINT_PRISMATIC = 2


class Pieces(NamedTuple):
    """P convex pieces. Boxes and hulls have vertices, planes and loops, in the piece's own frame."""

    kind: Ints  # (P,) SPHERE … HULL
    # sphere (r, 0, 0); capsule and cylinder (r, half height without caps, 0) along z; half extents of a box, of a hull's box
    size: Floats  # (P, 3)
    body: Ints  # (P,) the body it belongs to
    local: Floats  # (P, 12) body_from_piece as a frame row
    centre: Floats  # (P, 3) interior point, piece frame (the hull's volume centroid; 0 for the others)
    body_centre: Floats  # (P, 3) the same point, body frame
    reach: Floats  # (P,) bounding radius about `centre`
    thickness: Floats  # (P,) smallest width over all directions, m
    vertex_start: Ints  # (P + 1,) rows of `vertices`
    vertices: Floats  # (V, 3)
    neighbour_start: Ints32  # (V + 1,) rows of `neighbours`
    neighbours: Ints32  # (N,) vertices joined by an edge of the hull, as indices local to the piece
    cell_start: Ints  # (P,) first of the piece's CELLS entries of `cells`; -1: it has none
    cells: Ints32  # start vertex of the hill climb to the support point, by the direction's cell; local to the piece
    face_start: Ints  # (P + 1,) rows of `planes` and of `loop_start`
    planes: Floats  # (F, 4) outward unit normal and offset: n·x <= d; coplanar triangles merged
    loop_start: Ints  # (F + 1,) rows of `loops`
    loops: Ints  # (L,) the face's vertices, counter-clockwise seen from outside, as indices local to the piece


class Bodies(NamedTuple):
    """B bodies (links of avatars, links of articulated objects, plain objects)."""

    role: Ints  # (B,) FIXED, SIMULATED, DRIVEN
    tree: Ints  # (B,) the tree it belongs to
    piece_start: Ints  # (B + 1,)
    material: Ints  # (B,) index into `Materials`
    mass: Floats  # (B,) kg, of the geometry (density x volume) or as stated; 0 for a body without geometry
    com: Floats  # (B, 3) centre of mass, body frame
    inertia: Floats  # (B, 3) principal moments about the centre of mass, kg m²
    principal: Floats  # (B, 4) body_from_principal rotation, x y z w
    # joint to the parent body of the same tree (a tree's root has parent -1 and JOINT_FIXED)
    parent: Ints  # (B,)
    joint: Ints  # (B,) JOINT_FIXED, JOINT_REVOLUTE (also continuous), JOINT_PRISMATIC
    origin: Floats  # (B, 12) parent_from_joint as a frame row
    axis: Floats  # (B, 3) unit, joint frame
    dof: Ints  # (B,) column of the angles, -1 for a fixed joint; a mimic joint has its master's
    multiplier: Floats  # (B,) angle = multiplier * dof + offset (1 and 0 but for mimic joints)
    offset: Floats  # (B,)


class Trees(NamedTuple):
    """T trees, avatars first."""

    body_start: Ints  # (T + 1,)
    dof_start: Ints  # (T + 1,) columns of the angles
    role: Ints  # (T,)
    moving: Ints  # (T,) 1 if its pose or a joint comes from the recording or from physics, 0 if it is static
    rest: Floats  # (T, 7) root pose of trees without a topic
    mass: Floats  # (T,) m of the coupling (6)
    stiffness: Floats  # (T,) K; infinite for a rigid coupling
    damping: Floats  # (T,) R
    chains: Ints  # (T,) 1 for an avatar in chains mode
    self_collision: Ints  # (T,)
    effort: Floats  # (T,) N: largest force of the coupling; inf without a limit
    squeeze: Floats  # (T,) m: how much deeper than recorded contacts with simulated bodies press


class Dofs(NamedTuple):
    """Q degrees of freedom of all trees."""

    lower: Floats  # (Q,) -inf where there is no limit
    upper: Floats  # (Q,)
    tree: Ints  # (Q,)
    chain: Ints  # (Q,) index into `Chains`, -1 outside every chain
    effort: Floats  # (Q,) N or N m: largest force of the coupling; inf without a limit


class Chains(NamedTuple):
    """C kinematic chains of all avatars."""

    tree: Ints  # (C,)
    body_start: Ints  # (C + 1,) rows of `bodies`
    bodies: Ints  # (M,) bodies of the chain, from the one below its base to its tip


class ReachCones(NamedTuple):
    """R reach cones: polygons on the unit sphere."""

    joint_start: Ints  # (R + 1,) rows of `joints`
    joints: Ints  # (J,) bodies whose joints make up the compound joint, root first
    limb: Floats  # (R, 3) limb direction in the last joint's frame at zero angles
    direction_start: Ints  # (R + 1,) rows of `directions`
    directions: Floats  # (D, 3) unit, polygon corners, in the frame of the first joint's parent link


class Materials(NamedTuple):
    """Restitution and friction per pair of materials, symmetric; NaN for pairs that cannot come into contact."""

    restitution: Floats  # (K, K)
    friction: Floats  # (K, K)


class Scene(NamedTuple):
    """The whole scene. `excluded[a, b]` is 1 for bodies of one avatar (indices < L) that are not tested against each other."""

    gravity: Floats  # (3,)
    pieces: Pieces
    bodies: Bodies
    trees: Trees
    dofs: Dofs
    chains: Chains
    cones: ReachCones
    materials: Materials
    excluded: Ints  # (L, L) symmetric; the avatars' bodies are the first L
    initial_velocity: (
        Floats  # (B, 6) of the centre of mass [m/s] and angular [rad/s], world frame; 0 but for simulated bodies
    )
