"""The pipeline as a whole: what it measures is what is there, sinks see every frame, chunks leave no seam."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.engine.frame_buffer import FRAMES, RESERVE
from geomphys.engine.pipeline import Pipeline
from geomphys.errors import InputError
from geomphys.replays import replay
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_STARTED_INSIDE, FrameResult
from tests.driven.logs import Engine, Run, Thing, assert_free, line, play, wander

TABLE = Thing(name="table", shape=("box", 2, 2, 0.1), at=(0, 0, -0.05))
CUBE = ("box", 0.1, 0.1, 0.1)


class Notes:
    """A sink that writes down how it is called."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def open(self, world: Any, config: Any, provenance: Any) -> None:
        self.calls.append("open")

    def write(self, result: FrameResult) -> None:
        self.calls.append(result.frame.index)

    def close(self, complete: bool) -> None:
        self.calls.append(("close", complete))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pipeline")


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    """More frames than a block holds, twice over, in and out of a table and a post."""
    walk = wander(np.random.default_rng(4), 2 * FRAMES + 10, 0.15, 0.6, turn=0.2) + np.array([0, 0, 0.08, 0, 0, 0, 0])
    path = np.vstack([line((0.6, 0.6, 0.8, *walk[0, 3:]), walk[0], frames=[20])[:-1], walk])
    things = [
        TABLE,
        Thing(name="post", shape=("cylinder", 0.03, 0.4)),
        Thing(name="cube", shape=CUBE, role="driven", path=path),
    ]
    return play(folder, things)


def test_every_frame_has_its_result_in_order(run: Run) -> None:
    assert [r.frame.index for r in run.results] == list(range(2 * FRAMES + 30))
    assert (np.diff([r.frame.time_ns for r in run.results]) > 0).all()
    assert_free(run, every=2)


def test_recorded_penetration_is_what_coal_measures(run: Run) -> None:
    engine = Engine(run.world)
    for result in run.results[::3]:
        expected = engine.deepest(result.recorded)
        assert result.metrics.recorded_penetration_m == pytest.approx(expected, abs=2e-6)


def test_residual_is_measured_where_there_is_no_way_out(tmp_path: Path) -> None:
    """Two blocks of a cubic kilometre close on a cube: it must overlap, and the figure says by how much."""
    n = 30
    x = np.concatenate([np.linspace(0.2, 0.09, n), np.full(5, 0.09)])
    jaws = [
        Thing(name=name, shape=("box", 1000, 1000, 1000), path=np.column_stack([s * (x + 499.95), 0 * x, 0 * x]))
        for name, s in (("w", -1), ("e", 1))
    ]
    run = play(tmp_path, [*jaws, Thing(name="cube", shape=CUBE, role="driven", path=np.zeros((len(x), 3)))])
    engine = Engine(run.world)
    expected = [engine.deepest(poses) for poses in run.corrected]
    assert run.residual[-1] >= 0.01 - 1e-6
    assert run.residual == pytest.approx(expected, abs=2e-6)
    over = run.residual > 1e-5
    assert over.any()
    assert ((run.figures("flags").astype(int) & FLAG_NOT_CONVERGED)[over] > 0).all()
    assert np.isfinite(run.corrected).all()


def test_an_overlap_of_simulated_bodies_is_told_too(tmp_path: Path) -> None:
    """One starts in the floor; later a fixed block comes down on it, to less than it is high."""
    down = np.tile([0.0, 0.0, 0.5], (30, 1))
    down[20:, 2] = np.linspace(0.5, 0.13, 10)
    things = [
        Thing(name="floor", shape=("box", 100, 100, 1), at=(0, 0, -0.5)),
        Thing(name="press", shape=("box", 100, 100, 0.1), path=down),
        Thing(name="cube", shape=CUBE, role="simulated", at=(0, 0, 0.04), extra="density = 500"),
    ]
    run = play(tmp_path, things)
    flags, over = run.figures("flags").astype(int), run.residual > 1e-5
    assert run.residual[0] == pytest.approx(0.01, abs=1e-6)
    assert flags[0] == FLAG_STARTED_INSIDE
    assert not over[5:20].any()
    assert over[-1]
    assert (((flags & FLAG_NOT_CONVERGED) != 0) == over)[1:].all()


def test_correction_is_how_far_bodies_are_from_the_recording(run: Run) -> None:
    far = np.linalg.norm(run.corrected[..., :3] - run.recorded[..., :3], axis=2).max(axis=1)
    assert run.figures("correction_m") == pytest.approx(far, abs=1e-12)
    assert (run.figures("correction_rad") == 0.0).all()  # rigid: translation only


