"""Sequential quadratic programming: from a free posture to the best one that can be reached from it.

Each pass solves the problem linearised about the iterate and takes the step, or a share of it: as far as no pair overlaps
more than is tolerated and the path of every pair is certified (`advancement`). The step bound starts at 10 mm, grows
when it is reached, and is halved only when the step reverses or had to be shortened.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import measure_near, pair_separation
from geomphys.collision.support import pose_piece
from geomphys.driven.advancement import is_parted_before, passing_depth, path_is_free
from geomphys.driven.constraints import (
    ON,
    add_cones,
    add_pairs,
    bound_unknowns,
    concerns,
    forget_spots,
    request_touching,
    row_limit,
)
from geomphys.driven.contacts_kept import add_touches, measure_touches, set_touch_goals
from geomphys.driven.least_distance import SOLVED
from geomphys.driven.objective import assemble, link_centre, number_unknowns
from geomphys.driven.postures import Posture
from geomphys.driven.qp import go_on, solve_quadratic
from geomphys.driven.reachability import measure_listed_pairs
from geomphys.driven.state import LOCKED, NO_ROW, REQUESTED, RIGID, DrivenWorkspace
from geomphys.driven.stepping import (
    allowed_depth,
    apply_solution,
    copy_moving,
    gap_on_its_side,
    measure_motion,
    measure_near_pairs,
    pose_yielding_pieces,
    reverses,
    share_within_rate,
    update_separations,
)
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import norm, sub
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import orientation_of, set_pose

Floats = NDArray[np.float64]

AMPLE = 2.0  # first step bound: times the largest distance of a link from its target
SMALL_STEP = 1e-3  # m: first step bound, at least
FIRST_STEP = 0.01  # m: first step bound, at most
LEAST_STEP = 3e-4  # m: later step bounds, at least
MOST_STEP = 0.03  # m: later step bounds, at most
HALVINGS = 6  # tries of a step, each half as long
MARGIN = 2e-3  # m: extra distance of the search for pairs, so that their list serves more passes
DRAWN = 0.02  # m: distance up to which fingertips are moved to what they touched in the recording
ROUNDS = 12  # rounds of added rows in a pass
SETTLED = 2e-6  # m: a pass with less motion ends the search
SETTLED_SHIFT = 1e-8  # m: the same where trees are only translated
NEARLY = 5e-5  # m: the same after `PATIENCE` passes, unless trees are only translated
PATIENCE = 6  # passes of the least step bound without a gain end the search
GAINS = 0.999  # a pass gains if the objective ends below this times its least so far
EVERY_STEP, STRAIGHT, ANY_PATH = 0, 1, 2  # modes of certification


class Found(NamedTuple):
    """Result of a search; the posture is in `SearchWorkspace.best`."""

    free: bool  # whether a free posture was found
    passes: int
    converged: bool
    energy: float
    paced: bool  # stopped by the rate limit


@outlined
def _step_is_safe(scene: Scene, ws: DrivenWorkspace, mode: int) -> tuple[bool, float]:
    """Whether the paths of all near pairs from the iterate to the trial are certified: (whether, least separation there).

    `mode` is what is certified: as in `search`.
    """
    near, work, least = ws.near, ws.work, math.inf
    for k in range(near.counts.filled):
        if not concerns(ws, k):
            continue
        a, b, s = near.a[k], near.b[k], near.separation[k]
        motion = work.motion[a] + work.motion[b]
        if s > motion:
            least = min(least, s - motion)
            continue
        beside = gap_on_its_side(scene, ws, k, motion)
        if beside >= 0.0 and mode != STRAIGHT:
            least = min(least, beside)
            continue
        there, n, _, _ = pair_separation(
            scene.pieces, ws.piece_frames.frames, a, b, motion, ws.detection.axes, ws.detection.scratch
        )
        least = min(least, there)
        if mode == ANY_PATH:
            if there < -1e-3 and there < s - 1e-3:
                return False, least
            continue
        if there < -allowed_depth(scene, a, b) and there < 0.9 * s:
            return False, least
        short = s + there >= motion or beside > -passing_depth(scene, a, b)
        short = short or is_parted_before(
            scene, work.now.poses, work.trial.poses, a, b, n, motion, ws.piece_frames.moved
        )  # fmt: skip
        if not short and not path_is_free(
            scene, work.now.poses, work.trial.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
        ):  # fmt: skip
            return False, least
        if mode == STRAIGHT and not path_is_free(
            scene, work.before.poses, work.trial.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
        ):  # fmt: skip
            return False, least
    return True, least


@kernel
def _only_shifts(ws: DrivenWorkspace) -> bool:
    only = True
    for tree in range(len(ws.work.kind)):
        only = only and (ws.work.kind[tree] == LOCKED or ws.work.kind[tree] == RIGID)
    return only


@kernel
def _measure_at_iterate(scene: Scene, ws: DrivenWorkspace, k: int, limit: float) -> float:
    """Separation of the near pair k at the iterate [m], measured within `limit`, while pieces are posed at the trial."""
    near, moved = ws.near, ws.piece_frames.moved
    if near.exact[k] == 0:
        pose_piece(scene.pieces, ws.work.now.poses, moved, near.a[k])
        pose_piece(scene.pieces, ws.work.now.poses, moved, near.b[k])
    return measure_near(scene.pieces, moved, k, limit, near, ws.detection.axes, ws.detection.scratch)


@outlined
def _request_rows(scene: Scene, ws: DrivenWorkspace, gap: float, limit: float) -> bool:
    """Request rows for near pairs without one that overlap at the solution, or a share of it; whether there are any."""
    near, work, some = ws.near, ws.work, False
    apply_solution(scene, ws, 1.0)
    far = measure_motion(scene, ws, work.now, work.trial)
    if far > limit:
        apply_solution(scene, ws, 0.98 * limit / far)
        measure_motion(scene, ws, work.now, work.trial)
    pose_yielding_pieces(scene, ws, work.trial)
    for k in range(near.counts.filled):
        if ws.row_state[k] != NO_ROW or not concerns(ws, k):
            continue
        a, b = near.a[k], near.b[k]
        motion = work.motion[a] + work.motion[b]
        if near.separation[k] > motion:
            continue
        beside = gap_on_its_side(scene, ws, k, motion)
        if beside >= 0.25 * gap:
            continue
        there, n, _, _ = pair_separation(
            scene.pieces, ws.piece_frames.frames, a, b, motion, ws.detection.axes, ws.detection.scratch
        )
        if there >= 0.25 * gap and is_parted_before(
            scene, work.now.poses, work.trial.poses, a, b, n, motion, ws.piece_frames.moved
        ):
            continue
        s = _measure_at_iterate(scene, ws, k, motion)
        if s > motion:
            continue
        if there < 0.25 * gap or (
            s + there < motion and beside <= -passing_depth(scene, a, b) and not path_is_free(
                scene, work.now.poses, work.trial.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
            )
        ):  # fmt: skip
            ws.row_state[k], some = REQUESTED, True
    return some


@outlined
def _solve_linear(
    scene: Scene, ws: DrivenWorkspace, recorded: Floats, gap: float, step: float, touching: bool, relaxed: bool
) -> float:
    """Build and solve the quadratic problem at the iterate; returns the energy there.

    Pairs get rows once an iterate overlaps them. Rows that are infeasible together become penalty terms.
    """
    work, limit, energy = ws.work, row_limit(step), 0.0
    for attempt in range(2):
        n = number_unknowns(scene, ws)
        energy = assemble(scene, ws, work.now, not relaxed)
        if touching:
            energy += add_touches(scene, ws, work.now, n)
        bound_unknowns(scene, ws, work.now, step, attempt == 0)
        request_touching(ws)
        m = add_pairs(scene, ws, work.now, gap, 0, n, attempt == 1)
        m = add_cones(scene, ws, recorded, work.now, m, n)
        status, m, count = solve_quadratic(ws.problem, n, m)
        for _ in range(ROUNDS):
            if status != SOLVED or not _request_rows(scene, ws, gap, limit):
                break
            more = add_pairs(scene, ws, work.now, gap, m, n, False)
            status, m, count = go_on(ws.problem, n, m, more, count)
        if status == SOLVED:
            return energy
    for i in range(len(ws.problem.x)):
        ws.problem.x[i] = 0.0
    return energy


@kernel
def _first_step(scene: Scene, ws: DrivenWorkspace) -> float:
    """Initial step bound, by the distance of links from their targets, so that few pairs are within it."""
    far, work = 0.0, ws.work
    for tree in range(len(work.kind)):
        if work.kind[tree] == LOCKED:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            far = max(far, norm(sub(link_centre(ws, work.now.poses, body), vec_at(work.target, body))))
    return min(max(AMPLE * far, SMALL_STEP), FIRST_STEP)


@outlined
def _copy_targets(scene: Scene, ws: DrivenWorkspace, source: Floats, target: Floats) -> None:
    """Copy targets (B, 7) of the trees being solved."""
    for tree in range(len(ws.work.kind)):
        if ws.work.kind[tree] != LOCKED:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                for k in range(7):
                    target[body, k] = source[body, k]


@outlined
def _stay(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> None:
    """Set the targets of the links to their poses in a posture."""
    for tree in range(len(ws.work.kind)):
        if ws.work.kind[tree] != LOCKED:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                q = orientation_of(posture.poses, body)
                set_pose(ws.work.target, body, link_centre(ws, posture.poses, body), q)


@outlined
def search(
    scene: Scene,
    ws: DrivenWorkspace,
    recorded: Floats,
    gap: float,
    passes: int,
    touching: bool,
    tethered: bool,
    mode: int,
) -> Found:
    """Search from the posture in `SearchWorkspace.now`, whose pieces are posed.

    Parameters
    ----------
    scene, ws
        The scene and the workspace: `kind`: how each tree may move; `target`, `anchor`, `pace`: where to.
    recorded
        (Q,) rad, recorded angles: a limb recorded beyond its reach cone is bounded there.
    gap
        m; clearance.
    passes
        Bound on the passes.
    touching
        Whether recorded contacts have penalty terms.
    tethered
        Whether `pace` bounds how far the trees may move from `SearchWorkspace.start`.
    mode
        What is certified: EVERY_STEP; STRAIGHT: also the straight path from the start of the step; ANY_PATH:
        nothing, and the start may overlap, as there was no frame before.
    """
    work, best, relaxed = ws.work, math.inf, mode == ANY_PATH
    step = FIRST_STEP if relaxed else _first_step(scene, ws)
    found, converged, paced, done = False, False, False, False
    shifting, count, idle, listed = _only_shifts(ws), 0, 0, 0.0
    forget_spots(ws)
    _copy_targets(scene, ws, work.target, work.cached_target)
    for i in range(len(ws.problem.last_step)):
        ws.problem.last_step[i] = 0.0
    while True:
        limit, drawn = row_limit(step), touching and not paced and work.counts.touches > 0
        reach = max(limit, DRAWN) if drawn else limit
        if listed >= reach:
            least = update_separations(scene, ws, limit, ON)
        else:
            listed, known, least = reach + MARGIN, False, 0.0
            if count == 0:
                known, least = measure_listed_pairs(scene, ws, listed, ON)
            if not known:
                least = measure_near_pairs(scene, ws, listed, ON)
        if drawn:
            measure_touches(scene, ws, DRAWN)
            if count == 0:
                set_touch_goals(scene, ws)
        energy = _solve_linear(scene, ws, recorded, gap, step, drawn, relaxed or paced)
        idle = idle + 1 if least >= 0.0 and energy > GAINS * best else 0
        if least >= 0.0 and (energy < best or done or paced):
            found, best = True, energy
            copy_moving(scene, ws, work.now, work.best)
        if done or count == min(passes, work.passes):
            break
        if idle >= PATIENCE and step == LEAST_STEP:
            converged = True
            break
        count += 1
        share, safe, there, far, stopped = 1.0, False, 0.0, 0.0, False
        for _ in range(HALVINGS):
            apply_solution(scene, ws, share)
            far = measure_motion(scene, ws, work.now, work.trial)
            if far > limit:
                share *= 0.98 * limit / far
                continue
            left = 1.0 if relaxed or paced else share_within_rate(scene, ws, tethered)
            stopped = left < 1.0
            if stopped:
                share *= left * 0.999
                apply_solution(scene, ws, share)
                far = measure_motion(scene, ws, work.now, work.trial)
            pose_yielding_pieces(scene, ws, work.trial)
            safe, there = _step_is_safe(scene, ws, mode)
            if safe:
                break
            share *= 0.5
        if not safe:
            converged = least >= 0.0
            break
        listed -= far
        back = reverses(scene, ws, share)
        copy_moving(scene, ws, work.trial, work.now)
        if stopped:
            paced = True
            _stay(scene, ws, work.now)
        if (share < 1.0 and not stopped) or back:
            step = max(0.5 * step, LEAST_STEP)
        elif far > 0.5 * step:
            step = min(1.5 * step, MOST_STEP)
        settled = far < (SETTLED_SHIFT if shifting else SETTLED) or (
            count >= PATIENCE and far < NEARLY and not shifting
        )
        if there >= 0.0 and (settled or paced):
            converged, done = True, True
    _copy_targets(scene, ws, work.cached_target, work.target)
    return Found(found, count, converged, best, paced)
