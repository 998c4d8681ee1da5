"""``geomphys calibrate``: what it prints, and what `init` drafted before it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from geomphys_cli.main import run

FLAT = ("--flat", "1.05:1.55", "--on", "table")


@pytest.fixture
def drafted(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A function that drafts a scene for a recording of points; returns log and scene."""

    def draft(name: str) -> tuple[str, Path]:
        log, scene = str(root / "recordings" / f"{name}.mcap"), tmp_path / "desk.toml"
        assert run(["init", log, "--urdf", str(root / "assets" / "hand" / "hand_tips.urdf"), "-o", str(scene)]) == 0
        capsys.readouterr()
        return log, scene

    return draft


def rows(text: str) -> dict[str, str]:
    """Label -> value of the rows of a table, continued ones joined."""
    found: dict[str, str] = {}
    label = ""
    for line in text.splitlines()[1:]:
        name, _, value = line.partition("  ") if not line.startswith(" ") else ("", "", line)
        label = name or label
        found[label] = f"{found.get(label, '')} {value.strip()}".strip()
    return found


def test_a_height_that_was_guessed_is_found_and_written(drafted, capsys: pytest.CaptureFixture[str]) -> None:
    log, scene = drafted("webxr_hand")
    assert "a guess until `geomphys calibrate` finds it" in scene.read_text()
    assert run(["calibrate", log, "--scene", str(scene), *FLAT]) == 0
    assert rows(capsys.readouterr().out)["Next"] == "--write puts this into the scene file"
    assert run(["calibrate", log, "--scene", str(scene), *FLAT, "--write"]) == 0
    told = rows(capsys.readouterr().out)
    ((height, within),) = re.findall(r"([\d.]+) mm high ± ([\d.]+),", told["table"])
    assert float(height) == pytest.approx(740.0, abs=2.0)
    assert 0.0 < float(within) < 2.0
    assert "as the scene has it" not in told["table"]
    assert told["Written"] == str(scene)
    assert "guess" not in scene.read_text().partition("[[object]]")[2]
    assert "# calibrated: 0." in scene.read_text()


def test_what_a_flat_hand_with_a_tracker_does_not_show_is_told_with_what_to_do(
    drafted, capsys: pytest.CaptureFixture[str]
) -> None:
    log, scene = drafted("manus_hand")
    before = scene.read_bytes()
    assert run(["calibrate", log, "--scene", str(scene), *FLAT, "--write"]) == 0
    told = rows(capsys.readouterr().out)
    assert told["Offset"] == "[0.0, 0.0, 0.0] mm, rpy [0.00, 0.00, 0.00] degrees, as the scene has it"
    assert told["table"].endswith("as the scene has it")
    assert told["Next"].startswith("--only surface, if the offset is right in the scene; --only offset")
    assert scene.read_bytes() == before
    assert run(["calibrate", log, "--scene", str(scene), *FLAT, "--only", "surface"]) == 0
    assert "as the scene has it" not in rows(capsys.readouterr().out)["table"]
