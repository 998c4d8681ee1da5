"""The tremor of a hand against what it grips is filtered; the motion of what it grips, and a hand without a grip, are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.tremor import FARTHEST
from geomphys.driven.weights import WEIGHTS
from tests.driven.logs import Floats, Run, Thing, assert_free, play
from tests.driven.test_grips import BAR, DEPTH, REACH, hand

NOISE = 1e-4  # m
RATE = 60.0
T = np.arange(180) / RATE
HELD = slice(75, 105)


def gripping(folder: Path, palm: Floats, bar: Floats | None = None, lower: float = 1.0) -> Run:
    """Two fingers close on a bar and open, the lower one `lower` times as far; palm and bar go on their paths (n, 3)."""
    close = (0.01 + DEPTH) / 0.08 * np.clip(2.0 * np.minimum(T - 0.4, T[-1] - 0.8 - T), 0.0, 1.0)
    avatar = hand(folder).replace('mode="rigid"', 'mode="chains"')
    for name in ("upper", "lower"):
        avatar += f'[[avatar.chain]]\nname="{name}"\nbase="palm"\ntip="{name}"\n'
    thing = BAR if bar is None else Thing(name="bar", shape=BAR.shape, path=np.array(BAR.at) + bar)
    return play(
        folder, [thing], avatars=avatar, roots={"/wrist": palm},
        angles={"/angles": (["upper_joint", "lower_joint"], np.column_stack([close, -lower * close]))}, rate=RATE,
    )  # fmt: skip


def tremor() -> Floats:
    """(n, 3) m, of 10 Hz."""
    return NOISE * np.sqrt(2.0) * np.column_stack([np.sin(20.0 * np.pi * T + k) for k in range(3)])


def roughness(values: Floats) -> float:
    """Root mean square of second differences in the grip."""
    return float(np.sqrt(np.mean(np.diff(values[HELD], n=2, axis=0) ** 2)))


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_a_hand_that_grips_trembles_less_than_recorded(tmp_path: Path, speed: float) -> None:
    """On what stands still, and on what moves at up to `speed` [m/s], the hand with it."""
    path = np.zeros((len(T), 3))
    path[:, 1] = 0.5 * speed * np.sin(2.0 * T)
    still, run = gripping(tmp_path / "still", path, path), gripping(tmp_path / "run", path + tremor(), path)
    assert_free(run)
    noise = run.path("hand/palm")[:, :3] - still.path("hand/palm")[:, :3]
    assert roughness(noise) < 0.2 * roughness(tremor())
    assert roughness(run.angles - still.angles) < 0.2 * roughness(tremor()) / REACH
    assert np.linalg.norm(noise, axis=1).max() < FARTHEST * WEIGHTS.tremor
    assert np.linalg.norm(still.offset("hand/palm"), axis=1).max() < 5e-5  # it does not lag behind what it grips


def test_a_hand_that_grips_nothing_keeps_its_tremor(tmp_path: Path) -> None:
    """One finger alone does not grip; before and after a grip no bit is changed."""
    run = gripping(tmp_path / "grip", tremor())
    for part in (slice(0, 20), slice(-20, None)):
        assert run.corrected[part].tobytes() == run.recorded[part].tobytes()
    run = gripping(tmp_path / "one", tremor(), lower=0.0)
    assert run.figures("recorded_penetration_m").max() > 0.8 * DEPTH
    assert roughness(run.path("hand/palm")[:, :3]) > 0.5 * roughness(tremor())
