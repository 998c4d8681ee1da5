"""What the simulated loop keeps: the bodies' motion, the pairs that may meet, the contact points being solved.

Everything is made once by `make_simulated_state`; a frame allocates nothing. Kernels are handed one address, `sim`,
of a header that holds those of all arrays; the columns of the arrays have names here.
"""

from __future__ import annotations

from typing import NamedTuple

from geomphys.collision.manifold import Faces
from geomphys.collision.scratch import Room
from geomphys.collision.support import Shapes
from geomphys.jit.addresses import float_at, int_at, set_int
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import SIMULATED, Floats, Ints

# Columns of `motion`, one row a body. Since its base time τ0 a body moves as
#   reference point  p + v τ + ½ a τ²,   orientation  exp(w τ + d τ (τ - h)) q,
# the reference point being the centre of mass of a simulated body and the origin of any other.
BASE = 0  # s since the frame's start
POINT = 1  # m, 3: p
TURN = 4  # x y z w: q
SPEED = 8  # m/s, 3: v
PULL = 11  # m/s², 3: a
RATE = 14  # rad/s, 3: w, mean over the step
BEND = 17  # rad/s², 3: d
LENGTH = 20  # s: h, length of the step that `RATE` and `BEND` were made for
MOMENTUM = 21  # kg m²/s, 3: angular momentum about the reference point, world
TORQUE = 24  # N m, 3: mean over the step
SPIN = 27  # rad/s, 3: angular velocity at the base time
INVERSE = 30  # 9: inverse inertia, world, at the base time
LIGHTNESS = 39  # 1/kg: inverse mass; 0 for what follows its path
RANGE = 40  # m: how far from `HOME` the pairs on the list hold good
HOME = 41  # m, 3: reference point when they were listed
TURNED = 44  # rad: how far it has turned since then
ARM = 45  # m: no surface point that turning moves is farther from the reference point
OFFSET = 46  # m, 3: reference point in the body frame
INERTIA = 49  # kg m², 3: principal moments
PRINCIPAL = 52  # x y z w: body_from_principal
MASS = 56  # kg; of a driven body: that of its coupling
TOLD = 57  # rad/s, 3: angular velocity last written for the caller
WISH_ARM = 60  # m, 3: centre of mass in the body frame of a driven body
QUIET = 63  # s: how long it has been at rest
SET_ASIDE = 64  # 7: a pose kept for later, reference point and orientation
LAST_POSE = 71  # 7: pose last written for the caller
REST_POSE = 78  # 7: reference point and orientation since when it has been at rest
COURSE = 85  # m/s, rad/s, 6: mean velocities of a tracked thing in the frame before
COURSE_CHANGE = 91  # m/s², rad/s², 6: how they had changed
COURSE_TIME = 97  # s: how long that frame was
MOTION_COLUMNS = 98

# Columns of `kinds`, one row a body
ROLE = 0
TREE = 1
FIRST = 2  # its pieces
LAST = 3  # one past
MATERIAL = 4
ISLAND = 5  # label shared by bodies that may touch each other within the frame
CHANGED = 6  # 1: has changed course at this moment
MOVES = 7  # 1: may move
AWAKE = 8  # 0: rests, and nothing that moves is near
ISLAND_AWAKE = 9  # the same of the island that bears this body's name
FRESH = 10  # 1: stands where the caller put it, not where the frame before left it
TOUCHED = 11  # 1: has had contact points in this step
WEDGED = 12  # 1: the island that bears this body's name has no room for what touches it
DISTURBED = 13  # number of the visit to a row that last changed its velocity while contact points were solved
KIND_COLUMNS = 14

