"""NaN containment: a body that becomes non-finite is put back, marked and counted, and nothing of it gets into a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geomphys_cli.main import run as command

import geomphys
from geomphys import replays
from geomphys.engine.pipeline import Pipeline
from geomphys.output.output_log import open_output
from geomphys.results import FLAG_QUARANTINED
from tests.cli.press import SCENE, write_log
from tests.recording.log_files import pose
from tests.recording.log_files import write_log as write_messages
from tests.scene.models import ball, joint, urdf

BAD = (math.nan, math.inf, -math.inf, 1e300)
BALL = """
[[object]]
name = "ball"
class = "simulated"
sphere = 0.05
position = [0.3, 0.0, 0.5]
material = "wood"
"""
CHUNK = 8
FINGER = 1  # tree, behind the table
Poison = Callable[[Any], None]


def poisoned(monkeypatch: pytest.MonkeyPatch, poison: Poison, at: int = 3) -> None:
    """Let a fault befall the data ahead of the `at`-th chunk of `CHUNK` frames."""
    before, calls = Pipeline.run, [0]

    def run(self: Pipeline, *arguments: Any, **more: Any) -> int:
        calls[0] += 1
        if calls[0] == at:
            poison(self.data)
        return before(self, *arguments, **more)

    monkeypatch.setattr(replays, "FRAMES", CHUNK)
    monkeypatch.setattr(Pipeline, "run", run)


def offset(value: float) -> Poison:
    def poison(data: Any) -> None:
        data.driven.offset[FINGER] = value

    return poison


def speed(value: float) -> Poison:
    def poison(data: Any) -> None:
        data.driven.offset_velocity[FINGER] = value

    return poison


def fall(value: float) -> Poison:
    def poison(data: Any) -> None:
        data.velocity[:, 2] = value

    return poison


@pytest.mark.parametrize(
    ("place", "value"),
    [*((offset, value) for value in BAD), *((speed, value) for value in BAD if not abs(value) < 1e301)],
)
def test_a_driven_body_is_put_back_marked_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: Callable[[float], Poison], value: float
) -> None:
    write_log(tmp_path / "log.mcap")
    (tmp_path / "scene.toml").write_text(SCENE)
    good = geomphys.run(
        tmp_path / "log.mcap",
        tmp_path / "scene.toml",
        out=tmp_path / "good.mcap",
        options=geomphys.OutputOptions(timing=False),
    )
    poisoned(monkeypatch, place(value))
    words = ["replay", tmp_path / "log.mcap", "-s", tmp_path / "scene.toml", "-o", tmp_path / "bad.mcap", "--no-timing"]
    assert command([*map(str, words)]) == 0
    frames = list(open_output(tmp_path / "bad.mcap").frames())
    whole = list(open_output(tmp_path / "good.mcap").frames())
    assert len(frames) == len(whole) == good.frames
    flagged = [int(f.metrics["flags"]) & FLAG_QUARANTINED > 0 for f in frames]
    first = 2 * CHUNK
    assert flagged[first]
    assert sum(flagged) == 1, "one frame is marked; the fault does not last"
    for before, frame in zip([*frames[:1], *frames], frames, strict=False):
        assert np.isfinite(frame.tf.values).all()
        assert all(np.isfinite([*c.point, *c.normal, c.depth]).all() for c in frame.contacts)
        assert all(math.isfinite(value) for value in frame.metrics.values())
        if flagged[frame.index]:
            at = frame.tf.names.index("finger")
            assert frame.tf.values[at].tolist() == before.tf.values[before.tf.names.index("finger")].tolist()
    for k in range(first):
        assert frames[k].tf.values.tolist() == whole[k].tf.values.tolist()
    assert np.allclose(frames[-1].tf.values, whole[-1].tf.values, atol=1e-6), "the coupling takes it back"
    assert any(row.level == "error" and "put back to its last good state" in row.text for f in frames for row in f.log)


def test_the_summary_counts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "log.mcap")
    (tmp_path / "scene.toml").write_text(SCENE)
    poisoned(monkeypatch, offset(math.nan))
    assert command(["replay", str(tmp_path / "log.mcap"), "-s", str(tmp_path / "scene.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["flags"]["quarantined"] == 1
    poisoned(monkeypatch, offset(math.nan))
    assert command(["replay", str(tmp_path / "log.mcap"), "-s", str(tmp_path / "scene.toml")]) == 0
    output = capsys.readouterr()
    assert "put back to its last good state" in output.out + output.err


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_simulated_body_is_put_back_marked_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    write_log(tmp_path / "log.mcap")
    (tmp_path / "scene.toml").write_text(SCENE + BALL)
    poisoned(monkeypatch, fall(value))
    words = ["replay", tmp_path / "log.mcap", "-s", tmp_path / "scene.toml", "-o", tmp_path / "bad.mcap"]
    assert command([*map(str, words)]) == 0
    frames = list(open_output(tmp_path / "bad.mcap").frames())
    flagged = [f for f in frames if int(f.metrics["flags"]) & FLAG_QUARANTINED]
    assert [f.index for f in flagged] == [2 * CHUNK]
    assert all(np.isfinite(f.tf.values).all() for f in frames)
    heights = [f.tf.values[f.tf.names.index("ball"), 2] for f in frames]
    fallen = -np.diff(heights)
    assert 0 <= fallen[2 * CHUNK - 1] < 0.5 * fallen[2 * CHUNK - 2], "at rest, but for the parts of the frame after it"
    assert heights[-1] < heights[2 * CHUNK], "it goes on falling"


@pytest.mark.parametrize("value", BAD)
def test_a_chain_is_put_back_with_its_posture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: float) -> None:
    urdf(
        tmp_path / "arm.urdf",
        ball("base"),
        ball("tip", at="0 0 0.1"),
        joint("j", "base", "tip", inside='<axis xyz="0 1 0"/>'),
    )
    write_log(tmp_path / "log.mcap", topic="/tracker/arm")
    (tmp_path / "scene.toml").write_text(
        '[[avatar]]\nname = "arm"\nurdf = "arm.urdf"\nmode = "chains"\nroot = { topic = "/tracker/arm" }\n'
        '[[avatar.chain]]\nname = "c"\nbase = "base"\ntip = "tip"\n'
        '[[object]]\nname = "post"\nclass = "fixed"\nsphere = 0.03\nposition = [0.02, 0.0, 0.16]\nmaterial = "wood"\n'
    )  # fmt: skip

    def poison(data: Any) -> None:
        data.driven.general_motion.fill(1)
        data.driven.link_offsets["translation"] = data.driven.link_offsets["rotation"] = value
        data.driven.last.angles.fill(value)

    poisoned(monkeypatch, poison)
    summary = geomphys.run(tmp_path / "log.mcap", tmp_path / "scene.toml", out=tmp_path / "out.mcap")
    frames = list(open_output(tmp_path / "out.mcap").frames())
    angles = np.array([frame.joints["/joint_states"].values for frame in frames])
    assert np.isfinite(angles).all()
    assert all(np.isfinite(frame.tf.values).all() for frame in frames)
    if np.isnan(value):  # an offset that is no number is none: the recording goes on
        return
    assert summary.flags["quarantined"] == 1
    assert angles[2 * CHUNK].tolist() == angles[2 * CHUNK - 1].tolist()
    assert frames[2 * CHUNK].tf.values[:2].tolist() == frames[2 * CHUNK - 1].tf.values[:2].tolist()


@pytest.mark.parametrize(
    ("mass", "stiffness", "damping"), [(1e-9, 1e9, 1e9), (1e9, 1e-3, 0.0), (1e-9, 1e-3, 1e9), (0.4, 1000.0, 4000.0)]
)
def test_no_input_within_the_bounds_of_a_scene_makes_a_pose_that_is_not_finite(
    tmp_path: Path, mass: float, stiffness: float, damping: float
) -> None:
    """Poses up to the farthest that are read, the lightest and the stiffest couplings, gaps of hours."""
    way = [
        (0, 0, 0.2),
        (0, 0, 0.1),
        (0, 0, 0.03),
        (0, 0, 0.02),
        (0, 0, 0.02),
        (0, 0, 0.02),
        (0, 0, 1e-300),
        (9e8, 0, 0),
    ]
    way += [(0, -9e8, 1e-320), (0, 0, -0.03), (0, 0, -0.03), (0, 0, -0.03), (0, 0, 0.3)]
    steps = [1 / 60] * 4 + [1e-9, 0.5, 3600.0, 1 / 60, 1 / 60, 1.0, 36_000.0, 1 / 60]
    items = [pose("/cube", at, (*place, 0, 0, 0, 1)) for at, place in zip(np.cumsum([1.0, *steps]), way, strict=True)]
    write_messages(tmp_path / "log.mcap", items)
    coupling = f"mass = {mass}\ncoupling = {{ stiffness = {stiffness}, damping = {damping} }}\n"
    (tmp_path / "scene.toml").write_text(
        SCENE[: SCENE.index('[[object]]\nname = "finger"')]
        + f'[[object]]\nname = "cube"\nclass = "driven"\nbox = [0.1, 0.1, 0.1]\ntopic = "/cube"\n{coupling}'
    )
    results = list(geomphys.replay(tmp_path / "log.mcap", tmp_path / "scene.toml"))
    assert len(results) == len(way)
    assert all(np.isfinite(result.corrected).all() for result in results)
    assert not any(result.metrics.flags & FLAG_QUARANTINED for result in results)
    assert max(result.metrics.residual_penetration_m for result in results) <= 1e-5
