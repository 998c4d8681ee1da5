"""Chains in a step: where the coupling pulls the joints, how they yield, and what is remembered."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, find_near
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.chain_loop import free_chains
from geomphys.driven.chain_room import is_chained
from geomphys.driven.chains import (
    CHAINS,
    EVERYTHING,
    FREE,
    WITH_ROOT,
    bend_chains,
    fit_to_cones,
    hold_posture,
    place_posture,
)
from geomphys.driven.coupling import relax_offset
from geomphys.driven.escape import DEEPER, PASSED
from geomphys.driven.overlap import INTERPOLATED, LEAST_DISTANCE
from geomphys.driven.pace import excused_change
from geomphys.driven.posture import lower_bend, upper_bend
from geomphys.driven.state import DrivenRoom, DrivenState
from geomphys.jit.kernel import kernel, outlined
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]

# attempts to come free, in their order; the first two without a jump
PACED_CHAINS, PACED_ROOTS, LONE_CHAINS, DESCENT, ROOTS, ALL = range(6)
SWING_SHARE = 1.9  # times the recorded change of an angle, and
PLACES = 16  # on the way to a posture that are looked at
SWING = 0.028  # rad, or m along the axis of a prismatic joint: more than this in a frame is a jump


@kernel
def pull_joints(scene: Scene, state: DrivenState, room: DrivenRoom, angles: Floats, dt: float) -> None:
    """Goal and present offset of every joint of an avatar with chains from the angle recorded now.

    Both are within the joints' limits and the limbs' reach cones.
    """
    trees, posture, chains = scene.trees, state.posture, room.chains
    for q in range(len(angles)):
        room.before[q], room.after[q] = state.angles[q], angles[q]
        if room.joints.held[q] == 0:
            continue
        tree = scene.dofs.tree[q]
        chains.goal[q] = chains.current[q] = 0.0
        if state.started[0] == 1:
            chains.current[q] = posture.bend[q] + (state.angles[q] - angles[q])
            goal, posture.speed[q] = relax_offset(trees, tree, posture.bend[q], posture.speed[q], dt)
            lower, upper = lower_bend(scene, angles, q), upper_bend(scene, angles, q)
            chains.goal[q] = min(max(goal, lower), upper)
            chains.current[q] = min(max(chains.current[q], lower), upper)
            chains.swing[q] = SWING_SHARE * abs(angles[q] - state.angles[q]) + SWING * room.share[0]
        room.before[q] = state.angles[q] + posture.bend[q]
    fit_to_cones(scene, room.joints, chains, angles, chains.goal)
    fit_to_cones(scene, room.joints, chains, angles, chains.current)
    for q in range(len(angles)):
        if room.joints.held[q] == 1:
            room.after[q] = angles[q] + chains.goal[q]


@kernel
def brake_joints(state: DrivenState, room: DrivenRoom) -> None:
    """After a contact the joints' offsets have no speed left against what was met; the offsets are remembered."""
    for q in range(len(room.joints.yields)):
        if room.joints.held[q] == 0:
            continue
        push = room.chains.trial[q] - room.chains.goal[q]
        if push * state.posture.speed[q] < 0.0:
            state.posture.speed[q] = 0.0
        state.posture.bend[q] = room.chains.trial[q]


@kernel
def _bound_offsets(scene: Scene, state: DrivenState, room: DrivenRoom, angles: Floats, dt: float, paced: bool) -> None:
    """Bounds of the search: the joints' limits and, if `paced`, how fast offsets of joints and roots may change.

    What the spring takes back of a joint's offset is no jump.
    """
    p, chains = room.places, room.chains
    for q in range(len(angles)):
        if room.joints.held[q] == 0:
            continue
        low, high = lower_bend(scene, angles, q), upper_bend(scene, angles, q)
        if paced:
            low = min(max(low, state.posture.bend[q] - chains.swing[q]), chains.goal[q])
            high = max(min(high, state.posture.bend[q] + chains.swing[q]), chains.goal[q])
        chains.low[q], chains.high[q] = low, high
    for tree in range(len(scene.trees.role)):
        if not is_chained(scene, tree):
            continue
        far = math.inf
        if paced:
            far = excused_change(scene, state, p, tree, dt)[0] / math.sqrt(3.0)
        for i in range(3):
            chains.root_low[tree, i] = min(state.offset[tree, i] - far, p.current[tree, i])
            chains.root_high[tree, i] = max(state.offset[tree, i] + far, p.current[tree, i])