# Columns of `rows`, one row a contact point that is being solved
NORMAL = 0  # 3: unit, out of b into a
TANGENT = 3  # 3
BINORMAL = 6  # 3
ARM_A = 9  # m, 3: from the reference point of a
ARM_B = 12  # m, 3
CLEARANCE = 15  # m: distance of the surfaces at this point
PUSH = 16  # N s: normal impulse
RUB = 17  # N s, 2: along tangent and binormal
TURN_A = 19  # 9: I_a⁻¹ (r_a × direction) for normal, tangent, binormal
TURN_B = 28  # 9
MASS_N = 37  # 1/kg: what a unit normal impulse changes the normal velocity by
MASS_T = 38  # 1/kg, 3: K_tt, K_tb, K_bb of the two tangents
GOAL = 41  # m/s: the normal velocity must not end below it
FRICTION = 42
RESTITUTION = 43
SINCE = 44  # s of the frame: since when the point's forces act
LIMIT = 45  # N s: largest normal impulse; infinite unless b follows a path and might squeeze a against something
GRIP = 46  # N s: normal impulse beside `PUSH` that friction may count on
INVERSE_T = 47  # kg, 3: inverse of the matrix `MASS_T`
MASS_MOST = 50  # 1/kg: the larger of its eigenvalues
ROW_COLUMNS = 51

# Columns of `row_of`
ROW_PAIR, ROW_A, ROW_B, ROW_SLOT, ROW_ON, ROW_VISIT = range(6)
ROW_INTS = 6

# Columns of `pairs`, one row a pair of pieces: a of a simulated body, b of any other
PIECE_A, PIECE_B, BODY_A, BODY_B = range(4)
POINTS = 4  # contact points now
EVENTS = 5  # times it met in this step
HELD = 6  # 1: some point of it is held by contact forces
PLACE = 7  # where it stands in the queue, -1: nowhere
HITS = 8  # collisions at this moment
YIELDED = 9  # 1: b follows its path and squeezes a: left alone until the frame's end
PAIR_COLUMNS = 10

# Columns of `kept`: what is remembered of a pair
AXIS = 0  # 3: last separating direction
DISTANCE = 3  # m: separation when last looked at
SEEN = 4  # s of the frame: when that was, -1: not in this frame
DUE = 5  # s of the frame: its next meeting
PAIR_FRICTION = 6
PAIR_RESTITUTION = 7
SLOTS = 8  # 4 slots of `SLOT_SIZE`: the contact points
LOCAL = 0  # m, 3: the point relative to the reference point of a, in a's frame
FORCE = 3  # N, 4: normal force and friction force (3, world) of the last step
SUM_N = 7  # N s: normal impulse of the frame
SUM_T = 8  # N s, 3: friction impulse of the frame
SUM_V = 11  # N s, 3: normal impulses of the frame as vectors
STAMP = 14  # 1: the slot holds a point
DEPTH = 15  # m: minus the clearance when last looked at
GRASP = 16  # N s: what a driven body pressed in this frame
SLOT_SIZE = 17
KEPT_COLUMNS = SLOTS + 4 * SLOT_SIZE

# `counts`
N_PAIRS, N_OLD, N_ROWS, N_HEAP, N_LOST = range(5)
N_LOOKS, N_SPANS, N_SWEEPS = range(5, 8)  # work done so far: narrow phases, spans of time, sweeps of the solver


