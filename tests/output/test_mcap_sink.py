"""The output log, read by public libraries only: every channel holds what the frames held, and the same bytes twice."""

from __future__ import annotations

import resource
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2

from geomphys.config import Config
from geomphys.errors import DamagedLogError, GeomphysError, LogError, OutputError
from geomphys.output.attached_files import INDEX
from geomphys.output.mcap_sink import McapSink
from geomphys.output.provenance import Provenance
from geomphys.results import METHODS, FrameResult
from geomphys.scene.world import World
from tests.output.made_world import STEP, T0, frames

Decoded = list[tuple[int, Any]]


def write(
    path: Path,
    world: World,
    provenance: Provenance,
    results: list[FrameResult],
    *,
    complete: bool = True,
    **options: Any,
) -> None:
    sink = McapSink(path, **options)
    sink.open(world, Config(), provenance)
    try:
        for result in results:
            sink.write(result)
    except GeomphysError:
        sink.close(complete=False)
        raise
    sink.close(complete)


def decoded(path: Path, topic: str) -> Decoded:
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[Protobuf(), Ros2()], validate_crcs=True)
        found = []
        for _, _, message, content in reader.iter_decoded_messages(topics=[topic]):
            assert message.publish_time == message.log_time
            found.append((message.log_time, content))
        return found


