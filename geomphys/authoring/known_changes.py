"""What of a fitted change is known, by its covariance, and the names of what is not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.contact_fit import CONFIDENCE, ContactFit
from geomphys.authoring.contact_gaps import Unknowns
from geomphys.scene.world import World

Floats = NDArray[np.float64]

NAMED_SHARE = 0.15
"""Share of a hidden direction from which on a component is named with it."""
UNSEEN = 0.3
"""Share of what is expected of a direction, from which standard deviation on the frames show nothing of it."""


def component_names(world: World, unknowns: Unknowns) -> list[str]:
    """Names of the unknowns, in their order."""
    names: list[str] = []
    if unknowns.offset:
        names += [*(f"offset along {a}" for a in "xyz"), *(f"rotation of the offset about {a}" for a in "xyz")]
    for surface in unknowns.surfaces:
        name = world.tree_names[surface]
        names += [f"height of {name!r}", f"tilt of {name!r} about x", f"tilt of {name!r} about y"]
    return [*names, *(f"length of {finger.name!r}" for finger in unknowns.fingers)]


def _is_known(deviation: Floats) -> NDArray[np.bool_]:
    """Whether values of a standard deviation (units) are known to one unit."""
    known: NDArray[np.bool_] = CONFIDENCE * deviation <= 1.0
    return known


def confidence(fit: ContactFit, unknowns: Unknowns, names: Sequence[str]) -> dict[str, float]:
    """Name -> half of the interval in which a value that is known is: `CONFIDENCE` standard deviations, m, degrees or share."""
    deviations = np.sqrt(np.diag(fit.covariance))
    within = CONFIDENCE * deviations * unknowns.units
    known = zip(names, within, _is_known(deviations), strict=True)
    return {name: round(float(value), 5) for name, value, is_known in known if is_known}


def known_part(fit: ContactFit, unknowns: Unknowns) -> Floats:
    """The part of a change (N,) that is known.

    Of each group the components that are known; of the others what lies along known directions, if the frames show nothing of all
    other directions: a hand that lies flat shows how it is tilted, whatever the axes of its tracker. A tilt of a surface that
    may be none is none: it would move the surface far from the contacts.
    """
    shown = np.zeros_like(fit.change)
    for group in unknowns.groups:
        change, covariance = fit.change[group], fit.covariance[group, group]
        variances, directions = np.linalg.eigh(covariance)
        known, unseen = _is_known(np.sqrt(variances)), np.sqrt(variances) > UNSEEN * unknowns.expected[group]
        if np.all(known | unseen):
            shown[group] = directions[:, known] @ (directions[:, known].T @ change)
        shown[group] = np.where(_is_known(np.sqrt(np.diag(covariance))), change, shown[group])
    for k in range(len(unknowns.surfaces)):
        tilt = slice(6 * unknowns.offset + 3 * k + 1, 6 * unknowns.offset + 3 * k + 3)
        if shown[tilt] @ np.linalg.solve(fit.covariance[tilt, tilt], shown[tilt]) < CONFIDENCE**2:
            shown[tilt] = 0.0
    return shown


def name_unknown(names: Sequence[str], covariance: Floats) -> list[str]:
    """The components that are not known: each hidden direction by those of it, then those of no such direction."""
    variances, directions = np.linalg.eigh(covariance)
    unknown = ~_is_known(np.sqrt(np.diag(covariance)))
    found = _separated(directions[:, ~_is_known(np.sqrt(variances))])
    lines = {tuple(k for k in members if unknown[k]) for members in found} - {()}
    named = {k for members in lines for k in members}
    lines |= {(int(k),) for k in np.flatnonzero(unknown) if k not in named}
    return [" with ".join(names[k] for k in members) for members in sorted(lines)]


def _separated(hidden: Floats) -> list[list[int]]:
    """Components of the hidden directions, in a basis with few components each (reduced row echelon form)."""
    rows, pivots = hidden.T.copy(), 0
    free = np.ones(len(hidden), dtype=bool)
    while pivots < len(rows):
        largest = np.abs(rows[pivots:]) * free
        best, column = (int(k) for k in np.unravel_index(int(largest.argmax()), largest.shape))
        rows[[pivots, pivots + best]] = rows[[pivots + best, pivots]]
        rows[pivots] /= rows[pivots, column]
        for other in range(len(rows)):
            if other != pivots:
                rows[other] -= rows[other, column] * rows[pivots]
        free[column] = False
        pivots += 1
    return [[int(k) for k in np.flatnonzero(np.abs(row) > NAMED_SHARE * np.abs(row).max())] for row in rows]
