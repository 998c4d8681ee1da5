"""An avatar without collision geometry was "free in every frame": nothing of it could touch, and nobody was told."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.authoring.scene_draft import draft_scene
from geomphys.errors import ModelError
from geomphys.load import load_world
from tests.cli.press import command_line
from tests.scene.models import ball, joint, urdf
from tests.zoo import made_log, through_all

SEEN = '<link name="{}"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>'


@pytest.mark.parametrize("what", ["avatar", "object"])
@pytest.mark.parametrize("link", [SEEN, '<link name="{}"/>'], ids=["visual", "bare"])
def test_a_model_of_which_nothing_can_touch_is_refused(tmp_path: Path, what: str, link: str) -> None:
    urdf(tmp_path / "hand.urdf", link.format("palm"), link.format("tip"), joint("j", "palm", "tip"))
    kind = "[[avatar]]\n" if what == "avatar" else '[[object]]\nclass = "fixed"\n'
    (tmp_path / "scene.toml").write_text(f'{kind}name = "hand"\nurdf = "hand.urdf"\n')
    with pytest.raises(ModelError, match=r"hand\.urdf: has no collision geometry.*<collision>") as caught:
        load_world(tmp_path / "scene.toml")
    assert "\n" not in str(caught.value)


def test_init_says_it_at_once(tmp_path: Path) -> None:
    model = urdf(tmp_path / "hand.urdf", SEEN.format("palm"), SEEN.format("tip"), joint("j", "palm", "tip"))
    with pytest.raises(ModelError, match="has no collision geometry"):
        draft_scene(made_log(tmp_path / "made.mcap", model), [model])


def test_a_link_that_is_seen_and_cannot_touch_is_listed(tmp_path: Path) -> None:
    model = urdf(tmp_path / "hand.urdf", ball("palm"), SEEN.format("tip"), '<link name="frame"/>', joint("j", "palm", "tip"),
                 joint("k", "palm", "frame", "fixed"))  # fmt: skip
    outcome = through_all(model, tmp_path)
    assert outcome.check["findings"]["without_collision"] == ["hand/tip"]
    assert outcome.replay["findings"]["without_collision"] == ["hand/tip"]
    assert not outcome.check["warnings"]
    log, scene = tmp_path / "made.mcap", tmp_path / "made.toml"
    for words in (("check", log, "-s", scene, "--strict"), ("replay", log, "-s", scene)):
        done = command_line(*words)
        assert done.returncode == 0
        assert "Cannot touch" in done.stdout
        assert "hand/tip" in done.stdout


def test_the_shared_case(shared_dir: Path) -> None:
    case = shared_dir / "cases" / "no_collision_geometry"
    for command in ("check", "replay"):
        done = command_line(command, case / "ok.mcap", "-s", case / "scene.toml")
        assert done.returncode == 1
        assert len(done.stderr.strip().splitlines()) == 1
        assert "U12_visual_only.urdf: has no collision geometry" in done.stderr
