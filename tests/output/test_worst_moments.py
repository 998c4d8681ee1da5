"""The moments to look at: found among frames by brute force, the same from results and from the output, and in its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.output.output_log import open_output
from geomphys.output.worst_moments import LABELS, WorstMoments, log_text
from geomphys.replays import replay, run
from geomphys.results import FrameResult, Moment
from tests.cli.press import SCENE, write_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("moments")
    (folder / "scene.toml").write_text(SCENE)
    write_log(folder / "log.mcap")
    return folder


@pytest.fixture(scope="module")
def results(folder: Path) -> list[FrameResult]:
    return list(replay(folder / "log.mcap", folder / "scene.toml"))


def test_they_are_the_largest_of_all_frames(results: list[FrameResult]) -> None:
    assert not any(result.moments for result in results[:-1])
    found = {moment.kind: moment for moment in results[-1].moments}
    assert list(found) == [kind for kind in LABELS if kind in found]
    for kind, values in (
        ("recorded_penetration", [r.metrics.recorded_penetration_m for r in results]),
        ("correction", [r.metrics.correction_m for r in results]),
        ("amplification", [r.metrics.amplification for r in results]),
    ):
        assert found[kind].value == max(values) > 0.0
        assert found[kind].frame == int(np.argmax(values))
        first, at = results[0].frame.time_ns, results[found[kind].frame].frame.time_ns
        assert (found[kind].time_ns, found[kind].time_s) == (at, (at - first) / 1e9)
    assert len(found["recorded_penetration"].bodies) == 2
    assert len(found["correction"].bodies) == 1


def test_they_stand_in_the_log_where_they_happen(folder: Path, results: list[FrameResult]) -> None:
    summary = run(folder / "log.mcap", folder / "scene.toml", out=folder / "out.mcap", force=True)
    assert summary.worst == results[-1].moments
    log, again = open_output(folder / "out.mcap"), WorstMoments()
    with log._reading() as (stream, reader):
        lines = {message.log_time for _, message in log._messages(stream, reader, ["/log"])}
    assert {moment.time_ns for moment in summary.worst} <= lines
    texts = []
    for frame in log.frames():
        again.add_output(frame)
        texts += [row.text for row in frame.log]
    assert again.moments(log.intersection_volume_m3) == summary.worst
    assert [log_text(moment) for moment in summary.worst] == texts[-len(summary.worst) :]


def test_the_first_of_equal_frames_and_nothing_of_free_ones(results: list[FrameResult]) -> None:
    worst = WorstMoments(("a",) * 40)
    for result in results[:3]:
        worst.add(result)
    assert worst.moments() == ()
    for result in (results[-1], results[-1]):
        worst.add(result)
    assert {moment.frame for moment in worst.moments()} <= {results[-1].frame.index}


def test_a_line_names_frame_second_bodies_figure_and_command() -> None:
    moment = Moment(
        kind="recorded_penetration",
        frame=213,
        time_ns=7,
        time_s=2.13,
        bodies=("hand/tip", "door"),
        value=0.0065,
        unit="m",
    )
    assert log_text(moment) == (
        "deepest recorded overlap 6.5 mm: hand/tip in door; frame 213, 2.13 s; "
        "geomphys snapshot OUT --frame 213 -o frame_213.png"
    )
