"""A message where a state begins and none while it lasts, whatever the chunks."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys import results
from geomphys.engine.log_messages import FrameReporter, is_of_flag

BLOCKED, CHANGED, QUARANTINED = results.FLAG_BLOCKED, results.FLAG_SHAPE_CHANGED, results.FLAG_QUARANTINED


def reported(flags: list[int], fallbacks: list[int] | None = None, chunk: int = 100) -> dict[int, list[str]]:
    """Frame -> messages, with frames handed over in chunks."""
    reporter, out = FrameReporter(), {}
    falls = np.array(fallbacks or [0] * len(flags))
    for start in range(0, len(flags), chunk):
        rows = slice(start, start + chunk)
        found = reporter.messages({"flags": np.array(flags[rows], np.int64), "fallbacks": falls[rows]})
        out |= {start + row: [text for _, text in texts] for row, texts in found.items()}
    return out


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
def test_a_state_is_told_when_it_begins(chunk: int) -> None:
    flags = [0, BLOCKED, BLOCKED, BLOCKED | QUARANTINED, BLOCKED, 0, BLOCKED]
    found = reported(flags, chunk=chunk)
    assert sorted(found) == [1, 3, 6]
    assert [len(texts) for texts in found.values()] == [1, 1, 1]
    assert found[1] == found[6] != found[3]
    assert "non-finite" in found[3][0]


@pytest.mark.parametrize("chunk", [1, 100])
def test_what_has_no_way_out_is_told_unless_its_shape_yields(chunk: int) -> None:
    found = reported([0, 0, 0, CHANGED, CHANGED], [0, 1, 1, 1, 0], chunk)
    assert sorted(found) == [1, 3]
    assert "no way out" in found[1][0]
    assert not is_of_flag(found[1][0])
    assert is_of_flag(found[3][0])


TOLD = ("STARTED_INSIDE", "NOT_CONVERGED", "IMPACT_BOUND", "QUARANTINED", "SHAPE_CHANGED", "CATCHING_UP")
TOLD_TOO = ("SWEEP_BOUND", "TABLE_FULL", "BLOCKED")


@pytest.mark.parametrize("flag", [getattr(results, f"FLAG_{name}") for name in (*TOLD, *TOLD_TOO)])
def test_each_of_these_flags_has_a_text_of_its_own(flag: int) -> None:
    (text,) = reported([flag])[0]
    others = [reported([1 << bit]).get(0, []) for bit in range(16) if 1 << bit != flag]
    assert [text] not in others
    assert is_of_flag(text)
