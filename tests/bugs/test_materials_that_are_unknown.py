"""A typing error in a material was told only where it met something; two materials without a pair were refused."""

from __future__ import annotations

import json
from pathlib import Path

from tests.cli.press import SCENE, command_line, write_log

RUBBER = '[[material_pair]]\nmaterials = ["rubber", "rubber"]\nrestitution = 0.05\nfriction = 0.8\n'


def test_check_lists_pairs_that_are_derived(tmp_path: Path) -> None:
    scene, log = tmp_path / "scene.toml", tmp_path / "press.mcap"
    write_log(log)
    scene.write_text(RUBBER + SCENE.replace('material = "human"', 'material = "rubber"'))
    done = command_line("check", log, "-s", scene, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    (pair,) = report["findings"]["default_pairs"]
    assert sorted(pair["materials"]) == ["rubber", "wood"]
    assert sorted(pair["owners"]) == ["finger", "table"]
    assert pair["restitution"] == 0.05
    assert abs(pair["friction"] - (0.8 * 0.3) ** 0.5) < 1e-12
    assert report["warnings"] == []
    text = command_line("check", log, "-s", scene, "--strict")
    assert text.returncode == 0
    assert "wood" in text.stdout
    assert "friction 0.49, restitution 0.05" in text.stdout


def test_an_unknown_material_names_the_known_ones(tmp_path: Path) -> None:
    scene, log = tmp_path / "scene.toml", tmp_path / "press.mcap"
    write_log(log)
    scene.write_text(RUBBER + SCENE.replace('material = "human"', 'material = "humann"'))
    done = command_line("check", log, "-s", scene)
    assert done.returncode == 1
    assert (
        "'humann' of 'finger' is not known: did you mean 'human'? Known are wood, human, metal, rubber" in done.stderr
    )
