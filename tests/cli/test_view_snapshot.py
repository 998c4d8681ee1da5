"""``geomphys view`` and ``geomphys snapshot``: what they refuse."""

from __future__ import annotations

from pathlib import Path

import pytest
from geomphys_cli.main import run


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A file with the right name and nothing in it."""
    path = tmp_path / "out.rrd"
    path.write_bytes(b"")
    return path


def test_view_without_a_screen_names_the_other_ways(
    recording: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert run(["view", str(recording)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--web" in error
    assert "geomphys snapshot" in error


@pytest.mark.parametrize("words", [["view", "--web"], ["snapshot", "-o", "{folder}/a.png"]])
def test_what_is_no_result_is_said(words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("no result")
    assert run([word.format(folder=tmp_path) for word in words] + [str(tmp_path / "notes.txt")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "notes.txt" in error


def test_a_picture_is_not_overwritten(recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "a.png"
    picture.write_bytes(b"old")
    assert run(["snapshot", str(recording), "-o", str(picture)]) == 2
    assert "--force" in capsys.readouterr().err
    assert picture.read_bytes() == b"old"


@pytest.mark.parametrize("words", [["--frame", "-1"], ["--size", "0", "10"], []])
def test_wrong_options(recording: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    out = ["-o", "a.png"] if words else []
    assert run(["snapshot", str(recording), *out, *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
