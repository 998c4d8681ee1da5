"""Motion that a recording missed in a gap, or a tracker's jump, is no speed: what is driven catches up slowly."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.results import FLAG_CATCHING_UP
from tests.laws.replayed import Run, floor, thing
from tests.recording.log_files import pose, write_log

SPEED = 0.2  # m/s


def push(
    folder: Path, rate: int, way: Callable[[float], float], lost: tuple[float, float], simulated: bool = True
) -> Run:
    """A slab goes along x and touches a ball; its tracker says nothing for a while."""
    things = [
        floor(),
        thing("slab", "driven", box=(0.02, 0.4, 0.4), topic="/slab", mass=0.4, material="human"),
        thing("marker", "fixed", sphere=0.001, topic="/marker"),
    ]
    if simulated:
        things.insert(0, thing("ball", sphere=0.05, position=(0, 0, 0.05), mass=0.1))
    (folder / "scene.toml").write_text('[scene]\nname = "gap"\n' + "".join(things))
    items = []
    for t in np.arange(4 * rate + 1) / rate:
        items.append(pose("/marker", 1.0 + t, (9.0, 9.0, 9.0, 0, 0, 0, 1)))
        if not lost[0] < t < lost[1]:
            items.append(pose("/slab", 1.0 + t, (float(way(t)), 0, 0.25, 0, 0, 0, 1)))
    write_log(folder / "log.mcap", items, encoding="protobuf")
    world = load_world(folder / "scene.toml")
    return Run(world, list(replay(folder / "log.mcap", world, config=Config(clock="/marker"))))


def steady(t: float) -> float:
    """A slab that touches the ball from 0.5 s on and goes on at `SPEED`."""
    return -0.16 + SPEED * t


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
def test_after_lost_tracking_of_a_second_a_touched_ball_leaves_no_faster_than_the_hand_moves(
    tmp_path: Path, rate: int
) -> None:
    run = push(tmp_path, rate, steady, (1.0, 2.0))
    since = run.t > 1.0
    fastest = np.linalg.norm(np.diff(run.path("ball")[since, :3], axis=0), axis=1).max() * rate
    assert SPEED < fastest <= 1.5 * SPEED
    flagged = [bool(r.metrics.flags & FLAG_CATCHING_UP) for r in run.results]
    assert any(flagged)
    assert not any(f for f, t in zip(flagged, run.t, strict=True) if t < 1.9)
    assert run.path("slab")[-1, 0] == pytest.approx(steady(4.0), abs=0.05)
    slab = run.world.body_names.index("slab")
    seen = [(r.recorded[slab, 0], steady(t)) for r, t, f in zip(run.results, run.t, flagged, strict=True) if f]
    np.testing.assert_allclose(*zip(*seen, strict=True), atol=1e-9)  # what is shown as recorded is what was recorded


def test_a_tracker_that_jumps_for_a_frame_strikes_nothing(tmp_path: Path) -> None:
    glitch = lambda t: -0.10 + 0.01 * np.sin(3 * t) + (0.3 if abs(t - 2.5) < 1e-3 else 0.0)  # noqa: E731
    run = push(tmp_path, 60, glitch, (9.0, 9.0))
    assert np.abs(run.path("ball")[:, 0]).max() < 1e-3
    assert any(r.metrics.flags & FLAG_CATCHING_UP for r in run.results)


def test_without_simulated_bodies_the_recording_is_as_it_was(tmp_path: Path) -> None:
    run = push(tmp_path, 60, steady, (1.0, 2.0), simulated=False)
    assert not any(r.metrics.flags & FLAG_CATCHING_UP for r in run.results)
    slab = run.world.body_names.index("slab")
    for r in run.results:
        assert r.corrected[slab].tolist() == r.recorded[slab].tolist()


def test_the_summary_names_the_flag() -> None:
    from geomphys.output.summary import FLAG_NAMES

    assert json.dumps(FLAG_NAMES[FLAG_CATCHING_UP]) == '"catching_up"'