def metadata(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        (record,) = make_reader(stream).iter_metadata()
    assert record.name == "geomphys"
    return record.metadata


def channels(path: Path) -> dict[str, tuple[str, str]]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    schemas = {number: schema.name for number, schema in summary.schemas.items()} | {0: ""}
    return {c.topic: (schemas[c.schema_id], c.message_encoding) for c in summary.channels.values()}


def poses(message: Any) -> dict[str, tuple[float, ...]]:
    return {
        t.child_frame_id: (
            *(t.translation.x, t.translation.y, t.translation.z),
            *(t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w),
        )
        for t in message.transforms
    }


@pytest.fixture
def results(world: World) -> list[FrameResult]:
    return frames(world, 60)


@pytest.fixture
def out(world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path) -> Path:
    write(tmp_path / "out.mcap", world, provenance, results)
    return tmp_path / "out.mcap"


def test_channels_are_those_promised(out: Path) -> None:
    assert channels(out) == {
        "/robot_description": ("std_msgs/msg/String", "cdr"),
        "/objects/robot_description": ("std_msgs/msg/String", "cdr"),
        "/meshes": ("foxglove.SceneUpdate", "protobuf"),
        "/recorded/meshes": ("foxglove.SceneUpdate", "protobuf"),
        "/tf": ("foxglove.FrameTransforms", "protobuf"),
        "/recorded/tf": ("foxglove.FrameTransforms", "protobuf"),
        "/joint_states": ("sensor_msgs/msg/JointState", "cdr"),
        "/contacts": ("geomphys.Contacts", "protobuf"),
        "/contacts/points": ("foxglove.PointCloud", "protobuf"),
        "/contacts/scene": ("foxglove.SceneUpdate", "protobuf"),
        "/penetration": ("geomphys.PenetrationDepths", "protobuf"),
        "/metrics": ("geomphys.FrameMetrics", "protobuf"),
        "/timing": ("geomphys.Timing", "protobuf"),
        "/log": ("foxglove.Log", "protobuf"),
    }


def test_poses_are_the_frames_bit_for_bit(out: Path, world: World, results: list[FrameResult]) -> None:
    for topic, prefix, of in (("/tf", "", lambda r: r.corrected), ("/recorded/tf", "recorded/", lambda r: r.recorded)):
        messages = decoded(out, topic)
        assert [t for t, _ in messages] == [r.frame.time_ns for r in results]
        for (time, message), result in zip(messages, results, strict=True):
            assert {t.timestamp.ToNanoseconds() for t in message.transforms} == {time}
            assert {t.parent_frame_id for t in message.transforms} == {"world"}
            for name, pose in poses(message).items():
                body = world.frame_names.index(name.removeprefix(prefix))
                assert np.array(pose).tobytes() == of(result)[body].tobytes()


def test_what_stands_still_is_in_the_first_transforms_only(out: Path) -> None:
    first, *others = [set(poses(message)) for _, message in decoded(out, "/tf")]
    assert first == {"palm", "finger", "table", "ball", "cup", "shelf"}
    assert {frozenset(names) for names in others} == {frozenset(first - {"table"})}
    recorded = {frozenset(poses(message)) for _, message in decoded(out, "/recorded/tf")}
    assert recorded == {frozenset({"recorded/palm", "recorded/finger", "recorded/cup"})}


def test_joint_states_hold_the_corrected_angles(out: Path, results: list[FrameResult]) -> None:
    for (time, message), result in zip(decoded(out, "/joint_states"), results, strict=True):
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == time
        assert list(message.name) == ["knuckle"]
        assert list(message.position) == result.angles.tolist()


def test_contacts_and_penetrations_name_bodies(out: Path, world: World, results: list[FrameResult]) -> None:
    for (_, message), (_, depths), result in zip(
        decoded(out, "/contacts"), decoded(out, "/penetration"), results, strict=True
    ):
        assert message.frame == depths.frame == result.frame.index
        assert [c.body_a for c in message.contacts] == [world.body_names[b] for b in result.contacts.body_a]
        assert [c.body_b for c in message.contacts] == ["table"] * len(result.contacts.depth)
        assert [c.depth for c in message.contacts] == result.contacts.depth.tolist()
        assert [(p.body_a, p.body_b) for p in depths.pairs] == [("hand/palm", "table")] * len(depths.pairs)
        assert [[p.pd.x, p.pd.y, p.pd.z] for p in depths.pairs] == result.penetrations.pd.tolist()
        assert [p.method for p in depths.pairs] == [METHODS[m] for m in result.penetrations.method]
        assert [(p.largest, p.convex_pairs) for p in depths.pairs] == [
            (largest, 2) for largest in result.penetrations.largest
        ]


def test_points_and_arrows_end_where_contacts_do(out: Path, results: list[FrameResult]) -> None:
    points = {t: len(m.data) // m.point_stride for t, m in decoded(out, "/contacts/points")}
    arrows = {t: sum(len(e.arrows) for e in m.entities) for t, m in decoded(out, "/contacts/scene")}
    assert points == arrows
    shown = 0
    for result in results:
        shown = points.get(result.frame.time_ns, shown)  # a viewer shows the last message
        assert shown == len(result.contacts.depth)
    assert len(points) < len(results)


def test_metrics_timing_and_log(out: Path, results: list[FrameResult]) -> None:
    for (_, message), result in zip(decoded(out, "/metrics"), results, strict=True):
        assert message.frame == result.frame.index
        assert {name: getattr(message, name) for name in result.metrics._fields} == result.metrics._asdict()
    for (_, message), result in zip(decoded(out, "/timing"), results, strict=True):
        assert tuple((s.name, s.ns, s.count) for s in message.stages) == result.timing
    lines = [(t, m.message, m.level, m.timestamp.ToNanoseconds()) for t, m in decoded(out, "/log")]
    time = results[10].frame.time_ns
    assert lines == [(time, "frame 10: a stream was held", 3, time)]


def test_metadata_and_attachments(out: Path, world: World, provenance: Provenance) -> None:
    record = metadata(out)
    assert record == provenance.record(complete=True)
    assert set(Config().as_dict()) < set(record)
    assert record["complete"] == "true"
    with out.open("rb") as stream:
        attached = {a.name: a.data for a in make_reader(stream).iter_attachments()}
    meshes = {name: data for name, data in attached.items() if name.startswith("meshes/") or name == INDEX}
    assert attached == {"scene.toml": world.path.read_bytes(), "hand.urdf": world.urdfs["hand"].read_bytes()} | meshes


def test_the_same_frames_give_the_same_bytes(
    out: Path, world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    again = tmp_path / "again.mcap"
    write(again, world, provenance, results)
    assert again.read_bytes() == out.read_bytes()


def test_without_timing_times_do_not_matter(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    write(one, world, provenance, results, timing=False)
    slower = [replace(r, timing=(("step", 10**9, 1),)) for r in results]
    write(other, world, provenance, slower, timing=False)
    assert one.read_bytes() == other.read_bytes()
    assert "/timing" not in channels(one)


def test_two_avatars_have_frames_and_topics_of_their_own(
    two_hands: World, provenance: Provenance, tmp_path: Path
) -> None:
    out = tmp_path / "out.mcap"
    results = frames(two_hands, 3)
    write(out, two_hands, provenance, results)
    assert {"/left/joint_states", "/right/joint_states", "/left/robot_description"} < set(channels(out))
    assert not {"/joint_states", "/robot_description"} & set(channels(out))
    assert {"left/palm", "right/finger", "ball"} < set(poses(decoded(out, "/tf")[0][1]))
    assert "recorded/left/palm" in poses(decoded(out, "/recorded/tf")[0][1])
    for column, name in enumerate(("left", "right")):
        assert [list(m.position) for _, m in decoded(out, f"/{name}/joint_states")] == [
            [r.angles[column]] for r in results
        ]


def test_links_of_the_robot_descriptions_are_frames_of_tf(
    world: World, two_hands: World, provenance: Provenance, tmp_path: Path
) -> None:
    for number, scene in enumerate((world, two_hands)):
        out = tmp_path / f"{number}.mcap"
        write(out, scene, provenance, frames(scene, 1))
        links: set[str] = set()
        for topic in channels(out):
            if topic.endswith("robot_description"):
                robot = etree.fromstring(decoded(out, topic)[0][1].data.encode())
                links |= {link.get("name") for link in robot.iter("link")}
                ends = {e.get("link") for joint in robot.iter("joint") for e in joint if e.get("link")}
                assert ends <= links
                assert not list(robot.iter("mesh"))
        assert links - {"world"} == set(poses(decoded(out, "/tf")[0][1]))


def test_a_run_that_ends_early_leaves_a_readable_partial_file(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    out = tmp_path / "out.mcap"
    write(out, world, provenance, results[:7], complete=False)
    assert [p.name for p in tmp_path.glob("*.mcap")] == ["log.mcap", "out.partial.mcap"]
    assert [p for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    partial = tmp_path / "out.partial.mcap"
    assert metadata(partial)["complete"] == "false"
    assert len(decoded(partial, "/tf")) == 7


def test_an_exception_in_the_block_makes_it_partial(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    with pytest.raises(KeyboardInterrupt), McapSink(tmp_path / "out.mcap") as sink:  # noqa: PT012
        sink.open(world, Config(), provenance)
        sink.write(results[0])
        raise KeyboardInterrupt
    assert (tmp_path / "out.partial.mcap").exists()
    assert not (tmp_path / "out.mcap").exists()


def test_a_run_without_frames_is_readable(world: World, provenance: Provenance, tmp_path: Path) -> None:
    write(tmp_path / "out.mcap", world, provenance, [])
    assert decoded(tmp_path / "out.mcap", "/tf") == []
    assert metadata(tmp_path / "out.mcap")["complete"] == "true"


def test_an_output_that_exists_is_kept_without_force(
    out: Path, world: World, provenance: Provenance, results: list[FrameResult]
) -> None:
    before = out.read_bytes()
    with pytest.raises(OutputError, match=r"exists already.*--force"):
        write(out, world, provenance, results[:1])
    assert out.read_bytes() == before
    write(out, world, provenance, results[:1], force=True)
    assert len(decoded(out, "/tf")) == 1


def test_a_folder_that_is_missing_is_named(world: World, provenance: Provenance, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"nowhere does not exist"):
        write(tmp_path / "nowhere" / "out.mcap", world, provenance, [])


def with_nan(result: FrameResult, name: str) -> FrameResult:
    if name in ("corrected", "recorded", "angles"):
        values = getattr(result, name).copy()
        values.flat[-1] = np.nan
        return replace(result, **{name: values})
    if name == "metrics":
        return replace(result, metrics=result.metrics._replace(correction_m=float("inf")))
    part, column = name.split(".")
    values = getattr(getattr(result, part), column).copy()
    values.flat[0] = np.inf
    return replace(result, **{part: getattr(result, part)._replace(**{column: values})})


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("corrected", "corrected pose of shelf"),
        ("recorded", "recorded pose of shelf"),
        ("angles", "angle"),
        ("contacts.point", "contact point"),
        ("contacts.normal_impulse", "contact normal_impulse"),
        ("penetrations.pd", "penetration pd"),
        ("metrics", "metric"),
    ],
)
def test_no_number_that_is_not_finite_gets_in(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path, name: str, told: str
) -> None:
    sink = McapSink(tmp_path / "out.mcap")
    sink.open(world, Config(), provenance)
    sink.write(results[3])
    with pytest.raises(OutputError, match=f"frame 4: .*{told}.*not finite"):
        sink.write(with_nan(results[4], name))
    sink.close(complete=False)
    assert len(decoded(tmp_path / "out.partial.mcap", "/tf")) == 1


@pytest.mark.parametrize("start", [0, 1, 127, 128 * 10**9, 999_999_999, 5 * 10**9, 2**31 * 10**9 - 3 * STEP])
def test_clocks_may_start_anywhere_from_zero(world: World, provenance: Provenance, tmp_path: Path, start: int) -> None:
    results = frames(world, 3, start=start)
    out = tmp_path / "out.mcap"
    write(out, world, provenance, results)
    for topic in ("/tf", "/contacts", "/metrics"):
        assert [t for t, _ in decoded(out, topic)] == [start, start + STEP, start + 2 * STEP]
    for time, message in decoded(out, "/tf"):
        assert {t.timestamp.ToNanoseconds() for t in message.transforms} == {time}


@pytest.mark.parametrize("start", [-1, -(10**18), 2**31 * 10**9])
def test_times_that_cannot_be_written_are_told(
    world: World, provenance: Provenance, tmp_path: Path, start: int
) -> None:
    with pytest.raises(OutputError, match=r"frame 0: the time .* between 0"):
        write(tmp_path / "out.mcap", world, provenance, frames(world, 1, start=start))


def test_a_full_disk_is_told_and_leaves_nothing(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    sink = McapSink(tmp_path / "out.mcap")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, hard))
    try:
        sink.open(world, Config(), provenance)
        with pytest.raises(OutputError, match=r"cannot be written"):  # noqa: PT012
            for result in results * 100:
                sink.write(result)
        with pytest.raises(OutputError, match=r"cannot be written"):
            sink.close(complete=False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.glob("*out*"))


def log_file(path: Path, damage: Callable[[bytes], bytes] = lambda data: data) -> list[tuple[str, str, int, bytes]]:
    """A log of two channels, logged before, among and after the frames."""
    rows = []
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=200)
        writer.start()
        schema = writer.register_schema("S", "jsonschema", b"{}")
        topics = {"/a": writer.register_channel("/a", "json", schema), "/b": writer.register_channel("/b", "json", 0)}
        for i in range(50):
            topic, time, data = "/a" if i % 3 else "/b", T0 + (i - 5) * STEP // 2, f'{{"i": {i}}}'.encode()
            writer.add_message(topics[topic], time, data, time + 1, sequence=i)
            rows.append((f"/input{topic}", time, i, data))
        writer.finish()
    path.write_bytes(damage(path.read_bytes()))
    return rows


def copied(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as stream:
        messages = make_reader(stream).iter_messages(topics=["/input/a", "/input/b"])
        return [(c.topic, m.log_time, m.sequence, m.data) for _, c, m in messages if m.publish_time == m.log_time + 1]


def test_the_input_is_copied_whole(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    log, out = tmp_path / "input.mcap", tmp_path / "out.mcap"
    rows = log_file(log)
    write(out, world, provenance, results[:10], copy_input=log)
    assert copied(out) == rows
    assert channels(out)["/input/a"] == ("S", "json")
    bag = tmp_path / "bag"
    bag.mkdir()
    log.rename(bag / "bag_0.mcap")
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {relative_file_paths: [bag_0.mcap]}")
    write(out, world, provenance, results[:10], copy_input=bag, force=True)
    assert copied(out) == rows


def test_a_damaged_input_is_copied_as_far_as_it_goes_only_on_request(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    log, out = tmp_path / "input.mcap", tmp_path / "out.mcap"
    rows = log_file(log, lambda data: data[: len(data) // 2])
    with pytest.raises(DamagedLogError, match=r"--recover"):
        write(out, world, provenance, results[:10], copy_input=log)
    sink = McapSink(out, copy_input=log, force=True)
    sink.open(world, Config(recover=True), provenance)
    sink.write(results[0])
    sink.close(complete=True)
    assert 0 < len(copied(out)) < len(rows)
    assert copied(out) == rows[: len(copied(out))]


def test_an_input_that_is_overwritten_meanwhile_costs_no_frame(
    world: World, provenance: Provenance, results: list[FrameResult], tmp_path: Path
) -> None:
    log, out = tmp_path / "input.mcap", tmp_path / "out.mcap"
    log_file(log)
    sink = McapSink(out, copy_input=log)
    sink.open(world, Config(), provenance)
    with log.open("r+b") as stream:
        size = log.stat().st_size
        stream.seek(size // 8)
        stream.write(bytes(size // 2))
    for result in results[:10]:
        sink.write(result)
    with pytest.raises(LogError, match="changed while it was read"):
        sink.close(complete=True)
    with (tmp_path / "out.partial.mcap").open("rb") as stream:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages(topics=["/tf"])]
    assert times == [result.frame.time_ns for result in results[:10]]


def test_it_means_to_the_judge_what_it_holds(
    shared_dir: Path, monkeypatch: pytest.MonkeyPatch, out: Path, results: list[FrameResult]
) -> None:
    monkeypatch.syspath_prepend(shared_dir / "checks")
    import channels as judge  # type: ignore[import-not-found]

    found = judge.contacts(out)
    assert len(found) == sum(len(r.contacts.depth) for r in results)
    assert all(c.point is not None and abs(np.linalg.norm(c.normal) - 1) < 1e-12 and c.depth > 0 for c in found)
    depths = judge.penetrations(out)
    assert all(p.vector is not None and p.largest is not None and p.method in METHODS for p in depths)
    metrics = judge.metrics(out)
    assert metrics["recorded_penetration_m"].tolist() == [r.metrics.recorded_penetration_m for r in results]
    assert judge.timing(out).tolist() == [20000.0] * len(results)
    assert judge.joint_states(out, "/joint_states")[1]["knuckle"].tolist() == [r.angles[0] for r in results]