class SimulatedState(NamedTuple):
    """State (`motion`, `pairs`, `kept` between frames) and work space of the simulated loop."""

    free: Ints  # (S,) the simulated bodies
    paths: Ints  # (M,) bodies that move but are not simulated
    still: Ints  # (n,) bodies that never move and are not wide, by the low x of their boxes
    still_low: Floats  # (n,) m
    widest: float  # m: the widest of them along x
    others: Ints  # (m,) bodies that move and still ones that are wide
    arm: Floats  # (P,) m: no surface point that turning moves is farther from its body's reference point
    boxes: Floats  # (P, 6) low and high corner of what a piece sweeps
    body_boxes: Floats  # (B, 6)
    local_boxes: Floats  # (P, 7) centre and half extents of a piece's box in its own frame, radius of a ball about it
    balls: Floats  # (B, 4) centre in the body frame and radius of a ball that holds the body
    materials: Floats  # (2, K, K) restitution and friction
    gravity: Floats  # (3,)
    motion: Floats  # (B, MOTION_COLUMNS)
    kinds: Ints  # (B, KIND_COLUMNS)
    pairs: Ints  # (N, PAIR_COLUMNS)
    kept: Floats  # (N, KEPT_COLUMNS)
    old_pairs: Ints  # (N, PAIR_COLUMNS)
    old_kept: Floats  # (N, KEPT_COLUMNS)
    counts: Ints  # (8,)
    rows: Floats  # (K, ROW_COLUMNS)
    row_of: Ints  # (K, ROW_INTS)
    velocity: Floats  # (B, 6) work: velocities while contact points are solved
    shove: Floats  # (B, 6) work: small displacements
    heft: Floats  # (B,) kg, work: mass of the island with this label
    energy: Floats  # (B, 4) J, work: see `geomphys.simulated.energy`
    recoil: Floats  # (T, 3) m/s: velocity that the impulses of this frame gave to driven trees
    heap: Ints  # (N,) the queue of impacts
    found: Ints  # (B,) work
    points: Floats  # (2, 4, 3) work: contact points on a and on b
    old_slots: Floats  # (4, SLOT_SIZE) work
    header: Ints  # (HEADER,) see `entry`


# Entries of the header, the one address that kernels are handed: addresses of the arrays above (and of what the caller
# gives), numbers of rows, and the constants of a frame.
AT_MOTION, AT_KINDS, AT_ROWS, AT_ROW_OF, AT_PAIRS, AT_KEPT, AT_COUNTS, AT_VELOCITY = range(8)
AT_FREE, AT_COUNT, AT_PATHS, AT_PATH_COUNT, AT_STILL, AT_STILL_LOW, AT_STILL_COUNT, AT_OTHERS = range(8, 16)
AT_OTHER_COUNT, AT_ARM, AT_BOXES, AT_BODY_BOXES, AT_MATERIALS, AT_MATERIAL_COUNT, AT_OLD_PAIRS, AT_OLD_KEPT = range(
    16, 24
)
AT_PAIR_ROOM, AT_ROW_ROOM, AT_SHOVE, AT_HEFT, AT_RECOIL, AT_TREE_COUNT, AT_HEAP, AT_FOUND = range(24, 32)
AT_POINTS, AT_OLD_SLOTS, AT_TOLD, AT_DRIVEN_IMPULSE, AT_LOCAL, AT_FRAMES = range(32, 38)
AT_LOCAL_BOXES, AT_BALLS, AT_START, AT_END = range(38, 42)
AT_SHAPES = 42  # 11: `Shapes`
AT_FACES = 53  # 4: `Faces`
AT_ROOM = 57  # 7: `Room`
GRAVITY = 64  # m/s², 3
AT_WEIGHT = 67  # m/s²: |gravity|
AT_GAP = 68  # m: clearance kept
AT_TOUCH = 69  # m: clearance that counts as touching
AT_THRESHOLD = 70  # m/s: slower approaches are resting contact
AT_DT = 71  # s: the frame
AT_WIDEST = 72
AT_EXTENT = 73  # m, 6: box of all that simulated bodies can reach in the frame
AT_ENERGY = 79
AT_FROM = 80  # s of the frame: the span that pairs are looked for in
AT_UNTIL = 81
HEADER = 82


@kernel
def entry(sim: int, what: int) -> int:
    """An address or number of the header."""
    return int_at(sim, what)


@kernel
def knob(sim: int, what: int) -> float:
    """A constant of the header."""
    return float_at(sim, what)


