"""Cholesky factor of the Hessian of a keypoint fit, and solutions by it; in the workspace of the fit."""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel
from geomphys.keypoints.fit_model import FitState


@kernel
def factorise(state: FitState, damping: float) -> bool:
    """Cholesky factor (lower triangle) of the Hessian, its diagonal times 1 + damping, a unit matrix for what is not free.

    Column by column, so that the inner loop runs along rows.
    """
    hessian, factor, free, column = state.hessian, state.factor, state.free, state.column
    n = len(free)
    for i in range(n):
        for j in range(i):
            factor[i, j] = hessian[i, j] if free[i] and free[j] else 0.0
        factor[i, i] = hessian[i, i] * (1.0 + damping) if free[i] else 1.0
    for k in range(n):
        if not factor[k, k] > 0.0:
            return False
        factor[k, k] = math.sqrt(factor[k, k])
        for i in range(k + 1, n):
            factor[i, k] /= factor[k, k]
            column[i] = factor[i, k]
        for i in range(k + 1, n):
            value = column[i]
            if value != 0.0:
                for j in range(k + 1, i + 1):
                    factor[i, j] -= value * column[j]
    return True


@kernel
def substitute_forward(state: FitState, first: int) -> None:
    """Solve factor x = `state.step` in place, where the first elements up to `first` are 0."""
    factor, x = state.factor, state.step
    for i in range(first, len(x)):
        for k in range(first, i):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]


@kernel
def substitute_back(state: FitState) -> None:
    """Solve factorᵀ x = `state.step` in place."""
    factor, x = state.factor, state.step
    for i in range(len(x) - 1, -1, -1):
        x[i] /= factor[i, i]
        for k in range(i):
            x[k] -= factor[i, k] * x[i]
