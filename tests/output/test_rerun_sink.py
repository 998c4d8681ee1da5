"""The rerun recording, read back chunk by chunk: what it draws and plots is what the frames held."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from geomphys.config import Config
from geomphys.errors import OutputError
from geomphys.output import colours, rerun_sink
from geomphys.output.contact_arrows import arrow_lengths
from geomphys.output.provenance import Provenance
from geomphys.output.rerun_sink import RerunSink
from geomphys.output.worst_moments import WorstMoments, command_text, document_text, log_text
from geomphys.results import FrameResult, Moment
from geomphys.scene.world import World
from geomphys.viewer.view import offline_environment, viewer_command
from tests.output.made_world import STEP, T0, frames

COUNT = 60


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_sink, "BATCH_FRAMES", 25)


def write(
    path: Path,
    world: World,
    provenance: Provenance,
    results: list[FrameResult],
    complete: bool = True,
    force: bool = False,
) -> None:
    sink = RerunSink(path, force=force)
    sink.open(world, Config(), provenance)
    for result in results:
        sink.write(result)
    sink.close(complete)


@pytest.fixture
def results(world: World) -> list[FrameResult]:
    return frames(world, COUNT)


@pytest.fixture
def out(world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path) -> Path:
    write(tmp_path / "out.rrd", world, provenance, results)
    return tmp_path / "out.rrd"


def columns(path: Path, entity: str, component: str) -> Iterator[tuple[int | None, int | None, Any]]:
    """Frame, time [ns] and value of a component of an entity; static ones have neither."""
    for chunk in RrdReader(path).stream():
        if str(chunk.entity_path) != entity:
            continue
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            none = [None] * batch.num_rows
            timed = "frame" in batch.schema.names
            names = batch["frame"].to_pylist() if timed else none
            times = batch["time"].cast(pa.int64()).to_pylist() if timed else none
            yield from zip(names, times, batch[component].to_pylist(), strict=True)


def latest(path: Path, entity: str, component: str) -> list[Any]:
    """What the viewer shows in each frame: the last value up to it, a static one above all."""
    rows = list(columns(path, entity, component))
    static = [value for frame, _, value in rows if frame is None]
    by_frame = {frame: value for frame, _, value in rows}
    shown, value = [], None
    for frame in range(COUNT):
        value = static[0] if static else by_frame.get(frame, value)
        shown.append(value)
    return shown


def rgba(value: Any) -> tuple[int, ...]:
    return tuple(int(value[0]).to_bytes(4, "big"))


def test_poses_shown_are_the_corrected_ones(out: Path, world: World, results: list[FrameResult]) -> None:
    for body, name in enumerate(world.body_names):
        places = latest(out, f"/world/bodies/{name}", "Transform3D:translation")
        turns = latest(out, f"/world/bodies/{name}", "Transform3D:quaternion")
        for result, place, turn in zip(results, places, turns, strict=True):
            expected = results[0] if name == "table" else result  # it stands still
            assert place[0] == expected.corrected[body, :3].astype(np.float32).tolist()
            assert turn[0] == expected.corrected[body, 3:].astype(np.float32).tolist()


def test_colours_tell_the_state_and_ghosts_stand_where_bodies_were_moved(
    out: Path, world: World, results: list[FrameResult]
) -> None:
    for body, name in enumerate(("hand/palm", "hand/finger")):
        shown = latest(out, f"/world/bodies/{name}", "Mesh3D:albedo_factor")
        ghost = latest(out, f"/world/recorded/{name}", "Mesh3D:albedo_factor")
        place = latest(out, f"/world/recorded/{name}", "Transform3D:translation")
        for i, result in enumerate(results):
            is_corrected = not np.array_equal(result.recorded[body], result.corrected[body])
            touches = body in result.contacts.body_a
            state = colours.IN_CONTACT if touches else colours.CORRECTED if is_corrected else colours.FREE
            assert rgba(shown[i]) == state
            assert rgba(ghost[i]) == (colours.GHOST if is_corrected else colours.HIDDEN)
            if is_corrected:
                assert place[i][0] == result.recorded[body, :3].astype(np.float32).tolist()


def test_contacts_are_drawn_while_they_last(out: Path, results: list[FrameResult]) -> None:
    points = latest(out, "/world/contacts/points", "Points3D:positions")
    origins = latest(out, "/world/contacts/normals", "Arrows3D:origins")
    vectors = latest(out, "/world/contacts/normals", "Arrows3D:vectors")
    for i, result in enumerate(results):
        assert points[i] == origins[i] == result.contacts.point.astype(np.float32).tolist()
        seconds = 0.0 if i == 0 else 1e-9 * (result.frame.time_ns - results[i - 1].frame.time_ns)
        lengths = arrow_lengths(result.contacts, np.full(len(points[i]), seconds))
        expected = result.contacts.normal * lengths[:, None]
        assert np.allclose(np.reshape(vectors[i], (-1, 3)), expected, atol=1e-6)
        depths = latest(out, "/world/penetration_depths", "Arrows3D:vectors")[i] if i < 8 else None
        if depths is not None:
            along = np.cross(np.reshape(depths, (-1, 3)), result.penetrations.pd)
            assert len(depths) == len(result.penetrations.largest)
            assert np.allclose(along, 0, atol=1e-6)


@pytest.mark.parametrize(
    ("plot", "figure"),
    [
        ("penetration_mm/recorded", lambda r: 1e3 * r.metrics.recorded_penetration_m),
        ("penetration_mm/remaining", lambda r: 1e3 * r.metrics.residual_penetration_m),
        (
            "penetration_mm/global",
            lambda r: 1e3 * max(map(float, np.linalg.norm(r.penetrations.pd, axis=1)), default=0),
        ),
        ("correction/mm", lambda r: 1e3 * r.metrics.correction_m),
        ("contacts/contacts", lambda r: r.metrics.contacts),
        ("stages_us/step", lambda r: 20.0),
        ("stages_us/step.overlap", lambda r: 9.0),
    ],
)
def test_plots_are_the_figures_on_both_timelines(out: Path, results: list[FrameResult], plot: str, figure: Any) -> None:
    rows = [(f, t, v[0]) for f, t, v in columns(out, f"/plots/{plot}", "Scalars:scalars") if f is not None]
    assert [f for f, _, _ in rows] == list(range(COUNT))
    assert [t for _, t, _ in rows] == [T0 + STEP * i for i in range(COUNT)]
    assert [v for _, _, v in rows] == pytest.approx([figure(r) for r in results])


def test_clocks_that_do_not_count_from_1970_are_durations(world: World, provenance: Provenance, tmp_path: Path) -> None:
    for start, kind in ((5 * 10**9, pa.duration("ns")), (T0, pa.timestamp("ns"))):
        out = tmp_path / f"{start}.rrd"
        write(out, world, provenance, frames(world, 3, start=start))
        batches = [chunk.to_record_batch() for chunk in RrdReader(out).stream()]
        assert {b.schema.field("time").type for b in batches if "frame" in b.schema.names} == {kind}
        assert next(columns(out, "/plots/contacts/contacts", "Scalars:scalars"))[:2] == (0, start)


def test_log_lines_are_in_it(out: Path) -> None:
    lines = [(f, v[0]) for f, _, v in columns(out, "/log", "TextLog:text")]
    assert lines == [(10, "frame 10: a stream was held")]


def test_the_viewer_finds_no_fault_and_two_runs_equal(
    out: Path, world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    other = tmp_path / "other.rrd"
    write(other, world, provenance, results)
    for command in (["rrd", "verify", str(out)], ["rrd", "compare", "--unordered", str(out), str(other)]):
        done = subprocess.run(
            [*viewer_command(), *command], env=offline_environment(), capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def test_it_opens_on_the_scene_with_plots_under_it(out: Path) -> None:
    paths = {str(chunk.entity_path) for chunk in RrdReader(out).stream(store=RrdReader(out).blueprints()[0])}
    assert any(path.startswith("/view/") and path.endswith("EyeControls3D") for path in paths)


def test_properties_tell_where_it_comes_from(out: Path, provenance: Provenance) -> None:
    for key, value in provenance.record(complete=True).items():
        assert [v[0] for _, _, v in columns(out, "/__properties/geomphys", key)] == [value]


def test_a_run_that_ends_early_is_named_partial(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    write(tmp_path / "out.rrd", world, provenance, results[:3], complete=False)
    assert [p.name for p in tmp_path.glob("*rrd*")] == ["out.partial.rrd"]
    partial = list(columns(tmp_path / "out.partial.rrd", "/__properties/geomphys", "complete"))
    assert partial[0][2] == ["false"]
    write(tmp_path / "empty.rrd", world, provenance, [])
    assert (tmp_path / "empty.rrd").exists()


def test_an_output_that_exists_is_kept_without_force(
    out: Path, world: World, provenance: Provenance, results: list[FrameResult]
) -> None:
    with pytest.raises(OutputError, match="exists already"):
        write(out, world, provenance, results)
    write(out, world, provenance, results[:1], force=True)


def test_no_number_that_is_not_finite_gets_in(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    sink = RerunSink(tmp_path / "out.rrd")
    sink.open(world, Config(), provenance)
    with pytest.raises(OutputError, match=r"frame 0: .*not finite"):
        sink.write(replace(results[0], corrected=results[0].corrected * np.nan))
    sink.close(complete=False)


def test_the_callers_strictness_is_left_as_it_was(out: Path) -> None:
    assert not rr.strict_mode()


def test_joint_values_and_flags_are_columns(out: Path, world: World, results: list[FrameResult]) -> None:
    for joint, name in enumerate(world.dof_names):
        tree = world.tree_names[world.scene.dofs.tree[joint]]
        shown = [value[0] for _, _, value in columns(out, f"/joint_states/{tree}/{name}", "Scalars:scalars")]
        assert shown == [result.angles[joint] for result in results]
        recorded = [
            value[0] for _, _, value in columns(out, f"/recorded/joint_states/{tree}/{name}", "Scalars:scalars")
        ]
        assert recorded == [result.frame.angles[joint] for result in results]
    held = [value[0] for _, _, value in columns(out, "/metrics/flags", "held")]
    assert held == [bool(result.metrics.flags & 1) for result in results]
    assert any(held)
    for name in ("correction_m", "contacts_recorded", "shape_change_rad"):
        values = [value[0] for _, _, value in columns(out, "/metrics", name)]
        assert values == [getattr(result.metrics, name) for result in results]


def test_the_worst_moments_are_marked_where_they_happen(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    moments = tuple(
        Moment(kind="correction", frame=k, time_ns=T0 + STEP * k, time_s=0.0, bodies=("hand",), value=0.01, unit="m")
        for k in (41, 3)
    )
    write(tmp_path / "out.rrd", world, provenance, [*results[:-1], replace(results[-1], moments=moments)])
    lines = {
        frame: (time, value[0])
        for frame, time, value in columns(tmp_path / "out.rrd", "/log", "TextLog:text")
        if "largest" in value[0]
    }
    assert lines == {m.frame: (m.time_ns, log_text(m)) for m in moments}


def test_the_first_window_says_where_to_look_with_whole_commands(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    """In a document, which the viewer wraps: it cuts lines of the log that are longer than its column."""
    write(tmp_path / "out.rrd", world, provenance, results)
    worst = WorstMoments(world.body_names)
    for result in results:
        worst.add(result)
    ((_, _, (text,)),) = columns(tmp_path / "out.rrd", "/worst_moments", "TextDocument:text")
    assert text == document_text(worst.moments())
    assert all(command_text(moment) in text for moment in worst.moments())
