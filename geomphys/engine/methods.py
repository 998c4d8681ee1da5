"""Which method moves driven trees: the exact one or that of the paper.

It is chosen when kernels are compiled, by which field of `Method` is None: numba drops the branch after ``is not None``
of a None argument, so that nothing of the other method is compiled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.groups import Outcome
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.paper.update import separate_as_published, update_driven_as_published
from geomphys.driven.update import separate_driven, update_driven
from geomphys.engine.state import Method, ReplayData
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]


@kernel
def _update(
    exact: float | None,
    paper: PaperWorkspace | None,
    scene: Scene,
    data: ReplayData,
    roots: Floats,
    angles: Floats,
    dt: float,
) -> Outcome:
    if exact is not None:
        return update_driven(scene, data.driven, data.workspace, roots, angles, data.recorded, dt, exact)
    if paper is not None:
        return update_driven_as_published(scene, data.driven, paper, roots, angles, data.recorded, dt)
    return Outcome(0, 0, False, False)


@kernel
def update_by_method(
    scene: Scene, data: ReplayData, method: Method, roots: Floats, angles: Floats, dt: float
) -> Outcome:
    """Couple driven trees to the roots (T, 7) and angles (Q,) recorded `dt` [s] later and resolve their overlaps."""
    return _update(method.exact, method.paper, scene, data, roots, angles, dt)


@kernel
def _separate(exact: float | None, paper: PaperWorkspace | None, scene: Scene, data: ReplayData) -> int:
    if exact is not None:
        return separate_driven(scene, data.driven, data.workspace, data.recorded, exact)
    if paper is not None:
        return separate_as_published(scene, data.driven, paper, data.recorded)
    return 0


@kernel
def separate_by_method(scene: Scene, data: ReplayData, method: Method) -> int:
    """Move driven trees out of what has moved into them since; returns the iterations."""
    return _separate(method.exact, method.paper, scene, data)
