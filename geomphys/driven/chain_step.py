"""Chains in a step: where the coupling pulls the joints, how they yield, and what is remembered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes
from geomphys.driven.chain_loop import free_chains
from geomphys.driven.chain_room import is_chained
from geomphys.driven.chains import CHAINS, EVERYTHING, FREE, WITH_ROOT, bend_chains, fit_to_cones, hold_posture
from geomphys.driven.coupling import relax
from geomphys.driven.overlap import INTERPOLATED, LEAST_DISTANCE
from geomphys.driven.posture import lower_bend, upper_bend
from geomphys.driven.state import DrivenRoom, DrivenState
from geomphys.kernel import kernel, outlined
from geomphys.world.scene import Scene

Floats = NDArray[np.float64]


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
            goal, posture.speed[q] = relax(
                posture.bend[q], posture.speed[q], trees.mass[tree], trees.stiffness[tree], trees.damping[tree], dt
            )
            lower, upper = lower_bend(scene, angles, q), upper_bend(scene, angles, q)
            chains.goal[q] = min(max(goal, lower), upper)
            chains.current[q] = min(max(chains.current[q], lower), upper)
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
def yield_chains(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, gap: float, axes: Axes,
    scratch: Scratch,
) -> tuple[int, int, bool]:  # fmt: skip
    """Chains yield, then roots too, then all joints; else a posture is held: (passes, method, whether chains sufficed).

    The method is INTERPOLATED where one is held.
    """
    p, chains, passes, status = room.places, room.chains, 0, FREE
    for attempt in range(4):
        if attempt == 1:
            status, more = _descend(scene, state, room, boxes, roots, angles, gap, axes, scratch)
        else:
            what = CHAINS if attempt == 0 else (WITH_ROOT if attempt == 2 else EVERYTHING)
            status, more = _search(scene, room, boxes, roots, angles, gap, what, axes, scratch)
        passes += more
        if status == FREE:
            for tree in range(len(p.column)):
                if is_chained(scene, tree):
                    for i in range(3):
                        p.current[tree, i] = p.trial[tree, i]
            return passes, 0 if passes == 1 else LEAST_DISTANCE, attempt < 2
    for q in range(len(angles)):
        chains.spare[q] = state.angles[q] + state.posture.bend[q]
    hold_posture(
        scene, room.origins, room.joints, chains, p, boxes, room.near, roots, angles, chains.spare, gap, axes, scratch
    )  # fmt: skip
    return passes, INTERPOLATED, False
