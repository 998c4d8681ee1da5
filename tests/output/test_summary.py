"""The summary against the same figures taken from all frames at once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geomphys import results
from geomphys.output.summary import FLAG_NAMES, MAX_MESSAGES, Summarizer, Summary
from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations

NONE = np.zeros(0, dtype=np.int64)
NO_CONTACTS = Contacts(NONE, NONE, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0))


def result(
    index: int,
    *,
    recorded: float = 0.0,
    residual: float = 0.0,
    contacts: int = 0,
    flags: int = 0,
    messages: tuple[tuple[str, str], ...] = (),
) -> FrameResult:
    """A frame with these figures, 10 ms after the one before; the deeper, the longer it took."""
    depths = np.array([0.5 * recorded, recorded] if recorded else [])
    pairs = np.arange(len(depths))
    return FrameResult(
        frame=Frame(index, 10_000_000 * index, np.zeros((1, 7)), np.zeros(0), held=index % 2 == 1),
        recorded=np.zeros((2, 7)),
        corrected=np.zeros((2, 7)),
        angles=np.zeros(0),
        contacts=NO_CONTACTS,
        penetrations=Penetrations(pairs, 0 * pairs + 1, np.zeros((len(pairs), 3)), pairs, depths, pairs),
        metrics=Metrics(
            contacts,
            recorded,
            residual,
            1,
            2,
            3,
            2.0 * recorded,
            recorded,
            index % 2 == 1,
            flags,
            0.4,
            0.2,
            3.0,
            2.0,
            0.0,
            *(0.0, 0, 0, 0, 0, 0.0, 0.0, 0.0),
        ),
        timing=(("step", 1000 + round(1e6 * recorded), 1), ("step.overlap", 5, 1), ("encode", 7, 1)),
        messages=messages,
    )


def summarized(frames: list[FrameResult]) -> Summary:
    """The summary of frames."""
    summarizer = Summarizer(("hand", "table"))
    for frame in frames:
        summarizer.add(frame)
    return summarizer.summary(log=Path("a.mcap"), scene=Path("s.toml"), out=Path("o.mcap"), elapsed_s=2.0)


def test_figures_are_those_of_the_frames() -> None:
    depths = np.round(np.random.default_rng(5).uniform(0, 0.03, 101), 6) * (np.arange(101) % 3 == 0)
    frames = [
        result(k, recorded=float(d), residual=float(d) / 1e4, contacts=int(d > 0) * 4) for k, d in enumerate(depths)
    ]
    summary = summarized(frames)
    deep = depths[depths > 1e-5]
    assert summary.frames == 101
    assert summary.duration_s == pytest.approx(1.0)
    assert (summary.contacts, summary.frames_in_contact) == (4 * len(deep), len(deep))
    assert summary.frames_penetrating == len(deep)
    assert summary.recorded_penetration_max_m == depths.max()
    assert summary.recorded_penetration_median_m == np.median(deep)
    assert summary.residual_penetration_max_m == depths.max() / 1e4
    assert summary.residual_penetration_frame == depths.argmax()
    assert summary.frames_with_residual == 0
    assert summary.correction_max_m == 2 * depths.max()
    assert summary.held_frames == 50
    assert (summary.impacts, summary.fallbacks) == (202, 303)
    assert summary.deepest is not None
    assert summary.deepest.frame == depths.argmax()
    assert (summary.deepest.body_a, summary.deepest.body_b) == ("table", "table")
    assert set(summary.timing) == {"step", "encode"}
    step = np.array([1000 + round(1e6 * d) for d in depths])
    assert summary.timing["step"].median_ns == np.median(step)
    assert summary.timing["step"].p95_ns == np.sort(step)[95]
    assert summary.timing["step"].max_ns == step.max()


def test_free_motion_has_nothing_to_tell() -> None:
    summary = summarized([result(0), result(1)])
    assert summary.deepest is None
    assert summary.residual_penetration_frame is None
    assert summary.recorded_penetration_max_m == summary.recorded_penetration_median_m == 0.0
    assert summary.flags == {}
    assert summary.messages == ()


def test_every_flag_has_a_name_and_is_counted() -> None:
    flags = {name: value for name, value in vars(results).items() if name.startswith("FLAG_")}
    assert set(flags.values()) == set(FLAG_NAMES)
    summary = summarized([result(0, flags=bit | results.FLAG_HELD) for bit in flags.values()])
    assert summary.flags == {name: len(flags) if name == "held" else 1 for name in FLAG_NAMES.values()}


def test_messages_are_kept_once_and_bounded() -> None:
    repeated = (("warning", "angles look like degrees"), ("info", "starts"))
    frames = [result(k, messages=(*repeated, ("warning", f"gap {k}"))) for k in range(MAX_MESSAGES + 50)]
    summary = summarized(frames)
    assert len(summary.messages) == MAX_MESSAGES
    assert summary.messages_dropped == 52
    assert (summary.messages[0].count, summary.messages[0].first_frame) == (len(frames), 0)
    assert all(message.level == "warning" for message in summary.warnings)


def test_as_dict_is_json() -> None:
    summary = summarized([result(0, recorded=0.01), result(1)])
    values_by_name = json.loads(json.dumps(summary.as_dict(), allow_nan=False))
    assert values_by_name["deepest"] == {"frame": 0, "body_a": "table", "body_b": "table", "depth_m": 0.01}
    assert values_by_name["out"] == "o.mcap"
    assert values_by_name["rrd"] is None
