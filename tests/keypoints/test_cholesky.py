"""The Cholesky factor of a fit's Hessian and solutions by it, against numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from geomphys.jit.packed_records import pack
from geomphys.keypoints.cholesky import factorise, substitute_back, substitute_forward

N = 6


class System(NamedTuple):
    """The fields of a fit's state that the solver uses."""

    hessian: NDArray[np.float64]
    factor: NDArray[np.float64]
    column: NDArray[np.float64]
    step: NDArray[np.float64]
    free: NDArray[np.int64]


@pytest.fixture
def system() -> System:
    """A positive definite Hessian with some zeros."""
    a = np.random.default_rng(3).normal(size=(N, N))
    hessian = a @ a.T + np.eye(N)
    hessian[0, 4] = hessian[4, 0] = hessian[1, 5] = hessian[5, 1] = 0.0
    return System(hessian, np.zeros((N, N)), np.zeros(N), np.arange(1.0, N + 1), np.ones(N, np.int64))


@pytest.mark.parametrize("held", [(), (2,), (0, 5)])
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_solves_the_damped_system_of_what_is_free(system: System, held: tuple[int, ...], damping: float) -> None:
    system.free[list(held)] = 0
    system.step[list(held)] = 0.0
    right, packed = system.step.copy(), pack(system)
    assert factorise(packed, damping)
    free = np.flatnonzero(system.free)
    matrix = system.hessian[np.ix_(free, free)] + damping * np.diag(np.diag(system.hessian)[free])
    substitute_forward(packed, 0)
    substitute_back(packed)
    assert system.step[free] == pytest.approx(np.linalg.solve(matrix, right[free]), rel=1e-10)
    assert system.step[list(held)].tolist() == [0.0] * len(held)


def test_zeros_at_the_front_may_be_skipped(system: System) -> None:
    system.step[:3] = 0.0
    packed, whole = pack(system), system.step.copy()
    assert factorise(packed, 0.0)
    substitute_forward(packed, 3)
    assert system.step == pytest.approx(np.linalg.solve(np.tril(system.factor), whole), rel=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_refused(system: System) -> None:
    system.hessian[3, 3] = -1.0
    assert not factorise(pack(system), 0.0)
    system.hessian[3, 3] = np.nan
    assert not factorise(pack(system), 0.0)
