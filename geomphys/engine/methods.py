"""Which method moves driven trees: the exact one, or that of the paper where there is a workspace for it.

It is chosen when kernels are compiled, by the type of the workspace: of the other method nothing is compiled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.groups import Outcome
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.paper.update import give_way_as_published, update_driven_as_published
from geomphys.driven.update import give_way, update_driven
from geomphys.engine.state import Machine
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]


@kernel
def update_by_method(
    scene: Scene, m: Machine, paper: PaperWorkspace | None, roots: Floats, angles: Floats, dt: float, gap: float
) -> Outcome:
    """Couple driven trees to the roots (T, 7) and angles (Q,) recorded `dt` [s] later and take them out of everything."""
    if paper is None:
        return update_driven(scene, m.driven, m.room, roots, angles, m.recorded, dt, gap)
    return update_driven_as_published(scene, m.driven, paper, roots, angles, m.recorded, dt)


@kernel
def give_way_by_method(scene: Scene, m: Machine, paper: PaperWorkspace | None, gap: float) -> int:
    """Take driven trees out of what has come into them since; returns the passes."""
    if paper is None:
        return give_way(scene, m.driven, m.room, m.recorded, gap)
    return give_way_as_published(scene, m.driven, paper, m.recorded)
