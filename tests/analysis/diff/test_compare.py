"""Two outputs compared: with themselves, with a table raised by a millimetre, and with parts of themselves."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.reader import make_reader
from mcap.writer import Writer

import geomphys
from geomphys.analysis.diff.channels import ChannelDifference, SetDifference
from geomphys.analysis.diff.html_report import write_page
from geomphys.analysis.diff.measures import Measure
from geomphys.output.mcap_sink import McapSink
from geomphys.output.output_log import open_output
from geomphys.output.provenance import provenance_of
from tests.cli.press import SCENE
from tests.made import RAISED_M, Results


def poses(path: Path, name: str) -> np.ndarray:
    """(n, 7) poses of a body that moves."""
    return np.array([f.tf.values[f.tf.names.index(name)] for f in open_output(path).frames(["/tf"])])


def truth(results: Results) -> dict[str, float]:
    """Largest distance of each body between the two outputs, from the messages as Foxglove's own classes read them."""
    found: dict[str, float] = {}
    places: list[dict[tuple[int, str], np.ndarray]] = []
    for path in (results.out, results.raised):
        with path.open("rb") as stream:
            rows = {}
            for _, _, message in make_reader(stream).iter_messages(topics=["/tf"]):
                for t in FrameTransforms.FromString(message.data).transforms:
                    p = t.translation
                    rows[message.log_time, t.child_frame_id] = np.array([p.x, p.y, p.z])
            places.append(rows)
    assert places[0].keys() == places[1].keys()
    for key, place in places[0].items():
        found[key[1]] = max(found.get(key[1], 0.0), float(np.linalg.norm(place - places[1][key])))
    return found


@pytest.mark.parametrize("made", ["pressed", "landed"])
def test_an_output_is_the_same_as_itself(made: str, request: pytest.FixtureRequest) -> None:
    results: Results = request.getfixturevalue(made)
    difference = geomphys.compare_outputs(results.out, results.out)
    assert difference.equal
    assert difference.frames.compared == difference.frames.a == difference.frames.b > 50
    assert difference.parameters == {}
    assert difference.attachments == ()
    assert difference.peaks == ()
    for name, channel in difference.as_dict()["channels"].items():
        assert channel["equal"], name
        assert channel["first_frame"] is None
        assert channel.get("max_m", 0.0) == channel.get("max_rad", 0.0) == 0.0
        assert not channel.get("gained")
        assert not channel.get("lost")


