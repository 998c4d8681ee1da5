"""Everything that is told of a recording has a key; programs go by that, not by the text."""

from __future__ import annotations

import copy
import json
import pickle
import re

from geomphys_cli.main import run

from geomphys.recording.diagnostics import MEANINGS, Diagnostic, as_records


def test_a_diagnostic_is_its_text_and_keeps_its_key() -> None:
    made = Diagnostic("2 frames are held", "held")
    for same in (made, copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
        assert same == "2 frames are held"
        assert same.key == "held"
    assert as_records(["x"], [made]) == [
        {"key": "scene", "level": "error", "text": "x"},
        {"key": "held", "level": "warning", "text": "2 frames are held"},
    ]


def test_every_key_has_a_meaning_and_is_in_the_documents(root) -> None:
    page = (root / "assets" / "docs" / "your_recording.md").read_text()
    assert {
        k: m for k, m in re.findall(r"^\| `(\w+)` \| (.*) \|$", page, flags=re.MULTILINE) if k in MEANINGS
    } == MEANINGS


def test_errors_and_warnings_of_check_have_keys_and_set_the_exit_code(root, tmp_path, capsys) -> None:
    log, text = root / "recordings" / "robot_glove.mcap", (root / "assets" / "scenes" / "robot_glove.toml").read_text()
    text = text.replace('"../', f'"{root}/assets/')
    for change, key, code in (
        (("", ""), None, (0, 0)),
        (('ignore = ["Pinky*"]', ""), "unmatched_recorded", (0, 1)),
        (('"Pinky*"', '"Pinky*", "toes"'), "unknown_ignore", (0, 1)),
        (('unit = "deg"', 'unit = "rad"'), "angle_unit", (0, 1)),
        (("/optitrack/right_hand", "/optitrack/left_hand"), "input", (1, 1)),
    ):
        (tmp_path / "scene.toml").write_text(text.replace(*change))
        for strict, expected in zip(([], ["--strict"]), code, strict=True):
            words = ["check", str(log), "--scene", str(tmp_path / "scene.toml"), "--json", *strict]
            assert run(words) == expected
            found = json.loads(capsys.readouterr().out)["diagnostics"]
            assert (key in {d["key"] for d in found}) if key else not found
            assert {d["level"] for d in found} <= ({"error"} if code == (1, 1) else {"warning"})
