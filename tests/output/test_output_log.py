"""Outputs read back equal the frames they were written from."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.writer import Writer

from geomphys.config import Config
from geomphys.errors import DamagedLogError, LogError
from geomphys.output.decoders import decode_transforms
from geomphys.output.mcap_sink import McapSink
from geomphys.output.output_log import OutputFrame, is_output, open_output
from geomphys.output.provenance import provenance_of
from geomphys.results import METHODS, FrameResult
from geomphys.scene.world import World
from tests.output.made_world import frames, make_world


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"), avatars=("left", "right"))


@pytest.fixture(scope="module")
def results(world: World) -> list[FrameResult]:
    return frames(world, 90, start=997 * 10**6)  # a second's turn changes the length of times


@pytest.fixture(scope="module")
def out(world: World, results: list[FrameResult], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("out") / "out.mcap"
    with McapSink(path, copy_input=None) as sink:
        sink.open(world, Config(seed=3), provenance_of(world.path, world, Config(seed=3)))
        for result in results:
            sink.write(result)
    return path


def check(frame: OutputFrame, result: FrameResult, world: World) -> None:
    assert (frame.index, frame.time_ns) == (result.frame.index, result.frame.time_ns)
    for name, pose in zip(frame.tf.names, frame.tf.values, strict=True):
        assert pose.tobytes() == result.corrected[world.frame_names.index(name)].tobytes()
    for name, pose in zip(frame.recorded.names, frame.recorded.values, strict=True):
        assert pose.tobytes() == result.recorded[world.frame_names.index(name.removeprefix("recorded/"))].tobytes()
    assert [v.values.tolist() for v in frame.joints.values()] == [[a] for a in result.angles]
    assert {v.names for v in frame.joints.values()} == {("knuckle",)}
    contacts = result.contacts
    assert [c.body_a for c in frame.contacts] == [world.body_names[b] for b in contacts.body_a]
    assert [c.point for c in frame.contacts] == [tuple(p) for p in contacts.point]
    assert [c.normal for c in frame.contacts] == [tuple(n) for n in contacts.normal]
    assert [(c.depth, c.normal_impulse, c.tangential_impulse) for c in frame.contacts] == list(
        zip(contacts.depth, contacts.normal_impulse, contacts.tangential_impulse, strict=True)
    )
    pairs = result.penetrations
    assert [(p.pd, p.largest, p.method) for p in frame.penetrations] == [
        (tuple(pd), largest, METHODS[m]) for pd, largest, m in zip(pairs.pd, pairs.largest, pairs.method, strict=True)
    ]
    assert frame.metrics == {"frame": result.frame.index, **result.metrics._asdict()}
    assert frame.timing == result.timing
    assert frame.log == result.messages


def test_frames_are_what_was_written(out: Path, world: World, results: list[FrameResult]) -> None:
    read = list(open_output(out).frames())
    assert len(read) == len(results)
    for frame, result in zip(read, results, strict=True):
        check(frame, result, world)
    assert set(read[0].tf.names) - set(read[1].tf.names) == {"table"}
    assert set(read[0].joints) == {"/left/joint_states", "/right/joint_states"}


def test_only_what_is_asked_for_is_decoded(out: Path, results: list[FrameResult]) -> None:
    log = open_output(out)
    read = list(log.frames(["/contacts"]))
    assert [len(f.contacts) for f in read] == [len(r.contacts.depth) for r in results]
    assert [f.index for f in read] == list(range(len(results)))
    assert all(len(f.tf.names) == len(f.joints) == len(f.metrics) == 0 for f in read)
    with pytest.raises(ValueError, match="no such channel"):
        next(log.frames(["/nothing"]))


def test_head_of_the_file(out: Path, world: World, results: list[FrameResult]) -> None:
    log = open_output(str(out))
    assert log.complete
    assert log.frame_count == log.counts["/metrics"] == len(results)
    assert (log.start_ns, log.end_ns) == (results[0].frame.time_ns, results[-1].frame.time_ns)
    assert log.parameters["seed"] == "3"
    assert set(log.parameters) == set(Config().as_dict())
    assert log.joint_topics == ("/left/joint_states", "/right/joint_states")
    assert log.attachments()["scene.toml"] == world.path.read_bytes()
    assert "/contacts/scene" in log.topics


def test_columns(out: Path, results: list[FrameResult]) -> None:
    log = open_output(out)
    columns = log.metrics()
    assert columns["time_ns"].tolist() == [r.frame.time_ns for r in results]
    for name in results[0].metrics._fields:
        assert columns[name].tolist() == [getattr(r.metrics, name) for r in results]
    stages = log.timing()
    assert list(stages) == ["decode", "step", "step.overlap"]
    assert stages["decode"].ns.tolist() == [1000 + r.frame.index for r in results]
    assert stages["step.overlap"].counts.tolist() == [3] * len(results)
    assert stages["step"].frames.tolist() == list(range(len(results)))


def test_a_frame_is_found_by_its_number(out: Path, results: list[FrameResult]) -> None:
    log = open_output(out)
    assert log.time_of(17) == results[17].frame.time_ns
    with pytest.raises(LogError, match=r"no frame 90; its last one is 89"):
        log.time_of(90)


def test_a_sample_is_spread_over_the_time(out: Path, results: list[FrameResult]) -> None:
    places = [p.values[:, 2] for p in open_output(out).sample(4)]
    assert len(places) == 4
    assert places[0].max() == results[0].corrected[:, 2].max()
    assert places[3].max() == results[-1].corrected[:, 2].max()


def test_what_is_no_output_is_told(out: Path, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        open_output(tmp_path / "nothing.mcap")
    os.mkfifo(tmp_path / "pipe.mcap")
    for special in (tmp_path / "pipe.mcap", Path("/dev/zero")):
        assert not is_output(special)
        with pytest.raises(LogError, match=r"cannot be read.*no regular file"):
            open_output(special)
    text = tmp_path / "text.mcap"
    for content in (b"", b"no log", b"x" * 1000):
        text.write_bytes(content)
        with pytest.raises(DamagedLogError, match=r"text.mcap: is no MCAP"):
            open_output(text)
    other = tmp_path / "other.mcap"
    with other.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(LogError, match="is no output of geomphys"):
        open_output(other)


@pytest.mark.parametrize("part", [0.01, 0.3, 0.7, 0.99, 0.9999])
def test_a_file_that_was_cut_off_is_told(out: Path, tmp_path: Path, part: float) -> None:
    cut = tmp_path / "cut.mcap"
    data = out.read_bytes()
    cut.write_bytes(data[: int(len(data) * part)])
    with pytest.raises(DamagedLogError, match=r"cut.mcap"):
        open_output(cut)


def test_damage_in_the_middle_is_told(out: Path, tmp_path: Path) -> None:
    data = bytearray(out.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(data)
    with pytest.raises(DamagedLogError, match=r"bad.mcap"):
        list(open_output(bad).frames())


def test_zeros_that_protobuf_leaves_out_are_read_as_zeros() -> None:
    message = FrameTransforms()
    for i in range(3):
        transform = message.transforms.add(parent_frame_id="world", child_frame_id=f"link {i}")
        transform.translation.x = i
        transform.rotation.w = 1.0
    poses = decode_transforms(message.SerializeToString())
    assert poses.names == ("link 0", "link 1", "link 2")
    assert np.array_equal(poses.values, [[i, 0, 0, 0, 0, 0, 1] for i in range(3)])