@kernel
def _search(
    scene: Scene, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, gap: float, what: int, axes: Axes,
    scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """`bend_chains` from the posture in `room.chains.current`: (FREE or STUCK, passes)."""
    return bend_chains(
        scene, room.origins, room.joints, room.chains, room.places, boxes, room.near, room.problem, roots, angles, gap, what,
        axes, scratch,
    )  # fmt: skip


@kernel
def _descend(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, gap: float, axes: Axes,
    scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """A free posture by descent of one chain after the other, and the nearest one from there: (FREE or STUCK, passes)."""
    chains = room.chains
    status, passes = free_chains(
        scene, room.origins, room.joints, room.ccd, chains, room.places, boxes, room.near, roots, angles, chains.goal, gap,
        room.seed[0], state.steps[0], axes, scratch,
    )  # fmt: skip
    if status != FREE:
        return status, passes
    for q in range(len(chains.trial)):
        chains.spare[q], chains.current[q] = chains.current[q], chains.trial[q]
    status, more = _search(scene, room, boxes, roots, angles, gap, CHAINS, axes, scratch)
    for q in range(len(chains.trial)):
        chains.current[q] = chains.spare[q]
    return status, passes + more


@outlined
def _leads_through(
    scene: Scene, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, axes: Axes, scratch: Scratch
) -> bool:
    """Whether the way of all joints and roots at once from where they were to the posture found leads through something.

    Through something is what is in it by more than half the thickness, and deeper than at the way's start.
    """
    p, chains, near = room.places, room.chains, room.near
    most, found = PASSED, False
    for tree in range(len(p.reach)):
        p.reach[tree, 0] = p.reach[tree, 1] = 0.0
        for i in range(3):
            room.ahead[tree, i] = p.trial[tree, i]
    for q in range(len(chains.trial)):
        chains.spare[q] = chains.trial[q]
    for place in range(PLACES + 1):
        w = place / PLACES
        for q in range(len(chains.trial)):
            chains.trial[q] = chains.current[q] + w * (chains.spare[q] - chains.current[q])
        for tree in range(len(p.reach)):
            for i in range(3):
                p.trial[tree, i] = p.current[tree, i] + w * (room.ahead[tree, i] - p.current[tree, i])
        if place == PLACES:
            for q in range(len(chains.trial)):
                chains.trial[q] = chains.spare[q]
            for tree in range(len(p.reach)):
                for i in range(3):
                    p.trial[tree, i] = room.ahead[tree, i]
        place_posture(scene, room.origins, room.joints, roots, angles, chains.trial, p.trial, chains, p, boxes)
        if found or place == PLACES:
            continue
        find_near(scene, p.frames, boxes, p.reach, 0.0, math.inf, near, p.found, axes, scratch)
        for k in range(near.filled[0]):
            mean = 0.5 * (scene.pieces.thickness[near.a[k]] + scene.pieces.thickness[near.b[k]])
            share = -near.separation[k] / max(mean, 1e-6)
            if place == 0:
                most = max(most, DEEPER * share)
            found = found or share > most
    return found


@outlined
def yield_chains(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, dt: float, gap: float,
    axes: Axes, scratch: Scratch,
) -> tuple[int, int, bool]:  # fmt: skip
    """Chains yield, then roots too, as far as that is no jump; else chains, roots too, all joints, however far.

    What none of it frees is held in its last posture.

    Returns
    -------
    tuple
        (passes, method, INTERPOLATED where a posture is held, whether chains sufficed).
    """
    p, chains, passes, status = room.places, room.chains, 0, FREE
    for tree in range(len(p.column)):  # of the chained ones each posture updates them
        if scene.trees.role[tree] == DRIVEN and not is_chained(scene, tree):
            update_boxes(scene, p.frames, boxes, tree)
    for attempt in range(PACED_CHAINS if state.started[0] == 1 else LONE_CHAINS, ALL + 1):
        if attempt in (PACED_CHAINS, LONE_CHAINS):
            _bound_offsets(scene, state, room, angles, dt, attempt == PACED_CHAINS)
        if attempt == DESCENT:
            status, more = _descend(scene, state, room, boxes, roots, angles, gap, axes, scratch)
        else:
            what = WITH_ROOT if attempt in (PACED_ROOTS, ROOTS) else (EVERYTHING if attempt == ALL else CHAINS)
            status, more = _search(scene, room, boxes, roots, angles, gap, what, axes, scratch)
        passes += more
        far = status == FREE and attempt >= LONE_CHAINS and state.started[0] == 1
        if far and _leads_through(scene, room, boxes, roots, angles, axes, scratch):
            continue
        if status == FREE:
            for tree in range(len(p.column)):
                if is_chained(scene, tree):
                    for i in range(3):
                        p.current[tree, i] = p.trial[tree, i]
            return passes, 0 if passes == 1 else LEAST_DISTANCE, attempt in (PACED_CHAINS, LONE_CHAINS, DESCENT)
    for q in range(len(angles)):
        chains.spare[q] = state.angles[q] + state.posture.bend[q]
        if state.started[0] == 0:  # the zero posture, as near as the limits let it
            chains.spare[q] = min(max(chains.spare[q], scene.dofs.lower[q]), scene.dofs.upper[q])
    hold_posture(
        scene, room.origins, room.joints, chains, p, boxes, room.near, roots, angles, chains.spare, gap, axes, scratch
    )  # fmt: skip
    return passes, INTERPOLATED, False
