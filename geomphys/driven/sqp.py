"""Sequential quadratic programming: from a free posture to the best one that can be reached from it.

Each pass solves the problem linearised about the iterate and takes the step, or a part of it: as far as no pair overlaps
more than is tolerated and the path of every pair is certified (`advancement`). The trust region starts at 10 mm, grows
when it is reached, and is halved only when the step reverses or had to be shortened. Passes converge linearly, as the curvature
of constraints is not in the problem; where they do so slowly, steps are extrapolated to the limit of their geometric series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import approximate_separation, measure_near, separation_bound
from geomphys.driven.advancement import is_separated_on_path, path_is_free, path_tolerance
from geomphys.driven.constraints import (
    CONTACT_DISTANCE,
    add_cones,
    add_pairs,
    bound_unknowns,
    clear_spots,
    is_unlocked_pair,
    number_unknowns,
    request_pairs_in_contact,
    row_limit,
    set_cone_limits,
)
from geomphys.driven.contacts_kept import add_touches, list_touches, measure_touches, set_touch_goals
from geomphys.driven.least_distance import SOLVED
from geomphys.driven.objective import assemble, link_centre
from geomphys.driven.qp import resume_quadratic, solve_quadratic
from geomphys.driven.reachability import measure_listed_pairs, straight_path_is_free
from geomphys.driven.state import LOCKED, NO_ROW, REQUESTED, DrivenWorkspace
from geomphys.driven.stepping import (
    allowed_depth,
    apply_solution,
    compare_steps,
    copy_frames,
    copy_targets,
    copy_unlocked,
    gap_along_normal,
    is_within,
    measure_motion,
    measure_near_pairs,
    only_translations_allowed,
    pair_travel,
    pose_unlocked_pieces,
    set_targets_to,
    some_joints,
    step_length_within_rate,
    update_separations,
)
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import Vec, norm, sub
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]

RADIUS_FACTOR = 2.0  # first trust radius: times the largest distance of a link from its target
SMALL_RADIUS = 1e-3  # m: first trust radius, at least
FIRST_RADIUS = 0.01  # m: first trust radius, at most
MIN_RADIUS = 3e-4  # m: later trust radii, at least
MAX_RADIUS = 0.03  # m: later trust radii, at most
HALVINGS = 6  # tries of a step, each half as long
MARGIN = 2e-3  # m: extra distance of the search for pairs, so that their list serves more iterations
ATTRACTION_DISTANCE = 0.02  # m: distance up to which fingertips are moved to what they touched in the recording
TOUCH_MARGIN = 5e-3  # m: extra distance of the search for those
ROUNDS = 12  # rounds of added rows in an iteration
CONVERGED_MOTION = 2e-6  # m: an iteration with less motion ends the search
CONVERGED_TRANSLATION = 1e-8  # m: the same where trees are only translated
NEARLY_CONVERGED_MOTION = 5e-5  # m: the same for an extrapolated step or
SETTLED = 3  # after so many iterations, unless trees are only translated
REVERSED = -0.3  # cosine of a step and the last one: it goes back
EXTRAPOLATED_MOTION = 5e-4  # m: where a step was shorter, the next one may be extrapolated, if
ALIGNED = 0.95  # the cosine of their angle and
SLOW = 0.25  # their ratio are more than this,
MAX_RATE = 0.75  # by that ratio, but by no more than this
PATIENCE = 6  # iterations of the least trust radius without a gain end the search
RELATIVE_GAIN = 0.999  # an iteration gains if the objective ends below this times its least so far
EVERY_STEP, STRAIGHT, ANY_PATH = 0, 1, 2  # modes of certification


class Linear(NamedTuple):
    """Result of a linearised problem."""

    cost: float  # at the iterate
    is_solved: bool  # if not, no step is made
    step_length: float  # of the trial
    far: float  # m, motion of the trial; below 0: it is not posed


class Found(NamedTuple):
    """Result of a search; the posture is in `SearchWorkspace.best`."""

    free: bool  # whether a free posture was found
    iterations: int
    converged: bool
    rate_limited: bool  # stopped by the rate limit


@noinline
def _step_is_safe(scene: Scene, ws: DrivenWorkspace, mode: int, far: float, is_known: bool) -> tuple[bool, float]:
    """Whether the paths of all near pairs from the iterate to the trial, `far` [m] at most, are certified.

    `mode` is what is certified: as in `search`; `is_known`: `_request_rows` certified the steps of pairs without a row. Returns
    (whether, least separation at the trial of those that may have met). Those are measured, into `DrivenWorkspace.at_trial`.
    """
    near, at_trial, work, least = ws.near, ws.at_trial, ws.work, math.inf
    is_known = is_known and mode != STRAIGHT
    for k in range(near.counts.filled):
        s, at_trial.exact[k] = near.separation[k], 0
        if s > 2.0 * far or (is_known and ws.row_state[k] == NO_ROW) or not is_unlocked_pair(ws, k):
            continue
        a, b = near.a[k], near.b[k]
        motion = pair_travel(work.motion, a, b)
        if s > motion:
            continue
        gap_at_trial = gap_along_normal(scene, ws, k, motion)
        if gap_at_trial >= 0.0 and mode != STRAIGHT:
            least = min(least, gap_at_trial)
            continue
        at_trial.a[k], at_trial.b[k] = a, b
        trial_separation = measure_near(
            scene.pieces, ws.piece_frames.frames, k, motion, at_trial, ws.detection.axes, ws.detection.scratch
        )
        n = vec_at(at_trial.normal, k)
        least = min(least, trial_separation)
        if mode == ANY_PATH:
            if trial_separation < -1e-3 and trial_separation < s - 1e-3:
                return False, least
            continue
        if trial_separation < -allowed_depth(scene, a, b) and trial_separation < 0.9 * s:
            return False, least
        short = s + trial_separation >= motion or gap_at_trial > -path_tolerance(scene, a, b)
        short = short or is_separated_on_path(
            scene, work.iterate.poses, work.trial.poses, a, b, (trial_separation, n), motion, ws.piece_frames.iterate
        )  # fmt: skip
        if not short and not path_is_free(
            scene, work.iterate.poses, work.trial.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
        ):  # fmt: skip
            return False, least
        if mode == STRAIGHT and not straight_path_is_free(scene, ws, a, b, (trial_separation, n)):
            return False, least
    return True, least


@kernel
def _is_certified(
    scene: Scene, ws: DrivenWorkspace, k: int, gap_at_trial: float, separation: float, n: Vec, motion: float
) -> bool:
    """Whether near pair k, at least `separation` [m] apart along `n` at the trial, has not overlapped on its path there.

    `gap_at_trial`: see `gap_along_normal`; `motion` [m]: how far its surfaces move.
    """
    a, b, work = ws.near.a[k], ws.near.b[k], ws.work
    if gap_at_trial > -path_tolerance(scene, a, b) or ws.near.separation[k] + separation >= motion:
        return True
    return is_separated_on_path(
        scene, work.iterate.poses, work.trial.poses, a, b, (separation, n), motion, ws.piece_frames.iterate
    )


@noinline
def _request_rows(scene: Scene, ws: DrivenWorkspace, gap: float, limit: float) -> tuple[bool, float, float]:
    """Request rows for near pairs without one that overlap at the solution, or at the part of it within `limit` [m].

    That is the trial then. Returns (whether there are any, step length, largest motion [m]).
    """
    near, work, some, step_length = ws.near, ws.work, False, 1.0
    apply_solution(scene, ws, 1.0)
    far = measure_motion(scene, ws, work.iterate, work.trial)
    if far > limit:
        step_length = 0.98 * limit / far
        apply_solution(scene, ws, step_length)
        far = measure_motion(scene, ws, work.iterate, work.trial)
    pose_unlocked_pieces(scene, ws, work.trial)
    for k in range(near.counts.filled):
        if near.separation[k] > 2.0 * far or ws.row_state[k] != NO_ROW or not is_unlocked_pair(ws, k):
            continue
        a, b = near.a[k], near.b[k]
        motion = pair_travel(work.motion, a, b)
        if near.separation[k] > motion:
            continue
        gap_at_trial = gap_along_normal(scene, ws, k, motion)
        if gap_at_trial >= 0.25 * gap:
            continue
        bound, n = separation_bound(scene.pieces, ws.piece_frames.frames, a, b, ws.detection.axes)
        if bound >= 0.25 * gap and _is_certified(scene, ws, k, gap_at_trial, bound, n, motion):
            continue
        trial_separation, n = approximate_separation(
            scene.pieces, ws.piece_frames.frames, a, b, motion, ws.detection.axes, ws.detection.scratch
        )
        if trial_separation >= 0.25 * gap and _is_certified(scene, ws, k, gap_at_trial, trial_separation, n, motion):
            continue
        s = measure_near(
            scene.pieces, ws.piece_frames.iterate, k, motion, near, ws.detection.axes, ws.detection.scratch
        )
        if s > motion:
            continue
        if trial_separation < 0.25 * gap or (
            s + trial_separation < motion and not path_is_free(
                scene, work.iterate.poses, work.trial.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
            )
        ):  # fmt: skip
            ws.row_state[k], some = REQUESTED, True
    return some, step_length, far


@noinline
def _solve_linear(
    scene: Scene,
    ws: DrivenWorkspace,
    gap: float,
    trust_radius: float,
    limit: float,
    attracted: bool,
    relaxed: bool,
) -> Linear:
    """Build and solve the quadratic problem at the iterate, for a step in which no piece moves by more than `limit` [m].

    Pairs get rows once an iterate overlaps them. Rows that are infeasible together become penalty terms.
    """
    work, cost, step_length, far = ws.work, 0.0, 1.0, -1.0
    for attempt in range(2):
        n = number_unknowns(scene, ws)
        cost = assemble(scene, ws, work.iterate, not relaxed)
        if attracted:
            cost += add_touches(scene, ws, work.iterate, n)
        bound_unknowns(scene, ws, work.iterate, trust_radius, attempt == 0)
        request_pairs_in_contact(ws)
        m = add_pairs(scene, ws, work.iterate, gap, 0, n, attempt == 1)
        m = add_cones(scene, ws, work.iterate, m, n)
        status, m, active_count = solve_quadratic(ws.problem, n, m)
        for _ in range(ROUNDS):
            if status != SOLVED:
                break
            some, step_length, far = _request_rows(scene, ws, gap, limit)
            if not some:
                break
            far = -1.0
            more = add_pairs(scene, ws, work.iterate, gap, m, n, False)
            status, m, active_count = resume_quadratic(ws.problem, n, m, more, active_count)
        if status == SOLVED:
            return Linear(cost, True, step_length, far)
    for i in range(len(ws.problem.x)):
        ws.problem.x[i] = 0.0
    return Linear(cost, False, 1.0, -1.0)


@kernel
def _first_radius(scene: Scene, ws: DrivenWorkspace) -> float:
    """Initial trust radius, by the distance of links from their targets, so that few pairs are within it."""
    far, work = 0.0, ws.work
    for tree in range(len(work.mobility)):
        if work.mobility[tree] == LOCKED:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            far = max(far, norm(sub(link_centre(ws, work.iterate.poses, body), vec_at(work.target, body))))
    return min(max(RADIUS_FACTOR * far, SMALL_RADIUS), FIRST_RADIUS)


@noinline
def search(
    scene: Scene,
    ws: DrivenWorkspace,
    recorded: Floats,
    gap: float,
    iterations: int,
    keep_contacts: bool,
    mode: int,
) -> Found:
    """Search from the posture in `SearchWorkspace.iterate`, whose pieces are posed.

    Parameters
    ----------
    scene, ws
        The scene and the workspace: `mobility`: how each tree may move; `target`, `anchor`, `deviation_limit`: where to.
    recorded
        (Q,) rad, recorded angles: a limb recorded beyond its reach cone is bounded there.
    gap
        m; clearance.
    iterations
        Bound on the iterations.
    keep_contacts
        Whether recorded contacts have penalty terms.
    mode
        What is certified: EVERY_STEP; STRAIGHT: also the straight path from the start of the step; ANY_PATH:
        nothing, and the start may overlap, as there was no frame before.
    """
    work, best, relaxed = ws.work, math.inf, mode == ANY_PATH
    trust_radius = FIRST_RADIUS if relaxed else _first_radius(scene, ws)
    found, converged, rate_limited = False, False, False
    only_translations, iteration, idle, listed, listed_touches = only_translations_allowed(ws), 0, 0, 0.0, 0.0
    last_far, moved, stretched, jointed = 0.0, 0.0, False, some_joints(scene, ws)
    clear_spots(ws)
    set_cone_limits(scene, ws, recorded)
    copy_targets(scene, ws, work.target, work.cached_target)
    copy_frames(scene, ws, False)
    for i in range(len(ws.problem.last_step)):
        ws.problem.last_step[i] = 0.0
    while True:
        limit, attracted = row_limit(trust_radius), keep_contacts and not rate_limited and work.counts.touches > 0
        if iteration > 0 and listed >= row_limit(moved):  # a step is hardly much longer than the last
            limit = min(limit, listed)
        if listed >= limit and (listed_touches >= ATTRACTION_DISTANCE or not attracted):
            least = update_separations(scene, ws, limit, CONTACT_DISTANCE)
        else:
            listed = limit + MARGIN
            known, least = measure_listed_pairs(scene, ws, listed, CONTACT_DISTANCE)
            if not known:
                least = measure_near_pairs(scene, ws, listed, CONTACT_DISTANCE)
            if attracted:
                listed_touches = ATTRACTION_DISTANCE + TOUCH_MARGIN
                list_touches(scene, ws, listed_touches)
        if attracted:
            measure_touches(scene, ws, ATTRACTION_DISTANCE)
            if iteration == 0:
                set_touch_goals(scene, ws)
        linear = _solve_linear(scene, ws, gap, trust_radius, limit, attracted, relaxed or rate_limited)
        cost = linear.cost
        idle = idle + 1 if least >= 0.0 and cost > RELATIVE_GAIN * best else 0
        if least >= 0.0 and (cost < best or rate_limited):
            found, best = True, cost
            copy_unlocked(scene, ws, work.iterate, work.best)
        if not linear.is_solved or iteration == min(iterations, work.iterations):
            break
        if idle >= PATIENCE and trust_radius == MIN_RADIUS:
            converged = True
            break
        iteration += 1
        step_length, safe, trial_separation, far, stopped = 1.0, False, 0.0, 0.0, False
        cosine, rate = compare_steps(scene, ws)
        converges_slowly = last_far < EXTRAPOLATED_MOTION and cosine > ALIGNED and rate > SLOW
        if converges_slowly and not (stretched or only_translations or relaxed or rate_limited):
            step_length = 1.0 / (1.0 - min(rate, MAX_RATE))
        is_posed = linear.far >= 0.0 and step_length == 1.0
        for _ in range(HALVINGS):
            if is_posed:
                step_length, far = linear.step_length, linear.far
            else:
                apply_solution(scene, ws, step_length)
                far = measure_motion(scene, ws, work.iterate, work.trial)
            if far > limit:
                step_length *= 0.98 * limit / far
                is_posed = False
                continue
            limited_length = 1.0 if relaxed or rate_limited else step_length_within_rate(scene, ws)
            stopped = limited_length < 1.0
            if stopped:
                step_length *= limited_length * 0.999
                apply_solution(scene, ws, step_length)
                far = measure_motion(scene, ws, work.iterate, work.trial)
                is_posed = False
            if not is_posed:
                pose_unlocked_pieces(scene, ws, work.trial)
            safe, trial_separation = _step_is_safe(scene, ws, mode, far, is_posed)
            if safe:
                break
            step_length *= 0.5
            is_posed = False
        if not safe:
            converged = least >= 0.0
            break
        listed, listed_touches, moved = listed - far, listed_touches - far, far
        copy_unlocked(scene, ws, work.trial, work.iterate)
        copy_frames(scene, ws, True)
        if stopped:
            rate_limited = True
            set_targets_to(scene, ws, work.iterate)
        if (step_length < 1.0 and not stopped) or cosine < REVERSED:
            trust_radius = max(0.5 * trust_radius, MIN_RADIUS)
        elif far > 0.5 * trust_radius:
            trust_radius = min(1.5 * trust_radius, MAX_RADIUS)
        stretched = step_length > 1.0
        if only_translations:
            has_converged = far < CONVERGED_TRANSLATION
        else:
            nearly = far < NEARLY_CONVERGED_MOTION * max(step_length, 1.0)
            settled = stretched or iteration >= (SETTLED if jointed else PATIENCE)
            has_converged = is_within(CONVERGED_MOTION, far, last_far if jointed else 0.0) or (nearly and settled)
        last_far = 0.0 if stretched else far
        if trial_separation >= 0.0 and (has_converged or rate_limited):
            found, converged = True, True
            copy_unlocked(scene, ws, work.iterate, work.best)
            break
    copy_targets(scene, ws, work.cached_target, work.target)
    return Found(found, iteration, converged, rate_limited)