def test_contacts_lie_on_both_surfaces(run: Run) -> None:
    """On the table's top or the post's side, where the cube has a corner, an edge or a face; normals out of b into a."""
    names, seen = run.world.body_names, 0
    for result in run.results:
        c = result.contacts
        for k in range(len(c.depth)):
            assert np.linalg.norm(c.normal[k]) == pytest.approx(1.0, abs=1e-9)
            a, b = names[c.body_a[k]], names[c.body_b[k]]
            sign = 1.0 if a == "cube" else -1.0
            if "table" in (a, b) and abs(c.normal[k, 2]) > 0.999:
                assert sign * c.normal[k, 2] > 0
                assert (
                    -1e-5 <= c.point[k, 2] <= 2.5e-3
                )  # of a face that lies all but flat, some corners are a bit above
                seen += abs(c.point[k, 2]) <= 1e-5
            if "post" in (a, b) and abs(c.normal[k, 2]) < 1e-9:
                assert -2e-5 <= np.hypot(*c.point[k, :2]) - 0.03 <= 2.5e-3
                assert sign * (c.point[k, :2] @ c.normal[k, :2]) > 0
            assert c.depth[k] >= 0.0
    assert seen > 10


def test_a_cube_lying_on_a_table_touches_at_four_corners(tmp_path: Path) -> None:
    path = np.vstack([line((0, 0, 0.2), (0, 0, 0.04), frames=[10]), np.tile([0, 0, 0.04], (10, 1))])
    run = play(tmp_path, [TABLE, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    contacts = run.results[-1].contacts
    assert sorted(np.round(contacts.point[:, :2], 6).tolist()) == [
        [-0.05, -0.05],
        [-0.05, 0.05],
        [0.05, -0.05],
        [0.05, 0.05],
    ]
    assert contacts.depth == pytest.approx(0.01, abs=5e-6)


def test_a_seam_between_chunks_is_not_seen(run: Run, folder: Path) -> None:
    """Results do not depend on where the blocks begin: a replay that starts later in a free place ends the same."""
    free = np.flatnonzero(~run.touched())
    start = int(next(k for k in free if k >= 7 and run.residual[k] == 0.0))
    config = Config(start=start / 60 - 1e-4)
    later = list(replay(folder / "log.mcap", run.world, config=config))
    assert len(later) == len(run.results) - start
    settled = start + 1
    assert np.abs(np.array([r.corrected for r in later])[1:] - run.corrected[settled:]).max() <= 1e-9


def test_a_block_that_is_full_before_its_frames_are_done_loses_and_repeats_none(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rest of them is stepped into the other block: from where it was, and with its own recorded rows."""
    calls: list[tuple[int, int]] = []
    whole = Pipeline.run

    def noted(self: Pipeline, roots: Any, *others: Any) -> int:
        count = whole(self, roots, *others)
        calls.append((len(roots), count))
        return count

    monkeypatch.setattr(Pipeline, "run", noted)
    monkeypatch.setattr("geomphys.engine.frame_buffer.CONTACTS", RESERVE + 8)
    again = list(replay(folder / "log.mcap", run.world))
    assert sum(count < frames for frames, count in calls) > 5
    assert len(again) == len(run.results)
    for one, other in zip(run.results, again, strict=True):
        assert one.frame.index == other.frame.index
        assert one.recorded.tobytes() == other.recorded.tobytes()
        assert one.corrected.tobytes() == other.corrected.tobytes()
        assert one.contacts.point.tobytes() == other.contacts.point.tobytes()
        assert one.penetrations.pd.tobytes() == other.penetrations.pd.tobytes()
        assert one.metrics == other.metrics


def test_results_stay_valid_when_the_next_come(run: Run, folder: Path) -> None:
    copies = [(r, r.corrected.copy(), r.contacts.point.copy()) for r in replay(folder / "log.mcap", run.world)]
    for result, corrected, points in copies:
        assert result.corrected.tobytes() == corrected.tobytes()
        assert result.contacts.point.tobytes() == points.tobytes()


def test_sinks_are_opened_written_and_closed_once(run: Run, folder: Path) -> None:
    notes, done = Notes(), []
    list(replay(folder / "log.mcap", run.world, sinks=[notes], progress=lambda k, n: done.append((k, n))))
    count = len(run.results)
    assert notes.calls == ["open", *range(count), ("close", True)]
    assert [k for k, _ in done] == list(range(1, count + 1))


def test_sinks_learn_that_the_caller_stopped(run: Run, folder: Path) -> None:
    notes = Notes()
    frames = replay(folder / "log.mcap", run.world, sinks=[notes])
    next(frames)
    frames.close()
    assert notes.calls == ["open", 0, ("close", False)]


def test_an_error_closes_every_sink_as_incomplete(run: Run, folder: Path) -> None:
    class Broken(Notes):
        def write(self, result: FrameResult) -> None:
            raise RuntimeError("full")

    first, second = Notes(), Broken()
    with pytest.raises(RuntimeError, match="full"):
        list(replay(folder / "log.mcap", run.world, sinks=[first, second]))
    assert first.calls == ["open", 0, ("close", False)]
    assert second.calls == ["open", ("close", False)]


def test_timing_names_every_stage(run: Run) -> None:
    for result in run.results[::20]:
        names = [name for name, _, _ in result.timing]
        assert {name.split(".")[0] for name in names} == {"decode", "step", "encode"}
        times = {name: ns for name, ns, _ in result.timing}
        children = sum(ns for name, ns in times.items() if name.count(".") == 1 and name.startswith("step."))
        assert 0 < children <= 1.01 * times["step"] + 1000


def test_a_log_that_is_missing_is_an_error(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        list(replay(tmp_path / "none.mcap", run.world))