@kernel
def shapes_at(sim: int) -> Shapes:
    """The pieces for the narrow phase."""
    i = AT_SHAPES
    return Shapes(
        int_at(sim, i), int_at(sim, i + 1), int_at(sim, i + 2), int_at(sim, i + 3), int_at(sim, i + 4),
        int_at(sim, i + 5), int_at(sim, i + 6), int_at(sim, i + 7), int_at(sim, i + 8), int_at(sim, i + 9),
        int_at(sim, i + 10),
    )  # fmt: skip


@kernel
def faces_at(sim: int) -> Faces:
    """Their faces."""
    i = AT_FACES
    return Faces(int_at(sim, i), int_at(sim, i + 1), int_at(sim, i + 2), int_at(sim, i + 3))


@kernel
def room_at(sim: int) -> Room:
    """Memory of the narrow phase."""
    i = AT_ROOM
    return Room(
        int_at(sim, i), int_at(sim, i + 1), int_at(sim, i + 2), int_at(sim, i + 3), int_at(sim, i + 4),
        int_at(sim, i + 5), int_at(sim, i + 6),
    )  # fmt: skip


@kernel
def motion_of(sim: int, body: int) -> int:
    """Row of `motion`."""
    return int_at(sim, AT_MOTION) + 8 * MOTION_COLUMNS * body


@kernel
def kind_of(sim: int, body: int) -> int:
    """Row of `kinds`."""
    return int_at(sim, AT_KINDS) + 8 * KIND_COLUMNS * body


@kernel
def row(sim: int, k: int) -> int:
    """Row of `rows`."""
    return int_at(sim, AT_ROWS) + 8 * ROW_COLUMNS * k


@kernel
def owner(sim: int, k: int) -> int:
    """Row of `row_of`."""
    return int_at(sim, AT_ROW_OF) + 8 * ROW_INTS * k


@kernel
def pair_at(sim: int, pair: int) -> int:
    """Row of `pairs`."""
    return int_at(sim, AT_PAIRS) + 8 * PAIR_COLUMNS * pair


@kernel
def kept_at(sim: int, pair: int) -> int:
    """Row of `kept`."""
    return int_at(sim, AT_KEPT) + 8 * KEPT_COLUMNS * pair


@kernel
def slot_at(sim: int, pair: int, slot: int) -> int:
    """A slot of a pair's row of `kept`."""
    return int_at(sim, AT_KEPT) + 8 * (KEPT_COLUMNS * pair + SLOTS + SLOT_SIZE * slot)


@kernel
def velocity_of(velocity: int, body: int) -> int:
    """Row of `velocity` or `shove`."""
    return velocity + 48 * body


@kernel
def start_of(sim: int, body: int) -> int:
    """Pose of a body at the frame's start."""
    return int_at(sim, AT_START) + 56 * body


@kernel
def end_of(sim: int, body: int) -> int:
    """Pose of a body at the frame's end."""
    return int_at(sim, AT_END) + 56 * body


@kernel
def is_simulated(sim: int, body: int) -> bool:
    """Whether a body is simulated."""
    return int_at(kind_of(sim, body), ROLE) == SIMULATED


@kernel
def has_changed(sim: int, body: int) -> bool:
    """Whether a simulated body has changed course at this moment."""
    return int_at(kind_of(sim, body), CHANGED) == 1


@kernel
def has_yielded(sim: int, pair: int) -> bool:
    """Whether a pair is left alone until the frame's end."""
    return int_at(pair_at(sim, pair), YIELDED) == 1


@kernel
def free_body(sim: int, s: int) -> int:
    """The s-th simulated body."""
    return int_at(int_at(sim, AT_FREE), s)


@kernel
def how_many(sim: int, what: int) -> int:
    """An entry of `counts`."""
    return int_at(int_at(sim, AT_COUNTS), what)


@kernel
def set_how_many(sim: int, what: int, n: int) -> None:
    """Write an entry of `counts`."""
    set_int(int_at(sim, AT_COUNTS), what, n)


@kernel
def count_one(sim: int, what: int) -> None:
    """Add one to an entry of `counts`."""
    set_how_many(sim, what, how_many(sim, what) + 1)
