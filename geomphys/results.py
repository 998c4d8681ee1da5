"""Records of a frame: the recorded input and the corrected result, shared by all stages, sinks and callers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

METHODS = ("global", "least_distance", "interpolated")


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame of the recording, on the frame clock."""

    index: int
    time_ns: int
    roots: Floats  # (T, 7) world pose of every tree's root as recorded (rest pose where no topic moves it)
    angles: Floats  # (Q,) rad or m as recorded
    held: bool  # a stream has no good sample at this frame: its last good value is used
    flags: int = 0  # bits of `FLAG_*`


FLAG_HELD = 1  # a stream had no good sample: its last good value is used
FLAG_BEFORE_FIRST = 2  # a stream has not begun yet: its first value is used
FLAG_CLAMPED = 4  # an angle was clamped to its limit (`clamp_limits`)
FLAG_OUTSIDE_LIMITS = 8  # a recorded angle lies outside its limits and was kept
FLAG_NOT_CONVERGED = 16  # no free pose was found within the bounds of the search: an overlap may remain
FLAG_IMPACT_BOUND = 32  # the simulated loop reached its limit of impacts
FLAG_QUARANTINED = 64  # a body became non-finite and was reset to its last good state
FLAG_BLOCKED = 128  # the recorded pose is free, but the path to it is obstructed
FLAG_STARTED_INSIDE = 256  # the first frame overlapped
FLAG_SHAPE_CHANGED = 512  # mode rigid: shape or rotation changed too: a translation would go too far, or off a grip
FLAG_CATCHING_UP = 1024  # after a gap or a jump of a tracker, the way missed is made up at a bounded speed
FLAG_SWEEP_BOUND = 2048  # contact forces of driven and simulated bodies ended at their bound of sweeps, not settled


class Contacts(NamedTuple):
    """n contact points of a frame, world frame. Bodies are indices into `World.body_names`."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    point: Floats  # (n, 3) m
    normal: Floats  # (n, 3) unit, out of b into a
    depth: Floats  # (n,) m, how far the correction moved the point; for simulated bodies the overlap
    normal_impulse: Floats  # (n,) N s
    tangential_impulse: Floats  # (n,) N s


class Penetrations(NamedTuple):
    """n pairs of objects (trees or avatar links) whose recorded poses overlapped in a frame."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    pd: Floats  # (n, 3) m, PD_g of (1): displacement of body_a that ends the overlap
    convex_pairs: Ints  # (n,) overlapping pairs of convex pieces
    largest: Floats  # (n,) m, of the deepest convex pair
    method: Ints  # (n,) index into METHODS


class Metrics(NamedTuple):
    """Metrics of a frame; the fields of geomphys.FrameMetrics."""

    contacts: int
    recorded_penetration_m: float
    residual_penetration_m: float
    iterations: int
    impacts: int
    fallbacks: int
    correction_m: float  # largest distance of a body's origin from its recorded position
    correction_rad: float  # largest angle of a body from its recorded orientation
    held: bool
    flags: int
    recorded_speed_m_s: float  # largest of the driven bodies, since the frame before; 0 in the first
    correction_speed_m_s: float  # the same of the offset from the recorded positions
    recorded_jerk_m_s3: float  # third derivatives over the last four frames; 0 in the first three
    correction_jerk_m_s3: float
    shape_change_rad: (
        float  # largest rotation of a link of a tree in rigid mode from its recorded one; 0 if only translated
    )
    amplification: (
        float  # largest offset of a driven link over the recorded depth; 0 in frames recorded less than 0.5 mm deep
    )
    contacts_recorded: int  # fingertips recorded within 2 mm of something of another tree, or inside
    contacts_kept: int  # of these, those that are within 1 mm, or no farther than recorded
    grasps_recorded: int  # hands whose thumb and another finger were recorded in contact
    grasps_kept: int  # of these, those where both still are
    fingertip_error_m: (
        float  # mean distance of fingertips recorded in contact from where they were recorded; of all if none was
    )
    contact_precision_m: float  # mean distance of the points of kept contacts on the other thing from the recorded ones
    contact_alignment_rad: float  # mean angle of the normals of kept contacts from the recorded ones


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A frame of a replay that is worth a look."""

    kind: str  # recorded_penetration | correction | amplification | contacts_lost | fallbacks
    frame: int
    time_ns: int
    time_s: float  # since the first frame
    bodies: tuple[str, ...]  # the pair that overlapped most, or the body that was corrected most
    value: float
    unit: str  # "m", or "" of a ratio or a number
    volume_m3: float | None = None  # of the deepest recorded overlap: volume common to the two bodies, if it is known


HELD_FOR = 0.2  # s: a body supported by driven ones alone for so long is held
LIFTED_BY = 0.01  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """Outcome of a simulated object that driven bodies touched. Forces are means over a frame."""

    body: str
    touched_s: float  # how long driven bodies pressed it
    held_s: float  # how long they alone carried it; 0: touched but not held
    lifted_m: float  # how far against gravity while it was held, at most
    dropped: int  # how often it was released in the air
    grip_force_n: float  # median of the sum of normal forces while it was held, else while it was touched
    margin: float
    """Least share of available over needed friction while it was held, but for the last 0.2 s before it was released; inf where
    none was needed."""

    @property
    def outcome(self) -> str:
        """One of dropped, lifted, held, touched."""
        if self.dropped:
            return "dropped"
        if self.held_s < HELD_FOR:
            return "touched"
        return "lifted" if self.lifted_m > LIFTED_BY else "held"


@dataclass(frozen=True, slots=True)
class FrameResult:
    """A corrected frame. No other frame has its arrays: they stay as they are when the next is computed."""

    frame: Frame
    recorded: Floats  # (B, 7) world pose of every body as recorded
    corrected: Floats  # (B, 7) world pose of every body
    angles: Floats  # (Q,) corrected joint values
    contacts: Contacts
    penetrations: Penetrations
    metrics: Metrics
    timing: tuple[tuple[str, int, int], ...]  # (dotted stage name, ns, count)
    messages: tuple[tuple[str, str], ...] = ()  # (level: "info" | "warning" | "error", text)
    moments: tuple[Moment, ...] = ()  # with the last frame: the worst moments of the replay
    grasps: tuple[Grasp, ...] = ()  # with the last frame: outcomes of the simulated bodies that driven ones touched
