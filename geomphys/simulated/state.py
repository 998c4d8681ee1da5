"""State of the simulated loop: motion of the bodies, pairs that may touch, contact points being solved.

Everything is made once by `make_simulation`; a frame allocates nothing. Tables are arrays of records, whose types are
defined here. Since its base time τ0 a body moves as

    reference point  p + v τ + ½ a τ²,   orientation  exp(w τ + d τ (τ - h)) q,

the reference point being the centre of mass of a simulated body and the origin of any other.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.scratch import SIMPLEX, Scratch
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import Record
from geomphys.scene.arrays import FIXED, SIMULATED, Floats, Ints, Materials, Pieces

FLOAT, INT = np.float64, np.int64

MOTION = np.dtype(
    [
        ("base_time", FLOAT),  # s since the step's start: τ0
        ("position", FLOAT, 3),  # m: p
        ("orientation", FLOAT, 4),  # x y z w: q
        ("velocity", FLOAT, 3),  # m/s: v
        ("acceleration", FLOAT, 3),  # m/s²: a
        ("rotation_rate", FLOAT, 3),  # rad/s: w, mean over the step
        ("half_angular_acceleration", FLOAT, 3),  # rad/s²: d
        ("step_duration", FLOAT),  # s: h, of the step that w and d were made for
        ("angular_momentum", FLOAT, 3),  # kg m²/s, about the reference point, world
        ("torque", FLOAT, 3),  # N m, mean over the step
        ("angular_velocity", FLOAT, 3),  # rad/s at the base time
        ("inverse_inertia", FLOAT, 9),  # world, at the base time
        ("inverse_mass", FLOAT),  # 1/kg; 0 for bodies with prescribed motion
        ("listed_range", FLOAT),  # m: how far from `listed_position` the list of pairs is valid
        ("listed_position", FLOAT, 3),  # m: reference point when they were listed
        ("listed_rotation", FLOAT),  # rad: how far it has rotated since then
        ("travelled", FLOAT),  # m: how far any surface point may have moved until the base time, summed
        ("reach", FLOAT),  # m: no surface point that rotation moves is farther from the reference point
        ("centre", FLOAT, 3),  # m: reference point in the body frame
        ("inertia", FLOAT, 3),  # kg m²: principal moments
        ("principal", FLOAT, 4),  # x y z w: body_from_principal
        ("mass", FLOAT),  # kg, of a simulated body
        ("reported_angular_velocity", FLOAT, 3),  # rad/s: angular velocity last written for the caller
        ("quiet_time", FLOAT),  # s: how long it has been at rest
        ("slow_time", FLOAT),  # s: how long it has been slow while supported
        ("slow_from", FLOAT),  # m/s: how fast it was when that began
        ("saved_pose", FLOAT, 7),  # saved pose: reference point and orientation
        ("reported_pose", FLOAT, 7),  # pose last written for the caller
        ("rest_pose", FLOAT, 7),  # reference point and orientation since when it has been at rest
        ("path_velocity", FLOAT, 6),  # m/s, rad/s: mean velocities of a kinematic body in the last frame
        ("path_acceleration", FLOAT, 6),  # m/s², rad/s²: how they had changed
        ("path_duration", FLOAT),  # s: how long that frame is
    ]
)
"""Motion of a body."""

UNBOUNDED, OUT_OF_COLLISIONS, STOPPED, BROKEN = range(4)
"""What ended the work on the island of a body in this frame: nothing; the bound on collisions, after which nothing bounces; that
on moments with impacts, or numbers that are not finite, after which it stands still."""

ASLEEP, AWAKE, COUPLED, IN_OTHER_GROUP = range(4)
"""Activation of a simulated body: at rest and left out; in this loop; solved with driven bodies, in the group at hand or all of
them; solved with driven bodies, in another group than that at hand."""

BODY = np.dtype(
    [
        ("role", INT),
        ("tree", INT),
        ("first_piece", INT),
        ("end_piece", INT),  # one past its last
        ("material", INT),
        ("island", INT),  # label shared by bodies that may touch within the frame
        ("changed", INT),  # 1: its motion has changed at this moment
        ("substep_end", FLOAT),  # s of the step: until when its island has been solved
        ("moments", INT),  # moments with impacts of its island in this substep
        ("all_moments", INT),  # the same in this frame
        ("collisions", INT),  # collisions of its island in this frame
        ("bound", INT),  # UNBOUNDED, OUT_OF_COLLISIONS, STOPPED or BROKEN
        ("moves", INT),  # 1: may move
        ("activation", INT),  # ASLEEP, AWAKE, COUPLED or IN_OTHER_GROUP
        ("island_activation", INT),  # ASLEEP or AWAKE: of the island labelled by this body, while that is decided
        ("fresh", INT),  # 1: placed by the caller, not where the frame before left it
        ("touched", INT),  # 1: has had contact points in this step
        (
            "disturbed",
            INT,
        ),  # number of the visit to a contact that last changed its velocity while contacts were solved
        ("contact_group", INT),  # towards the first of the bodies that contacts being solved connect
        ("contact_count", INT),  # contacts of the group that the body stands for
        ("contact_end", INT),  # one past the last of them in `order`
    ]
)
"""Role of a body, and its state in this frame."""

ISLAND = np.dtype(
    [
        ("first_body", INT),  # its simulated bodies in `members`
        ("end_body", INT),
        ("first_pair", INT),  # the pairs of them in `island_pairs`
        ("end_pair", INT),
        ("mass", FLOAT),  # kg
    ]
)
"""Bodies that may touch, directly or through others; the least of them labels it."""

INACTIVE, ACTIVE, IMPACTING = range(3)
"""Modes of a contact."""

CONTACT = np.dtype(
    [
        ("pair", INT),
        ("a", INT),  # bodies
        ("b", INT),
        ("slot", INT),  # of the pair
        ("mode", INT),  # INACTIVE: left out, ACTIVE: solved, IMPACTING: takes part in a collision
        ("visit", INT),  # number of the last visit to it
        ("normal", FLOAT, 3),  # unit, out of b into a
        ("tangent", FLOAT, 3),
        ("binormal", FLOAT, 3),
        ("arm_a", FLOAT, 3),  # m, from the reference point of a
        ("arm_b", FLOAT, 3),  # m
        ("clearance", FLOAT),  # m: distance of the surfaces at this point
        ("normal_impulse", FLOAT),  # N s
        ("tangent_impulse", FLOAT, 2),  # N s, along tangent and binormal
        ("response_a", FLOAT, (3, 3)),  # I_a⁻¹ (r_a × direction) for normal, tangent, binormal
        ("response_b", FLOAT, (3, 3)),
        ("inverse_mass_n", FLOAT),  # 1/kg: what a unit normal impulse changes the normal velocity by
        ("inverse_mass_t", FLOAT, 3),  # 1/kg: K_tt, K_tb, K_bb of the two tangents
        ("inverse_mass_nt", FLOAT, 2),  # 1/kg: what a unit normal impulse changes the two tangential velocities by
        ("speed", FLOAT),  # m/s: of the motion at the point when its solve began
        ("target_speed", FLOAT),  # m/s: the normal velocity must not end below it
        ("friction", FLOAT),
        ("restitution", FLOAT),
        (
            "impulse_limit",
            FLOAT,
        ),  # N s: largest normal impulse; finite only if b has prescribed motion and may press a against something
        ("mass_t", FLOAT, 3),  # kg: inverse of the matrix `inverse_mass_t`
        ("mass_n", FLOAT),  # kg: inverse of `inverse_mass_n`, while contacts are solved
        ("inverse_mass_most", FLOAT),  # 1/kg: the larger of its eigenvalues
        # in the coupled solve with driven bodies
        ("point", FLOAT, 3),  # m, world
        ("prescribed", FLOAT, 3),  # m/s along the three axes: relative velocity prescribed by the recording
        ("included", INT),  # 1: takes part in the solve
        ("first_effect", INT),  # its entries of `EFFECT`: responses of driven trees' unknowns
        ("end_effect", INT),
        ("slip_debt", FLOAT, 3),  # m, world: drift of the point while it stuck
        ("tangent_target", FLOAT, 2),  # m/s: sliding velocity that friction seeks
        ("previous_impulse", FLOAT, 3),  # N s along the three axes: impulses after the last two sweeps
        ("extrapolated", FLOAT, 3),  # N s: impulses that these sweeps began with
    ]
)
"""A contact point that is being solved."""

PAIR = np.dtype(
    [
        ("piece", INT, 2),  # a of a simulated body, b of any other
        ("body", INT, 2),
        ("point_count", INT),  # contact points now
        ("encounters", INT),  # impacts in this step
        ("resting", INT),  # 1: contact forces act at some point of it
        ("queue_index", INT),  # index in the queue, -1: not in it
        ("hits", INT),  # collisions at this moment
        ("disabled", INT),  # 1: b, of prescribed motion, presses a against something: no contact until the frame's end
        ("axis", FLOAT, 3),  # last separating direction
        ("simplex", SIMPLEX),  # where the last search for its distance has ended
        ("distance", FLOAT),  # m: separation when last measured
        ("measured_at", FLOAT),  # s of the step: when that was, -1: not in this step
        ("known_distance", FLOAT),  # m: least separation when last measured at the present time of its bodies
        ("travelled", FLOAT),  # m: sum of that of its bodies then; -inf if b has prescribed motion
        ("due", FLOAT),  # s of the step: its next impact
        ("friction", FLOAT),
        ("restitution", FLOAT),
        ("touching", INT),  # 1: was in contact in the last coupled step
    ]
)
"""A pair of pieces that may touch, and its cached data."""

SLOT = np.dtype(
    [
        ("local", FLOAT, 3),  # m: the point relative to the reference point of a, in a's frame
        ("normal_force", FLOAT),  # N, of the last step
        ("friction_force", FLOAT, 3),  # N, world
        ("normal_impulse", FLOAT),  # N s, of the frame
        ("friction_impulse", FLOAT, 3),  # N s, of the frame
        ("normal_impulses", FLOAT, 3),  # N s: normal impulses of the frame as vectors
        ("since", FLOAT),  # s of the step: until when the impulses of its forces have been summed
        ("normal", FLOAT, 3),  # unit, world: of its forces
        ("used", INT),  # 1: the slot has a point
        ("depth", FLOAT),  # m: minus the clearance when last measured
        ("slip_debt", FLOAT, 3),  # m, a's frame: drift of the point while it stuck
    ]
)
"""A contact point of a pair, cached from step to step."""

COUNTS = np.dtype(
    [
        ("pairs", INT),
        ("old_pairs", INT),
        ("saved_from", INT),  # the old pairs from this one on have been copied to `old_pairs`, the others are in place
        ("contacts", INT),
        ("queued", INT),
        ("lost", INT),  # pairs and contact points beyond the capacity of their table
        ("changed", INT),
        ("concerned", INT),
    ]
)
"""How much of the tables is in use."""

FRAME = np.dtype(
    [
        ("dt", FLOAT),  # s
        ("step", FLOAT),  # s: length of the step at hand
        ("begun", FLOAT),  # s of this part of the frame: its start
        ("elapsed", FLOAT),  # s of the frame: the same
        ("gap", FLOAT),  # m: clearance between surfaces in contact
        ("touch", FLOAT),  # m: clearance that counts as touching
        ("restitution_threshold", FLOAT),  # m/s: slower approaches are resting contact
        ("weight", FLOAT),  # m/s²: |gravity|
        ("extent_low", FLOAT, 3),  # m: box of everything that simulated bodies can reach
        ("extent_high", FLOAT, 3),
        ("span_start", FLOAT),  # s of the step: the span in which pairs are searched
        ("span_end", FLOAT),
    ]
)
"""Constants of the frame."""

LOCAL_BOX = np.dtype(
    [
        ("centre", FLOAT, 3),  # m
        ("half", FLOAT, 3),  # m: half extents
        ("radius", FLOAT),  # m: of a ball about the centre that holds the piece
    ]
)
"""Box of a piece in its own frame."""

BALL = np.dtype(
    [
        ("centre", FLOAT, 3),  # m, body frame
        ("radius", FLOAT),  # m
    ]
)
"""A ball that holds a body."""

AABB = np.dtype(
    [
        ("low", FLOAT, 3),  # m, world
        ("high", FLOAT, 3),
    ]
)
"""An axis-aligned box."""

Records: TypeAlias = NDArray[Any]
Motion: TypeAlias = Any  # a record of `MOTION`
Contact: TypeAlias = Any  # of `CONTACT`
Slot: TypeAlias = Any  # of `SLOT`
Aabb: TypeAlias = Any  # of `AABB`


class Simulation(NamedTuple):
    """Scene, state and workspace of the kernels of the simulated loop."""

    pieces: Pieces
    gravity: Floats  # (3,) m/s²
    materials: Materials
    free: Ints  # (S,) the simulated bodies
    paths: Ints  # (M,) bodies that move but are not simulated
    still: Ints  # (n,) bodies that never move and are not wide, sorted by the low x of their boxes
    still_low: Floats  # (n,) m
    widest: float  # m: the widest of them along x
    others: Ints  # (m,) bodies that move and still ones that are wide
    arm: Floats  # (P,) m: no surface point that rotation moves is farther from its body's reference point
    local_boxes: Records  # (P,) LOCAL_BOX
    balls: Records  # (B,) BALL
    # state, with `counts`
    motion: Records  # (B,) MOTION
    bodies: Records  # (B,) BODY
    pairs: Records  # (N,) PAIR
    slots: Records  # (N, 4) SLOT
    # input and output of a frame
    start: Floats  # (B, 7) poses at the frame's start
    end: Floats  # (B, 7) poses at its end; those of simulated bodies are written
    reported: Floats  # (B, 6) m/s of the centre of mass and rad/s, world: see `begin_frame`
    # workspace
    frames: Floats  # (P, 12) world_from_piece at the time last posed
    scratch: Scratch
    counts: Record  # COUNTS
    frame: Record  # FRAME
    boxes: Records  # (P,) AABB of the volume that a piece sweeps
    body_boxes: Records  # (B,) AABB
    old_pairs: Records  # (N + 1,) PAIR
    old_pair_slots: Records  # (N + 1, 4) SLOT
    contacts: Records  # (K,) CONTACT
    order: Ints  # (K,) contacts while they are solved: by groups of bodies in contact, or those of a collision
    velocity: Floats  # (B, 6) velocities while contact points are solved
    displacement: Floats  # (B, 6) displacements of position projection
    islands: Records  # (B,) ISLAND, by its label
    members: Ints  # (B,) simulated bodies by islands
    island_pairs: Ints  # (N,) pairs by islands
    changed: Ints  # (B,) bodies whose motion has changed at this moment, sorted
    concerned: Ints  # (N,) pairs of at least one of them, sorted
    energy: Floats  # (B,) J: of the bodies, when their island's substep began
    queue: Ints  # (N,) the queue of impacts
    found: Ints  # (B,) bodies near another
    old_slots: Records  # (4,) SLOT


@kernel
def is_simulated(sim: Simulation, body: int) -> bool:
    """Whether a body is simulated."""
    return sim.bodies[body].role == SIMULATED


@kernel
def is_kinematic(sim: Simulation, body: int) -> bool:
    """Whether a body stands still or follows the recording whatever is in its way (class fixed); a driven one yields."""
    return sim.bodies[body].role == FIXED


@kernel
def is_coupled(sim: Simulation, body: int) -> bool:
    """Whether a simulated body is solved together with driven ones, in the group at hand."""
    return sim.bodies[body].activation == COUPLED


@kernel
def has_changed(sim: Simulation, body: int) -> bool:
    """Whether the motion of a simulated body has changed at this moment."""
    return sim.bodies[body].changed == 1


@kernel
def concerns_changed(sim: Simulation, pair: int) -> bool:
    """Whether the motion of one of a pair's bodies has changed."""
    p = sim.pairs[pair]
    return has_changed(sim, p.body[0]) or has_changed(sim, p.body[1])


@kernel
def is_disabled(sim: Simulation, pair: int) -> bool:
    """Whether a pair has no contact until the frame's end, as it presses a body against something."""
    return sim.pairs[pair].disabled == 1
