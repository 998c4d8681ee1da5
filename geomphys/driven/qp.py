"""Small dense quadratic programs: nearest in a metric, within half-spaces and bounds.

    minimise ½ x'Hx + g'x  subject to  C x >= d,  low <= x <= high

With H = L'L and y = L x this is the nearest point to -L'⁻¹g within half-spaces, which the dual method of Goldfarb and Idnani
finds (`least_distance`). Unknowns are eliminated from the last to the first, from the tips of chains to their root, so L is
zero where H is between joints of different chains (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.5). Bounds low
and high are made rows only once they are violated: the method continues from its present solution. `LeastDistance.rhs` are the
right-hand sides d.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.least_distance import (
    INFEASIBLE,
    SOLVED,
    LeastDistance,
    add_multiple,
    dot_of,
    make_least_distance,
    satisfy_rows,
)
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE = 1e-11  # of a row of unit length in the metric
WEAK = 1e-9  # length in the metric below which a row is independent of the unknowns
BOUND_TOLERANCE = 1e-10  # of an unknown


QUADRATIC_COUNTS = np.dtype(
    [
        ("lost", np.int64),  # how often a row found the table full since it was last set to 0
    ]
)
"""Counts of a quadratic program."""


class Quadratic(NamedTuple):
    """Problems of up to n unknowns and m rows, their workspace and solution."""

    hessian: Floats  # (n, n) its lower triangle
    gradient: Floats  # (n,)
    factor: Floats  # (n, n) L, lower triangular
    low: Floats  # (n,)
    high: Floats  # (n,)
    x: Floats  # (n,) the solution
    last_step: Floats  # (n,) m: the last step; of a root's rotation times 0.1 m, of a joint times its lever
    least: LeastDistance  # its `rows` and `rhs` are C and d on entry
    counts: Record  # QUADRATIC_COUNTS


def make_quadratic(unknowns: int, rows: int) -> Quadratic:
    """Arrays for problems of up to `unknowns` and `rows`."""
    return Quadratic(
        hessian=np.zeros((unknowns, unknowns)),
        gradient=np.zeros(unknowns),
        factor=np.zeros((unknowns, unknowns)),
        low=np.zeros(unknowns),
        high=np.zeros(unknowns),
        x=np.zeros(unknowns),
        last_step=np.zeros(unknowns),
        least=make_least_distance(unknowns, rows),
        counts=np.zeros((), QUADRATIC_COUNTS),
    )


@kernel
def has_row(p: Quadratic, m: int) -> bool:
    """Whether the table has a row m; if not, counts it as lost."""
    if m < len(p.least.rhs):
        return True
    p.counts.lost += 1
    return False


@noinline
def _factorise(p: Quadratic, n: int) -> bool:
    """Cholesky factor of the Hessian; False if it is not positive definite."""
    f = p.factor
    for i in range(n):
        for j in range(i + 1):
            f[i, j] = p.hessian[i, j]
    for k in range(n - 1, -1, -1):
        row = f[k]
        if not row[k] > 0.0:
            return False
        row[k] = diagonal = math.sqrt(row[k])
        for j in range(k):
            row[j] /= diagonal
        for i in range(k):
            if row[i] != 0.0:
                add_multiple(f[i], row, i + 1, -row[i])
    return True


@kernel
def _to_metric(p: Quadratic, n: int, row: Floats) -> None:
    """Replace a row by L'⁻¹ row; its numbers from the `n`-th on are zero."""
    for i in range(n - 1, -1, -1):
        if row[i] != 0.0:
            row[i] /= p.factor[i, i]
            add_multiple(row, p.factor[i], i, -row[i])


@kernel
def _normalise(p: Quadratic, n: int, i: int) -> bool:
    """Make row i one of unit length; False if no unknown can satisfy it."""
    row = p.least.rows[i]
    length = math.sqrt(dot_of(row, row, n))
    if length < WEAK:
        lacks = p.least.rhs[i] > 0.0
        for k in range(n):
            row[k] = 0.0
        p.least.rhs[i] = -1.0
        return not lacks
    for k in range(n):
        row[k] /= length
    p.least.rhs[i] /= length
    return True


@kernel
def _read_solution(p: Quadratic, n: int) -> None:
    """Solution x = L⁻¹ y."""
    for i in range(n):
        p.x[i] = (p.least.x[i] - dot_of(p.factor[i], p.x, i)) / p.factor[i, i]


@kernel
def _add_bounds(p: Quadratic, n: int, m: int) -> int:
    """Rows for low and high where the solution violates them; returns the number of rows.

    Where the table of rows is full there are none for the others, and `resume_quadratic` clamps their unknowns.
    """
    for j in range(n):
        sign, limit = 0.0, 0.0
        if p.x[j] < p.low[j] - BOUND_TOLERANCE:
            sign, limit = 1.0, p.low[j]
        elif p.x[j] > p.high[j] + BOUND_TOLERANCE:
            sign, limit = -1.0, -p.high[j]
        if sign == 0.0 or not has_row(p, m):
            continue
        row = p.least.rows[m]
        for k in range(n):
            row[k] = 0.0
        row[j] = sign
        p.least.rhs[m] = limit
        p.least.is_active[m] = 0
        _to_metric(p, j + 1, row)
        _normalise(p, n, m)
        m += 1
    return m


@noinline
def resume_quadratic(p: Quadratic, n: int, first: int, m: int, active_count: int) -> tuple[int, int, int]:
    """Add rows `first` to `m`, as they were written, to a solution with `count` active rows, and resume the dual method.

    At the end unknowns are clamped to low and high: by rounding, unless the table of rows was full or rows are infeasible
    together; then other rows may be violated by that, which the caller finds when it measures the pairs.

    Returns
    -------
    tuple
        (SOLVED or INFEASIBLE, rows with those for bounds, active rows); where rows are infeasible together `p.x` satisfies those
        added so far, within bounds.
    """
    status = SOLVED
    for i in range(first, m):
        p.least.is_active[i] = 0
        _to_metric(p, n, p.least.rows[i])
        if not _normalise(p, n, i):
            status = INFEASIBLE
    for _ in range(2 * n + 2):
        found, active_count = satisfy_rows(p.least, n, m, TOLERANCE, active_count)
        _read_solution(p, n)
        if found != SOLVED:
            status = found
            break
        more = _add_bounds(p, n, m)
        if more == m:
            break
        m = more
    for j in range(n):
        p.x[j] = min(max(p.x[j], p.low[j]), p.high[j])
    return status, m, active_count


@noinline
def solve_quadratic(p: Quadratic, n: int, m: int) -> tuple[int, int, int]:
    """Solve with the first `n` unknowns and `m` rows of `p.least`; the solution is in `p.x`. Returns as `resume_quadratic`."""
    if not _factorise(p, n):
        for j in range(n):
            p.x[j] = 0.0
        return INFEASIBLE, m, 0
    for k in range(n):
        p.least.x[k] = -p.gradient[k]
    _to_metric(p, n, p.least.x)
    return resume_quadratic(p, n, 0, m, 0)
