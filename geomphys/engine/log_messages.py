"""Log messages of a replay, made from the flags and figures of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.results import (
    FLAG_BLOCKED,
    FLAG_CATCHING_UP,
    FLAG_IMPACT_BOUND,
    FLAG_NOT_CONVERGED,
    FLAG_QUARANTINED,
    FLAG_SHAPE_CHANGED,
    FLAG_STARTED_INSIDE,
    FLAG_SWEEP_BOUND,
    FLAG_TABLE_FULL,
)

Message = tuple[str, str]

_TEXTS = {
    FLAG_STARTED_INSIDE: (
        "warning",
        "the recording, or what is simulated, starts inside something; freed by the shortest way found",
    ),
    FLAG_NOT_CONVERGED: (
        "warning",
        "no free place was found, or none within its bound of rounds; see residual_penetration_m",
    ),
    FLAG_IMPACT_BOUND: (
        "warning",
        "more impacts than max_impacts in a frame: what was beyond was stopped, not bounced",
    ),
    FLAG_QUARANTINED: ("error", "a body became non-finite and was put back to its last good state"),
    FLAG_SHAPE_CHANGED: (
        "warning",
        "a body that moves in one piece yields in shape or orientation too: a translation would go too far, or off what it "
        "grips; see shape_change_rad",
    ),
    FLAG_CATCHING_UP: ("info", "after a gap or a jump of a tracker, what is driven catches up at a bounded speed"),
    FLAG_SWEEP_BOUND: (
        "info",
        "contact forces of driven and simulated bodies ended at their bound of sweeps, not converged",
    ),
    FLAG_TABLE_FULL: (
        "warning",
        "more pairs, contact points or rows of a solver than their table holds: those beyond were left out",
    ),
    FLAG_BLOCKED: ("info", "something stands between a body and its recorded place"),
}

_INFEASIBLE = ("warning", "the overlaps of a body leave no way out; it was put where it is free, or its posture held")


class FrameReporter:
    """Converts flags of frames to messages: one where a state begins, none while it lasts."""

    def __init__(self) -> None:
        self._flags = 0
        self._infeasible = False

    def messages(self, metrics: Mapping[str, NDArray[Any]]) -> dict[int, tuple[Message, ...]]:
        """Messages of n frames by their rows; of the metrics (n,) `flags` and `fallbacks` are read."""
        flags: NDArray[np.int64] = metrics["flags"]
        infeasible = (metrics["fallbacks"] > 0) & (flags & FLAG_SHAPE_CHANGED == 0)
        flags_before, infeasible_before = np.roll(flags, 1), np.roll(infeasible, 1)
        flags_before[0], infeasible_before[0] = self._flags, self._infeasible
        self._flags, self._infeasible = int(flags[-1]), bool(infeasible[-1])
        started, closed = flags & ~flags_before, infeasible & ~infeasible_before
        found = {}
        for row in np.flatnonzero((started != 0) | closed).tolist():
            texts = [text for flag, text in _TEXTS.items() if started[row] & flag]
            if texts or closed[row]:
                found[row] = (*texts, _INFEASIBLE) if closed[row] else tuple(texts)
        return found


def is_of_flag(message: str) -> bool:
    """Whether a message only repeats a frame's flag."""
    return any(message == text for _, text in _TEXTS.values())
