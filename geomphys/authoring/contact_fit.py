"""Fits the offset of a tracker, the poses of surfaces and lengths of fingers to frames of contact: robust Gauss-Newton.

The residuals are the gaps of the links that touch, penetration and float alike. What the frames show is said by the covariance of
the changes: that of the measurements, whose variance is estimated from the gaps that are left, with changes of the size of
`EXPECTED` as prior. A touch is one measurement and a hand that lies flat three, however many frames and points it has, as their
errors are not independent.

With few touches another corner of the hand may have touched, so fits that lie apart may be right as well. They are searched
from many starts. How probable a fit is, is said by its deviance, minus twice the logarithm of its posterior density: the robust
sum of squared gaps over their variance, plus the squares of the changes over those of what is expected. Two fits are compared by
the difference of their deviances (a likelihood ratio): the right one has d² more than a wrong one, by noise, with at most the
probability with which a normal value exceeds d standard deviations, however far the two lie apart. So what has `PLAUSIBLE`² more
than the best, or less, may be right, and what lies between it and the best is not known: it is added to the covariance.
Hands lie on surfaces: each stretch in which one would touch from beneath adds `BENEATH` to the deviance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.contact_frames import Contact
from geomphys.authoring.contact_gaps import ContactGaps, Gaps, Unknowns
from geomphys.authoring.surface_gaps import GapMeter
from geomphys.scene.world import World

Floats = NDArray[np.float64]

CONFIDENCE = 2.5
"""Standard deviations within which a change has to be known to one unit."""
DEVIATION = 0.5e-3
"""m; standard deviation of a measurement before anything is known of it,"""
PRIOR_WEIGHT = 3.0
"""which counts as so many measurements."""
STAGES = ((0.03, 0.03), (0.015, 0.01), (0.008, 0.005), (0.004, 0.003), (0.002, 0.0015))
"""m; how much higher than the lowest a point may be and count as touching, and the scale of the robust loss; in turn."""
ITERATIONS = 12
"""Steps of a stage."""
MAX_STEP = 20.0
"""Units; longest step."""
STARTS = 48
"""Random changes of the size of the expected ones that are started from besides none."""
FIRST_STAGES = (3, 1)
"""Stages with which they begin, in turn: a wide loss leads all of them to one minimum."""
NEAR_STARTS = 6
"""Changes within `NEAR` standard deviations of the best, in which it is sure least, that are started from after these."""
NEAR = 3.0
PLAUSIBLE = 3.0
"""Standard deviations that the right fit may seem worse than the best (1 in 740): its odds against it are then 1 to 90."""
BENEATH = 9.0
"""Deviance of a touch from beneath: odds of 1 to 90."""


class ContactFit(NamedTuple):
    """Result of a fit."""

    change: Floats  # (N,) in units: 6 of the offset if it is sought, then 3 a surface, then 1 a finger
    covariance: Floats  # (N, N) of it
    pivots: dict[int, Floats]  # surface -> middle of its contacts (3,), which it tilts about
    residual: float  # m, median of the absolute gaps
    percentile_90: float  # m, 90th percentile


def fit_contacts(
    world: World, tree: int, tracker_from_root: Floats, contacts: Sequence[Contact], unknowns: Unknowns
) -> ContactFit:
    """Fit frames of contact of the avatar `tree`, from many starts where an offset or fingers are sought.

    `tracker_from_root` (4, 4) is the offset as the frames have it.
    """
    gaps = ContactGaps(GapMeter(world), tree, tracker_from_root, contacts, unknowns)
    if unknowns.offset or unknowns.fingers:
        start, others = _plausible_fits(gaps.first_of_stretches())
        change = _descend(gaps, start, FIRST_STAGES[0])
    else:
        change, others = _descend(gaps, np.zeros(unknowns.size)), []
    covariance = with_differences(_covariance(gaps, change)[0], [other - start for other in others])
    absolute = np.abs(_final_gaps(gaps, change).gap)
    residual, percentile_90 = (float(np.percentile(absolute, share)) if len(absolute) else 0.0 for share in (50, 90))
    return ContactFit(change, covariance, gaps.pivots, residual, percentile_90)


def _plausible_fits(gaps: ContactGaps) -> tuple[Floats, list[Floats]]:
    """The most probable fit (N,), and the others that may be right as well."""
    rng, expected, size = np.random.default_rng(0), gaps.unknowns.expected, gaps.unknowns.size
    found = [_descend(gaps, np.zeros(size))]
    for k in range(STARTS):
        start = rng.uniform(-1.5, 1.5, size) * expected
        found.append(_descend(gaps, start, FIRST_STAGES[k % len(FIRST_STAGES)]))
    squares = [_robust_squares(_final_gaps(gaps, change)) for change in found]  # m²
    nearest = found[int(np.argmin(squares))]
    covariance, variance = _covariance(gaps, nearest)
    root = np.linalg.cholesky(covariance)
    for _ in range(NEAR_STARTS):
        direction = rng.normal(size=size)
        direction *= NEAR / np.linalg.norm(direction) * np.sqrt(size / 3)
        found.append(_descend(gaps, nearest + root @ direction, FIRST_STAGES[0]))
        squares.append(_robust_squares(_final_gaps(gaps, found[-1])))
    deviance = np.array(
        [own / variance + _prior_deviance(gaps, change) for own, change in zip(squares, found, strict=True)]
    )
    best = int(deviance.argmin())
    limit = deviance[best] + PLAUSIBLE**2
    return found[best], [change for change, own in zip(found, deviance, strict=True) if own <= limit]


def _prior_deviance(gaps: ContactGaps, change: Floats) -> float:
    """Deviance of a change (N,) by what is expected alone, but for a constant."""
    return float(np.sum((change / gaps.unknowns.expected) ** 2)) + BENEATH * gaps.count_beneath(change)


def _covariance(gaps: ContactGaps, change: Floats) -> tuple[Floats, float]:
    """Covariance (N, N) of the changes, and variance [m²] of a measurement."""
    found = _final_gaps(gaps, change)
    squares, measured = _robust_squares(found), float(found.weight.sum())
    prior = np.diag(gaps.unknowns.expected**-2.0)
    information = (found.jacobian * found.weight[:, None]).T @ found.jacobian
    variance = DEVIATION**2
    for _ in range(4):
        covariance = np.linalg.inv(information / variance + prior)
        shown = len(change) - float(np.trace(covariance @ prior))
        reserve = max(measured - shown, 0.0)
        variance = (PRIOR_WEIGHT * DEVIATION**2 + squares) / (PRIOR_WEIGHT + reserve)
    final: Floats = np.asarray(np.linalg.inv(information / variance + prior), dtype=np.float64)
    return final, variance


def _final_gaps(gaps: ContactGaps, change: Floats) -> Gaps:
    """Gaps of the points that touch by the last stage."""
    return gaps.linearise(change, STAGES[-1][0], gaps.planes(change))


def _robust_squares(found: Gaps) -> float:
    """m², robust sum of squared gaps (Cauchy's loss of the last stage)."""
    scale = STAGES[-1][1]
    return float(np.sum(found.weight * scale**2 * np.log1p((found.gap / scale) ** 2)))


def _descend(gaps: ContactGaps, change: Floats, first_stage: int = 0) -> Floats:
    """The minimum that is reached from a change (N,), the stages from a first one on in turn."""
    expected = gaps.unknowns.expected
    for band, scale in STAGES[first_stage:]:
        planes = gaps.planes(change)
        for _ in range(ITERATIONS):
            found = gaps.linearise(change, band, planes)
            root = np.sqrt(found.weight / (1.0 + (found.gap / scale) ** 2))  # Cauchy
            step = _ridge_step(found.jacobian * root[:, None], found.gap * root, change, scale / 3.0 / expected)
            length = float(np.abs(step).max(initial=0.0))
            change = change + step * min(1.0, MAX_STEP / max(length, 1e-12))
            if length < 5e-3:
                break
    return change


def _ridge_step(jacobian: Floats, gaps: Floats, change: Floats, ridge: Floats) -> Floats:
    """Step to the least of |gaps + jacobian step|² + |ridge (change + step)|²."""
    normal = jacobian.T @ jacobian + np.diag(ridge**2)
    return -np.asarray(np.linalg.solve(normal, jacobian.T @ gaps + ridge**2 * change), dtype=np.float64)


def with_differences(covariance: Floats, differences: Sequence[Floats]) -> Floats:
    """Covariance (N, N) so large that each difference (N,) is at most one standard deviation."""
    for difference in differences:
        square = float(difference @ np.linalg.solve(covariance, difference))
        if square > 1.0:
            covariance = covariance + np.outer(difference, difference) * (1.0 - 1.0 / square)
    return covariance
