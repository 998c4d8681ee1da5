"""State and workspace of the coupled contact solve of driven and simulated bodies.

Unknowns of a driven tree are the three offsets of its root's position and one offset of each joint, from their recorded
values. The rotation of the root is none: contacts do not change it.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.links import Links
from geomphys.driven.postures import Posture, make_posture
from geomphys.jit.packed_records import Record
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene

FLOAT, INT = np.float64, np.int64
INDEX = np.uint64  # numba omits the check for negative ones
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Records: TypeAlias = NDArray[Any]
Inequality: TypeAlias = Any  # a record of `INEQUALITY`
Constraint: TypeAlias = Any  # of `CONSTRAINT`

MAX_EFFECTS = 1 << 15
MAX_INEQUALITIES = 1 << 11
MAX_ROWS = 128  # velocities that contacts change: a group with more is solved by sweeps
MAX_CONSTRAINTS = 512
MAX_TERMS = 1 << 13
MAX_INDEXED = 64  # constraints in the Delassus matrix
PADDING = 8  # unused end of each column of the matrix: columns then do not share few sets of the processor's cache

UNKNOWN = np.dtype(
    [
        ("offset", FLOAT),  # m or rad: x, from the recorded value
        ("loaded_offset", FLOAT),  # rad or m: of a joint, at the start of this substep
        ("rate", FLOAT),  # m/s or rad/s: v, of the offset
        ("new_rate", FLOAT),  # u, the rate being solved for
        ("recorded_rate", FLOAT),  # w, of the recording in this substep
        ("recorded_before", FLOAT),  # w of the substep before
        ("mass", FLOAT),  # kg or kg m²: m of (6), for a joint times its lever squared
        ("stiffness", FLOAT),  # N/m or N m/rad: K
        ("damping", FLOAT),  # N s/m or N m s/rad: R
        ("effort", FLOAT),  # N or N m: largest force of the spring
        ("inverse_mass", FLOAT),  # change of `new_rate` by a unit impulse; 0: it follows the recording
        ("row", INT),  # of the tables of the solve; -1: none
        ("lever", FLOAT),  # 1 or m/rad: its lever, of which K of (6) has the square
        ("impedance_scale", FLOAT),  # factor on K, m and R: such that the contact yields by K; 1: no contact
        ("moments", FLOAT),  # N or N m: sum of the magnitudes of contact moments on it
        ("yielding", FLOAT),  # the same times K, each over the stiffness of all joints behind its contact
    ]
)
"""Offset of a root along a world axis, or of a joint."""

TREE = np.dtype(
    [
        ("solved", INT),  # 1: a simulated body is near, its contacts are solved in this substep
        ("pressed", INT),  # 1: a simulated body pressed it in the last step
        ("touched", INT),  # 1: one pressed or hit it in this substep
        ("group", INT),  # label of its group; -1: none
        ("rotation_offset", FLOAT, 4),  # x y z w: orientation of the root, from its recorded one
        ("rotation_offset_rate", FLOAT, 3),  # rad/s: of its rotation vector
    ]
)
"""How a driven tree takes part."""

EFFECT = np.dtype(
    [
        ("unknown", INT),
        ("jacobian", FLOAT, 3),  # relative velocity along normal, tangent and binormal per unit rate
        ("response", FLOAT, 3),  # rate per unit impulse along them
    ]
)
"""Effect of an unknown on a contact, and of the contact on it."""

INEQUALITY = np.dtype(
    [
        ("first_effect", INT),
        ("end_effect", INT),
        ("included", INT),  # 1: takes part in the solve
        ("clearance", FLOAT),  # m or rad
        ("prescribed", FLOAT),  # m/s or rad/s: rate of the clearance if no offset changes
        ("target_speed", FLOAT),
        ("impulse", FLOAT),  # N s or N m s
        ("previous_impulse", FLOAT),  # N s or N m s: impulse after the last two sweeps
        ("extrapolated", FLOAT),  # N s or N m s: impulse that these sweeps began with
        ("response", FLOAT),  # change of the rate of the clearance by a unit impulse
    ]
)
"""Frictionless inequality of unknowns: a driven link and a body that is not simulated, or the limit of a joint."""

ROW = np.dtype(
    [
        ("mass", FLOAT),  # kg or kg m²; 0: of a body's rotation, see `BLOCK`
        ("change", FLOAT),  # m/s or rad/s: of the velocity, since the solve began
        ("accepted", FLOAT),  # the same after the last proximal step
        ("residual", FLOAT),  # N s or N m s: what impulses do not explain of it
    ]
)
"""A velocity that contacts change: the rate of an unknown, or one of the six of a simulated body."""

BLOCK = np.dtype(
    [
        ("row", INT),  # the first of three
        ("inertia", FLOAT, 9),  # kg m²
        ("inverse_inertia", FLOAT, 9),
    ]
)
"""Rotation of a simulated body."""

TERM = np.dtype(
    [
        ("row", INDEX),
        ("jacobian", FLOAT, 3),  # relative velocity along normal, tangent and binormal by the velocity of the row
    ]
)
"""An entry of the Jacobian of the constraints."""

CONSTRAINT = np.dtype(
    [
        ("number", INT),  # of the contact; from the number of contacts on: that of an inequality
        ("first_term", INDEX),  # its entries of the Jacobian
        ("end_term", INDEX),
        ("mass_n", FLOAT),  # kg or kg m²: effective mass along the normal
        ("mass_t", FLOAT),  # the least one across it
        ("friction", FLOAT),
        ("off_target", FLOAT, 3),  # m/s along the three axes: velocity when the solve began, off its target
        ("start", FLOAT, 3),  # N s: impulses when the solve began
        ("reference", FLOAT, 3),  # N s: impulses after the last proximal step
        ("impulse", FLOAT, 3),  # N s: those being solved for
        ("sliding", INT),  # 1: friction is at its bound
        ("part", FLOAT),  # of friction that is within the bound
        ("direction", FLOAT, 2),  # of friction, if sliding
        ("yielding", FLOAT, 9),  # kg or kg m²: B of the last Newton step, change of minus its impulses by its velocity
        ("index", INT),  # in the Delassus matrix; -1: none
        ("summed", INT),  # 1: it is in the sum `sticking`
    ]
)
"""A contact, or an inequality as a contact without friction."""

SOLVE = np.dtype(
    [
        ("rows", INT),  # of the tables of the solve
        ("blocks", INT),
        ("terms", INT),
        ("constraints", INT),
        ("indexed", INT),  # constraints in the Delassus matrix
        ("pressed", INT),  # constraints that were pressed at the last Newton step
        ("reduced", INT),  # 1: the matrix is that of their velocities
        ("effects", INT),
        ("inequalities", INT),
        ("lost", INT),  # effects and inequalities beyond the capacity of their table, which are left out
        ("unconverged", INT),  # steps and impacts of this substep that ended at the bound on sweeps
        ("started", INT),  # 1: there was a substep before
        ("substep_duration", FLOAT),  # s: how long it was
        ("any_awake", INT),  # 1: some simulated body is awake in this substep
    ]
)
"""How much of the tables is in use, and counts of the solve."""


class Coupled(NamedTuple):
    """Tables of the coupled contact solve, beside those of the simulated loop."""

    unknowns: Records  # (3 T + Q,) UNKNOWN: of the roots, then of the joints
    trees: Records  # (T,) TREE
    solve: Record  # SOLVE
    effects: Records  # EFFECT, of the simulated loop's contacts and of the inequalities
    inequalities: Records  # INEQUALITY
    rows: Records  # ROW
    blocks: Records  # BLOCK
    terms: Records  # TERM
    constraints: Records  # CONSTRAINT
    matrix: Floats  # (R, R + PADDING) of a Newton step: each row is a column of it
    sticking: Floats  # (R, R + PADDING) sum of Jᵀ m J of the constraints that stick
    delassus: Floats  # (3 D, 3 D) W = J M⁻¹ Jᵀ of the constraints that have an index
    indexed: Ints  # (D,) their numbers
    pressed: Ints  # (C,) numbers of the pressed constraints
    responses: Floats  # (3, R) velocities by unit impulses along the axes of a constraint
    relative: Floats  # (R,) velocities of the pressed constraints, three each, by the Newton step
    step: Floats  # (R,) the Newton step
    factors: Floats  # (R,) workspace of its elimination
    body_rows: Ints  # (B,) first row of each body; -1: none
    begin: Posture  # the recording at the start of the substep
    now: Posture  # driven trees, corrected
    after: Posture  # the same at the end of the step with their present offsets


def make_coupled(scene: Scene, poses: Floats, links: Links) -> Coupled:
    """The workspace of a scene at rest, bodies at `poses` (B, 7)."""
    trees, dofs = len(scene.trees.role), len(scene.dofs.lower)
    unknowns = np.zeros(3 * trees + dofs, UNKNOWN)
    owner = np.concatenate([np.repeat(np.arange(trees), 3), scene.dofs.tree]).astype(np.int64)
    unknowns["lever"] = np.concatenate([np.ones(3 * trees), links.lever])
    unknowns["impedance_scale"] = 1.0
    arm = unknowns["lever"] * np.sqrt(np.concatenate([np.ones(3 * trees), branches(scene)]))
    yields = np.concatenate([np.ones(3 * trees), links.is_unknown]) * np.isfinite(scene.trees.stiffness[owner])
    yields *= scene.trees.role[owner] == DRIVEN
    stiffness = np.where(np.isfinite(scene.trees.stiffness), scene.trees.stiffness, 0.0)
    unknowns["mass"] = scene.trees.mass[owner] * arm**2 * yields
    unknowns["stiffness"] = stiffness[owner] * arm**2
    unknowns["damping"] = scene.trees.damping[owner] * arm**2
    own = np.concatenate([np.full(3 * trees, np.inf), scene.dofs.effort])
    at_tip = scene.trees.effort[owner] * arm
    unknowns["effort"] = np.where(np.isfinite(own), own, at_tip)
    any_simulated = bool((scene.bodies.role == SIMULATED).any()) and bool((scene.bodies.role == DRIVEN).any())
    records = np.zeros(trees, TREE)
    records["rotation_offset"][:, 3] = 1.0
    some = 1 if any_simulated else 0
    rows, indexed = some * MAX_ROWS, some * MAX_INDEXED
    return Coupled(
        unknowns, records, np.zeros((), SOLVE), np.zeros(MAX_EFFECTS if any_simulated else 1, EFFECT),
        np.zeros(MAX_INEQUALITIES if any_simulated else 1, INEQUALITY), np.zeros(rows, ROW), np.zeros(rows // 6, BLOCK),
        np.zeros(some * MAX_TERMS, TERM), np.zeros(some * MAX_CONSTRAINTS, CONSTRAINT), np.zeros((rows, rows + PADDING)),
        np.zeros((rows, rows + PADDING)), np.zeros((3 * indexed, 3 * indexed)), np.zeros(indexed, np.int64),
        np.zeros(some * MAX_CONSTRAINTS, np.int64), np.zeros((3, rows)), np.zeros(rows),
        np.zeros(rows), np.zeros(rows), np.zeros(len(scene.bodies.role), np.int64), make_posture(scene, poses),
        make_posture(scene, poses), make_posture(scene, poses),
    )  # fmt: skip


def branches(scene: Scene) -> Ints:
    """(Q,) number of joints of each degree of freedom on separate branches: two for a gripper with a mimic joint."""
    counts = np.zeros(len(scene.dofs.lower), np.int64)
    for body, q in enumerate(scene.bodies.dof):
        above = int(scene.bodies.parent[body])
        while above >= 0 and scene.bodies.dof[above] != q:
            above = int(scene.bodies.parent[above])
        if q >= 0 and above < 0:
            counts[q] += 1
    return counts
