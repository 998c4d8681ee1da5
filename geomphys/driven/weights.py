"""The weights of the objective, a matter of choice.

`make weights` varies each over recordings; the results are in `assets/docs/weights.md`.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Weights(NamedTuple):
    """Weights of the objective; numbers without a unit multiply others."""

    base: float = 20.0  # times its area: of the base link of chains; more: the fingers move more, and the hand less
    supported: float = 0.35  # times the second moments of all that it carries: of its rotation; more: it rotates less
    amplification: float = 1.4  # times the recorded depth: links of chains that are farther off than that weigh more;
    excess: float = 0.05  # times it: twice as much where they are so much farther off
    shape: float = 7.0  # times: weight of shape and rotation of a rigid tree
    smooth: float = (
        0.15  # of lever²: a joint's departure from its goal by the coupling; more: smoother, the hand moves more
    )
    rigid_smooth: float = 0.4  # the same in a rigid tree
    posture: float = 0.2  # of mean levers²: the same; more: distal joints move less
    rigid_posture: float = 0.06  # the same in a rigid tree
    grip_posture: float = 0.4  # the same, in addition, in a hand that grips, or has and is not yet back in shape
    inertia: float = (
        0.19  # share by which pressed chains go on as in the last frame; more: smoother, but they overshoot
    )
    rigid_inertia: float = 0.05  # the same in a rigid tree
    grip_inertia: float = 0.6  # the same in a grip, of both
    tremor: float = (
        0.7e-3  # m: size of the noise that is filtered out of the pose of a hand in a grip; more: it lags more
    )
    contact: float = 3.3  # mean weights of a link: penalty of the gap of a fingertip recorded in contact
    rigid_contact: float = 30.0  # the same in a rigid tree, whose joints have a higher weight,
    closing_speed: float = 0.02  # m/s: and no faster than this
    closing_share: float = 0.5  # and this times the fastest recorded motion of a link
    offset_rate: float = 0.7  # share of the rate at which contacts change an offset that it keeps when they end
    growth_rate: float = 0.35  # the same in chains of one that grew; more: smoother under a blow, but it overshoots
    unusual: float = 1.0  # of lever²: a joint more than `stretch` beyond the range of the recording
    stretch: float = math.radians(10.0)  # rad, beyond the range in which the recording used a joint so far
    translation_of_depth: float = (
        3.0  # times the recorded depth: a rigid tree is translated up to that far; beyond, its joints yield too
    )
    least_translation: float = 3e-3  # m: as far as this it always is,
    most_translation: float = 0.03  # m: and no farther than this,
    translation_speed: float = 0.1  # m/s: nor faster than this,
    grip_depth: float = 2e-3  # m: nor where fingers close on something by more than this


WEIGHTS = Weights()
"""The weights in use."""
