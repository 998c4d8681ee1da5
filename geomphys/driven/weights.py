"""What a correction costs, as far as it is a matter of choice: the weights of the objective.

`make weights` varies each over recordings; `assets/docs/weights.md` has what comes of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Weights(NamedTuple):
    """Weights of the objective; numbers without a unit multiply others."""

    base: float = 30.0  # times its area: of a link that carries chains; more: the fingers yield, and less the hand
    shape: float = 30.0  # times: how much dearer shape and rotation are where a tree moves in one piece (mode rigid)
    smooth: float = 0.3  # of lever²: a joint's departure from where it would go by itself; more: calmer, farther off
    trend: float = 0.15  # of its last change: by how much the offset of a joint goes on by itself
    contact: float = 2.0  # mean weights of a link: how strongly a fingertip recorded on something is drawn to it
    stiff_contact: float = 15.0  # the same in a tree in one piece, whose joints are dearer,
    closing_speed: float = 0.1  # m/s: and there no faster than this
    unusual: float = 1.0  # of lever²: a joint bent farther than `stretch` beyond the range of the recording
    stretch: float = math.radians(10.0)  # rad, beyond the range in which the recording used a joint so far
    shift_of_depth: float = (
        3.0  # times the recorded depth: a rigid tree is translated up to that far; beyond, its joints yield too
    )
    least_shift: float = 3e-3  # m: as far as this it always is,
    most_shift: float = 0.03  # m: and no farther than this,
    shift_speed: float = 0.12  # m/s: nor faster than this


WEIGHTS = Weights()
"""The weights in use."""
