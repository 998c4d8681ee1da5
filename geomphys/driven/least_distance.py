"""The nearest point to a goal that satisfies linear inequalities: the least-distance problem behind overlap elimination.

    minimise |x - g|²  subject to  C x >= d

solved by the dual active-set method of Goldfarb and Idnani ("A numerically stable dual method for solving strictly
convex quadratic programs", Mathematical Programming 27, 1983) with the identity as Hessian. It starts at g, so a goal
that satisfies everything comes back unchanged, bit for bit, and it recognises constraints that cannot be satisfied together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel, noinline

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SOLVED = 0
INFEASIBLE = 1

PARALLEL = 1e-12  # squared sine of the angle below which a row counts as dependent on the active ones


class LeastDistance(NamedTuple):
    """Problems of up to n unknowns and m rows, their workspace and solution."""

    rows: Floats  # (m, n) C, rows need not have unit length
    rhs: Floats  # (m,) d
    x: Floats  # (n,) the goal on entry, the solution on return
    basis: Floats  # (n, n) its first k rows are orthonormal and span the active rows
    triangle: Floats  # (n, n) upper triangular k x k
    active: Ints  # (n,) rows that hold with equality
    multiplier: Floats  # (n + 1,) of the active rows, >= 0
    projected: Floats  # (n,) basis C_p
    primal_step: Floats  # (n,) C_p less its part in the span of the active rows
    dual_step: Floats  # (n,)
    is_active: Ints  # (m,)


def make_least_distance(unknowns: int, rows: int) -> LeastDistance:
    """Arrays for problems of up to `unknowns` and `rows`."""
    n, m = unknowns, rows
    return LeastDistance(
        np.zeros((m, n)),
        np.zeros(m),
        np.zeros(n),
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros(n, np.int64),
        np.zeros(n + 1),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(m, np.int64),
    )


@kernel
def dot_of(a: Floats, b: Floats, n: int) -> float:
    """Dot product of the first `n` numbers of two arrays, in four sums that do not wait for each other."""
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for k in range(0, whole, 4):
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
    for k in range(whole, n):
        s0 += a[k] * b[k]
    return (s0 + s1) + (s2 + s3)


@kernel
def add_multiple(a: Floats, b: Floats, n: int, factor: float) -> None:
    """Add `factor` times the first `n` numbers of `b` to those of `a`."""
    for k in range(n):
        a[k] += factor * b[k]


@kernel
def _most_violated(p: LeastDistance, n: int, m: int, tolerance: float) -> int:
    """The row that is violated most, relative to its length; -1 if all are satisfied within `tolerance`."""
    worst, row = -tolerance, -1
    for i in range(m):
        if p.is_active[i] == 1:
            continue
        value = dot_of(p.rows[i], p.x, n) - p.rhs[i]
        if value < worst:
            worst, row = value, i
    return row


@kernel
def _project(p: LeastDistance, n: int, active_count: int, row: int) -> float:
    """Split row `row` into its parts in (`dual_step`: R⁻¹ d) and off (`primal_step`) the active rows; returns |off|².

    By Gram and Schmidt, twice: what rounding leaves of the active rows in the second part goes too.
    """
    off = p.primal_step
    for k in range(n):
        off[k] = p.rows[row, k]
    for j in range(active_count):
        p.projected[j] = 0.0
    for _ in range(2):
        for j in range(active_count):
            along = dot_of(p.basis[j], off, n)
            p.projected[j] += along
            add_multiple(off, p.basis[j], n, -along)
    for i in range(active_count - 1, -1, -1):
        value = p.projected[i]
        for j in range(i + 1, active_count):
            value -= p.triangle[i, j] * p.dual_step[j]
        p.dual_step[i] = value / p.triangle[i, i]
    return dot_of(off, off, n)


@kernel
def _rotate_rows(a: Floats, n: int, i: int, j: int, c: float, s: float) -> None:
    """Apply the Givens rotation (c, s) to rows i and j of `a`."""
    one, other = a[i], a[j]
    for k in range(n):
        u, v = one[k], other[k]
        one[k] = c * u + s * v
        other[k] = c * v - s * u


@kernel
def _add(p: LeastDistance, n: int, active_count: int, row: int, free: float) -> int:
    """Make `row` active: its part off the active rows, whose square is `free`, becomes the next of the basis."""
    length = math.sqrt(free)
    for k in range(n):
        p.basis[active_count, k] = p.primal_step[k] / length
    for i in range(active_count):
        p.triangle[i, active_count] = p.projected[i]
    p.triangle[active_count, active_count] = length
    p.active[active_count] = row
    p.is_active[row] = 1
    return active_count + 1


@kernel
def _drop(p: LeastDistance, n: int, active_count: int, index: int) -> int:
    """Drop the active row at `index` and restore the triangular form."""
    p.is_active[p.active[index]] = 0
    for j in range(index + 1, active_count):
        for i in range(j + 1):
            p.triangle[i, j - 1] = p.triangle[i, j]
        p.active[j - 1] = p.active[j]
        p.multiplier[j - 1] = p.multiplier[j]
    p.multiplier[active_count - 1] = p.multiplier[active_count]
    active_count -= 1
    for j in range(index, active_count):
        u, v = p.triangle[j, j], p.triangle[j + 1, j]
        length = math.hypot(u, v)
        if v == 0.0 or length == 0.0:
            continue
        c, s = u / length, v / length
        for k in range(j, active_count):
            a, b = p.triangle[j, k], p.triangle[j + 1, k]
            p.triangle[j, k] = c * a + s * b
            p.triangle[j + 1, k] = c * b - s * a
        _rotate_rows(p.basis, n, j, j + 1, c, s)
    return active_count


@kernel
def begin_least_distance(p: LeastDistance, m: int) -> None:
    """Clear the active rows."""
    for i in range(m):
        p.is_active[i] = 0


@noinline
def satisfy_rows(p: LeastDistance, n: int, m: int, tolerance: float, active_count: int) -> tuple[int, int]:
    """Continue from a solution with `count` active rows to one for the first `m` rows; see `begin_least_distance`.

    Parameters
    ----------
    p
        `rows`, `bounds` and the goal, or the solution so far, in `x`; rows should have unit length.
    n, m
        Unknowns and rows in use.
    tolerance
        How far a row may stay violated, in the unit of `bounds`.
    count
        Number of active rows.

    Returns
    -------
    tuple
        (SOLVED or INFEASIBLE, number of active rows; `p.active` and `p.multiplier` hold them).
    """
    for _ in range(10 * (n + m) + 20):
        row = _most_violated(p, n, m, tolerance)
        if row < 0:
            return SOLVED, active_count
        p.multiplier[active_count] = 0.0
        while True:
            free = _project(p, n, active_count, row)
            longest, leaving = math.inf, -1
            for j in range(active_count):
                if p.dual_step[j] > 1e-14:
                    ratio = p.multiplier[j] / p.dual_step[j]
                    if ratio < longest:
                        longest, leaving = ratio, j
            full = math.inf
            if active_count < n and free > PARALLEL:
                full = max((p.rhs[row] - dot_of(p.rows[row], p.x, n)) / free, 0.0)
            length = min(longest, full)
            if length == math.inf:
                return INFEASIBLE, active_count
            if full < math.inf:
                add_multiple(p.x, p.primal_step, n, length)
            for j in range(active_count):
                p.multiplier[j] -= length * p.dual_step[j]
            p.multiplier[active_count] += length
            if full <= longest:
                active_count = _add(p, n, active_count, row, free)
                break
            active_count = _drop(p, n, active_count, leaving)
    return INFEASIBLE, active_count
