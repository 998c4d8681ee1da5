"""What one frame of a replay is and what it gives: plain records that every stage, sink and caller shares."""

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
    held: bool  # some stream had no good sample here: its last good value stands in
    flags: int = 0  # bits of `FLAG_*`


FLAG_HELD = 1
FLAG_BEFORE_FIRST = 2  # some stream has not begun yet: its first value stands in
FLAG_CLAMPED = 4  # an angle was clamped to its limit (`clamp_limits`)
FLAG_OUTSIDE_LIMITS = 8  # a recorded angle lies outside its limits and was kept
FLAG_NOT_CONVERGED = 16  # no free place was found, or none within a bound: an overlap may be left
FLAG_IMPACT_BOUND = 32  # the simulated loop ended at its bound
FLAG_QUARANTINED = 64  # a body became non-finite and was put back to its last good state
FLAG_BLOCKED = 128  # something stands between the body and its recorded pose, which itself is free
FLAG_STARTED_INSIDE = 256  # the first frame overlapped
FLAG_WEDGED = 512  # a body has no room for its recorded turn or shape, and keeps those of its last free place


class Contacts(NamedTuple):
    """n contact points of a frame, world frame. Bodies are indices into `World.body_names`."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    point: Floats  # (n, 3) m
    normal: Floats  # (n, 3) unit, out of b into a
    depth: Floats  # (n,) m, how far the correction moved the point out; for simulated bodies the overlap
    normal_impulse: Floats  # (n,) N s
    tangential_impulse: Floats  # (n,) N s


class Penetrations(NamedTuple):
    """n pairs of objects (trees or avatar links) whose recorded poses overlapped in a frame."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    pd: Floats  # (n, 3) m, PD_g of (1): how far and whither body_a must move
    convex_pairs: Ints  # (n,) overlapping pairs of convex pieces
    largest: Floats  # (n,) m, of the deepest convex pair
    method: Ints  # (n,) index into METHODS


class Metrics(NamedTuple):
    """Figures of a frame; the fields of geomphys.FrameMetrics."""

    contacts: int
    recorded_penetration_m: float
    residual_penetration_m: float
    iterations: int
    impacts: int
    fallbacks: int
    correction_m: float  # largest distance of a body's origin from where it was recorded
    correction_rad: float  # largest angle of a body from how it was recorded
    held: bool
    flags: int
    recorded_speed_m_s: float  # of the driven body that has the largest, since the frame before; 0 in the first
    correction_speed_m_s: float  # the same of the distance from where bodies were recorded
    recorded_jerk_m_s3: float  # third derivatives over the last four frames; 0 in the first three
    correction_jerk_m_s3: float


@dataclass(frozen=True, slots=True)
class FrameResult:
    """A corrected frame. Arrays are its own: they stay valid when the next frame is computed."""

    frame: Frame
    recorded: Floats  # (B, 7) world pose of every body as recorded
    corrected: Floats  # (B, 7) world pose of every body
    angles: Floats  # (Q,) corrected joint values
    contacts: Contacts
    penetrations: Penetrations
    metrics: Metrics
    timing: tuple[tuple[str, int, int], ...]  # (dotted stage name, ns, count)
    messages: tuple[tuple[str, str], ...] = ()  # (level: "info" | "warning" | "error", text)
