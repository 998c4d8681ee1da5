"""``geomphys info`` and ``geomphys check``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from geomphys_cli.main import run
from mcap.writer import Writer

from tests.cli.press import FRAMES, SCENE, Case, write_log


def test_info_tells_topics(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(case.log)]) == 0
    text = capsys.readouterr().out
    assert f"{FRAMES} in 0.98 s" in text
    (row,) = [line.split() for line in text.splitlines() if line.startswith("/tracker/finger")]
    assert row == ["/tracker/finger", "foxglove.PoseInFrame", "json", "a", "pose", "60", "60.0", "Hz", "0.0167", "s"]


def test_info_as_json(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(case.log), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["messages"] == FRAMES
    assert [topic["topic"] for topic in content["topics"]] == ["/tracker/finger"]


def test_names_from_a_log_do_not_steer_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "evil.mcap", topic="/a\x1b[2J\n[red]b")
    assert run(["info", str(tmp_path / "evil.mcap")]) == 0
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert r"/a\x1b[2J\n[red]b" in text


def test_info_of_a_cut_log_shows_what_is_intact_with_recover(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    write_log(cut, frames=600)
    cut.write_bytes(cut.read_bytes()[:-20_000])
    assert run(["info", str(cut)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--recover" in error
    assert run(["info", str(cut), "--recover"]) == 0
    assert "Damage" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["info", "replay", "check"])
def test_what_is_no_log_is_said(case: Case, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "no.mcap").write_bytes(b"no log at all")
    scene = [] if command == "info" else ["--scene", str(case.scene)]
    assert run([command, str(tmp_path / "no.mcap"), *scene]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no.mcap" in error


def test_check_says_yes(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", str(case.log), "--scene", str(case.scene), "--strict"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("finger follows /tracker/finger (60 messages)" in line for line in lines)
    assert lines[-1] == "It can be replayed."


def test_check_says_no_and_why(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "other.mcap", topic="/tracker/thumb")
    assert run(["check", str(tmp_path / "other.mcap"), "--scene", str(case.scene)]) == 1
    output = capsys.readouterr()
    assert output.out.splitlines()[-1] == "It cannot be replayed."
    assert output.err.count("\n") == 1
    for stream in output:
        assert "/tracker/thumb" in stream


def test_strict_takes_warnings_for_errors(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["check", str(case.log), "--scene", str(case.scene), "--rate", "1000", "--max-gap", "0.001", "--json"]
    assert run(words) == 0
    assert json.loads(capsys.readouterr().out)["warnings"]
    assert run([*words, "--strict"]) == 1
    assert "--strict" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('class = "fixed"', 'class = "fixd"'), "fixd"),
        (("box = [1.0, 1.0, 0.1]", "box = [1.0, 1.0]"), "box"),
        (('material = "wood"', 'material = "cheese"'), "cheese"),
        (("sphere = 0.05", 'mesh = "gone.obj"'), "gone.obj"),
        (("mass = 0.4", "mas = 0.4"), "mas"),
    ],
)
def test_a_wrong_scene_is_1_and_names_the_place(
    case: Case, tmp_path: Path, change: tuple[str, str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "wrong.toml"
    scene.write_text(SCENE.replace(*change))
    assert run(["check", str(case.log), "--scene", str(scene)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "wrong.toml" in error or "gone.obj" in error
    assert says in error


def test_check_and_replay_agree_on_times_past_2038(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What cannot be written is found by the check."""
    log = tmp_path / "late.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/tracker/finger", "json", schema)
        for frame in range(3):
            seconds = 2**31 - 1 + frame
            pose = {"position": {"x": 0, "y": 0, "z": 1}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
            message = {"timestamp": {"sec": seconds, "nsec": 0}, "frame_id": "world", "pose": pose}
            writer.add_message(channel, seconds * 10**9, json.dumps(message).encode(), seconds * 10**9)
        writer.finish()
    assert run(["check", str(log), "-s", str(case.scene)]) == 1
    checked = capsys.readouterr()
    assert run(["replay", str(log), "-s", str(case.scene), "-o", str(tmp_path / "out.mcap"), "-q"]) == 1
    replayed = capsys.readouterr()
    for said in (checked.out + checked.err, replayed.err):
        assert "frame 1: the time 2147483648.0 s cannot be written" in said