def test_a_sphere_on_a_table_raised_by_a_millimetre_is_a_millimetre_higher(pressed: Results) -> None:
    difference = geomphys.compare_outputs(pressed.out, pressed.raised)
    found = difference.as_dict()
    assert not found["equal"]
    motion = found["channels"]["/tf"]
    assert set(motion["bodies"]) == {"finger", "table"}
    assert motion["bodies"]["table"]["max_m"] == pytest.approx(RAISED_M, rel=1e-9)
    assert found["channels"]["/contacts"]["max_m"] == pytest.approx(RAISED_M, rel=0.1)
    assert motion["max_rad"] == 0.0
    assert found["channels"]["/recorded/tf"]["equal"]
    assert set(found["parameters"]) == {"scene_sha256", "world_sha256"}
    assert difference.attachments == ("raised.toml", "scene.toml")
    (pair,) = found["channels"]["/contacts"]["pairs"]
    assert pair == "finger | table"
    away = np.linalg.norm(poses(pressed.out, "finger")[:, :3] - poses(pressed.raised, "finger")[:, :3], axis=1)
    assert away[len(away) // 2] == pytest.approx(RAISED_M, rel=1e-3)  # deepest; where it leaves the table it is more
    finger = motion["bodies"]["finger"]
    assert finger["max_m"] == away.max()
    assert finger["rms_m"] == pytest.approx(np.sqrt(np.mean(away**2)))
    assert finger["first_frame"] == np.flatnonzero(away)[0]
    assert finger["worst_frame"] == away.argmax()
    assert finger["frames"] == np.count_nonzero(away)
    assert difference.peaks[0].value == away.max()


def test_a_recorded_hand_on_a_table_raised_by_a_millimetre(landed: Results) -> None:
    found = geomphys.compare_outputs(landed.out, landed.raised).as_dict()
    bodies = found["channels"]["/tf"]["bodies"]
    moved = {name for name, body in bodies.items() if body["max_m"] > 0}
    assert {"table", "palm", "index_distal"} <= moved
    assert moved == {name for name, away in truth(landed).items() if away > 0}
    for name, away in truth(landed).items():
        assert bodies[name]["max_m"] == pytest.approx(away, rel=1e-12)
    assert not moved & {"vase", "floor", "wall_west"}
    assert bodies["ball"]["max_m"] == pytest.approx(RAISED_M, rel=0.1)  # it lies on the table
    assert bodies["palm"]["max_m"] == pytest.approx(RAISED_M, rel=0.1)
    touched = {name for pair in found["channels"]["/contacts"]["pairs"] for name in pair.split(" | ")}
    assert "table" in touched
    assert all(name.startswith("hand/") for name in touched - {"table", "ball"})
    assert found["channels"]["/joint_states"]["equal"]


def test_swapping_swaps_gained_and_lost(landed: Results) -> None:
    one = geomphys.compare_outputs(landed.out, landed.raised).as_dict()["channels"]
    other = geomphys.compare_outputs(landed.raised, landed.out).as_dict()["channels"]
    for channel in ("/contacts", "/penetration"):
        assert one[channel]["gained"] == other[channel]["lost"]
        assert one[channel]["lost"] == other[channel]["gained"]
        assert one[channel]["max_m"] == other[channel]["max_m"]
    assert one["/penetration"]["gained"] > 0
    assert one["/tf"]["rms_m"] == other["/tf"]["rms_m"]


def test_gained_and_lost_are_those_of_the_frames_as_sets(landed: Results) -> None:
    def pairs(path: Path) -> list[set[frozenset[str]]]:
        frames = open_output(path).frames(["/penetration"])
        return [{frozenset((row.body_a, row.body_b)) for row in frame.penetrations} for frame in frames]

    channel = geomphys.compare_outputs(landed.out, landed.raised).as_dict()["channels"]["/penetration"]
    a, b = pairs(landed.out), pairs(landed.raised)
    assert channel["gained"] == sum(len(y - x) for x, y in zip(a, b, strict=True))
    assert channel["lost"] == sum(len(x - y) for x, y in zip(a, b, strict=True))


def test_a_tolerance_above_the_difference_makes_them_the_same(pressed: Results) -> None:
    loose = geomphys.compare_outputs(pressed.out, pressed.raised, tolerance_m=2 * RAISED_M, tolerance_rad=1e-6)
    assert loose.equal
    assert loose.channels["/tf"].overall_m is not None
    assert loose.channels["/tf"].overall_m.max > 0
    assert not geomphys.compare_outputs(pressed.out, pressed.raised, tolerance_m=0.5 * RAISED_M).equal


def test_only_the_channels_asked_for(pressed: Results) -> None:
    difference = geomphys.compare_outputs(pressed.out, pressed.raised, channels=["/recorded/tf"])
    assert list(difference.channels) == ["/recorded/tf"]
    assert difference.equal


def test_frames_are_matched_by_time(pressed: Results, tmp_path: Path) -> None:
    part = tmp_path / "part.mcap"
    geomphys.run(pressed.log, pressed.scene, out=part, config=geomphys.Config(start=0.5))
    difference = geomphys.compare_outputs(pressed.out, part, channels=["/recorded/tf"])
    frames = difference.frames
    assert not difference.equal
    assert (frames.only_a, frames.only_b, frames.first_only_a) == (60 - frames.b, 0, 0)
    assert frames.compared == frames.b == 30
    assert difference.channels["/recorded/tf"].equal
    assert geomphys.compare_outputs(part, pressed.out, channels=["/recorded/tf"]).frames.only_b == 30


def test_outputs_without_a_common_time_are_not_called_equal(pressed: Results, tmp_path: Path) -> None:
    later = tmp_path / "later.mcap"
    rewrite(pressed.out, later, shift_ns=5_000_000)
    difference = geomphys.compare_outputs(pressed.out, later)
    assert (difference.frames.compared, difference.frames.only_a, difference.frames.only_b) == (0, 60, 60)
    assert difference.frames.offset_s == pytest.approx(0.005, abs=1e-12)
    assert not difference.equal
    assert not any(channel.equal for channel in difference.channels.values())
    write_page(difference, tmp_path / "page.html")
    assert "not compared" in (tmp_path / "page.html").read_text()


def test_a_channel_that_is_missing_differs(pressed: Results, tmp_path: Path) -> None:
    less = tmp_path / "less.mcap"
    rewrite(pressed.out, less, without="/contacts")
    difference = geomphys.compare_outputs(pressed.out, less)
    assert {name for name, channel in difference.channels.items() if not channel.equal} == {"/contacts"}
    assert difference.as_dict()["channels"]["/contacts"]["lost"] == 27


def rewrite(source: Path, target: Path, *, shift_ns: int = 0, without: str = "") -> None:
    """Copy an output by the library of the format, its messages later or without a topic."""
    with source.open("rb") as stream, target.open("wb") as made:
        reader, writer, known = make_reader(stream), Writer(made), dict[int, int]()
        writer.start()
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic == without:
                continue
            if channel.id not in known:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            time = message.log_time + shift_ns
            writer.add_message(known[channel.id], time, message.data, time, message.sequence)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        for file in reader.iter_attachments():
            writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        writer.finish()


def test_the_part_that_differs_most_comes_first() -> None:
    def measure(largest: float) -> Measure:
        return Measure(max=largest, rms=0.0, first_frame=0, worst_frame=0, frames=1)

    channel = ChannelDifference(
        channel="/penetration", kind="pairs", equal=False, first_frame=0,
        metres={"often": measure(1e-3), "far": measure(2e-2), "less": measure(2e-3), "same": measure(0.0)},
        sets={"often": SetDifference(gained=100), "gone": SetDifference(lost=3)},
    )  # fmt: skip
    assert channel.largest_differences() == ("often", "far", "less", "gone")


def test_what_stands_still_is_compared_though_the_first_frames_differ(pressed: Results, tmp_path: Path) -> None:
    part = tmp_path / "part.mcap"
    geomphys.run(pressed.log, pressed.raised_scene, out=part, config=geomphys.Config(start=0.5))
    bodies = geomphys.compare_outputs(pressed.out, part).as_dict()["channels"]["/tf"]["bodies"]
    assert bodies["table"]["max_m"] == pytest.approx(RAISED_M, rel=1e-9)


def test_bodies_in_one_alone(pressed: Results, tmp_path: Path) -> None:
    scene, out = tmp_path / "more.toml", tmp_path / "more.mcap"
    scene.write_text(
        SCENE + '\n[[object]]\nname = "far"\nclass = "fixed"\nsphere = 0.1\nposition = [9, 9, 9]\nmaterial = "wood"\n'
    )
    geomphys.run(pressed.log, scene, out=out)
    difference = geomphys.compare_outputs(pressed.out, out)
    assert not difference.equal
    assert difference.channels["/tf"].only_b == ("far",)
    assert difference.as_dict()["channels"]["/tf"]["first_frame"] == 0


def test_parameters_are_causes_not_results(pressed: Results, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    geomphys.run(pressed.log, pressed.scene, out=other, config=geomphys.Config(seed=3))
    difference = geomphys.compare_outputs(pressed.out, other)
    assert difference.equal
    assert difference.as_dict()["parameters"] == {"seed": {"a": "0", "b": "3"}}


def test_the_record_is_fit_for_json(landed: Results) -> None:
    found = geomphys.compare_outputs(landed.out, landed.raised).as_dict()
    assert json.loads(json.dumps(found)) == found


@pytest.mark.parametrize("bad", [{"tolerance_m": -1.0}, {"tolerance_rad": float("nan")}, {"channels": ["/timing"]}])
def test_wrong_parameters(pressed: Results, bad: dict[str, object]) -> None:
    with pytest.raises(geomphys.ConfigError):
        geomphys.compare_outputs(pressed.out, pressed.out, **bad)  # type: ignore[arg-type]


def test_what_is_no_output(pressed: Results) -> None:
    with pytest.raises(geomphys.LogError, match="no output"):
        geomphys.compare_outputs(pressed.out, pressed.log)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_length(pressed: Results, tmp_path: Path) -> None:
    """Twice the length takes as much memory: that of a chunk of the file."""

    def most_memory(frames: int) -> float:
        out = tmp_path / f"{frames}.mcap"
        write_repeated(pressed, out, frames)
        code = (
            "import re, sys, geomphys; geomphys.compare_outputs(sys.argv[1], sys.argv[1]); "
            "geomphys.statistics_of([sys.argv[1]]); "
            "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])"
        )
        words = [sys.executable, "-c", code, str(out)]
        return int(subprocess.run(words, capture_output=True, text=True, check=True).stdout) / 1024

    assert most_memory(16_000) < most_memory(8_000) + 12.0  # MiB


def write_repeated(results: Results, out: Path, frames: int) -> None:
    """Write an output of that many frames at 10 Hz: those of the replay again and again."""
    world, config = geomphys.load_world(results.scene), geomphys.Config()
    one = list(geomphys.replay(results.log, world))
    with McapSink(out) as sink:
        sink.open(world, config, provenance_of(results.log, world, config))
        for index in range(frames):
            result = one[index % len(one)]
            frame = dataclasses.replace(result.frame, index=index, time_ns=10**9 + index * 10**8)
            sink.write(dataclasses.replace(result, frame=frame))
