"""Frame ids of the output: each body has its own, and none is the world's or a ghost's."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.load import load_world
from geomphys.scene.world import World
from tests.scene.models import ball, joint, urdf

HAND = '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n'


def world(folder: Path, links: tuple[str, ...], text: str = HAND) -> World:
    joints = [joint(f"j{k}", links[0], name) for k, name in enumerate(links[1:])]
    urdf(folder / "hand.urdf", *(ball(name) for name in links), *joints)
    urdf(folder / "door.urdf", ball("panel"), ball("latch"), joint("hinge", "panel", "latch"))
    (folder / "scene.toml").write_text(text)
    return load_world(folder / "scene.toml")


def thing(name: str, shape: str = "sphere = 0.1") -> str:
    return f'[[object]]\nname = "{name}"\nclass = "fixed"\n{shape}\n'


@pytest.mark.parametrize(
    ("links", "more", "frames"),
    [
        (("palm", "tip"), "", ("palm", "tip")),
        (("world", "tip"), "", ("hand/world", "tip")),
        (("tip", "world"), "", ("tip", "hand/world")),
        (("/world", "tip"), "", ("hand//world", "tip")),
        (("recorded/a", "tip"), "", ("hand/recorded/a", "tip")),
        (("table", "tip"), thing("table"), ("hand/table", "tip", "table")),
        (("hand", "tip"), "", ("hand", "tip")),
        (("world", "hand/world"), "", ("hand/world", "hand/hand/world")),
        (
            ("door/latch", "door"),
            thing("door", 'urdf = "door.urdf"'),
            ("hand/door/latch", "door", "door/panel", "door/latch"),
        ),
        (("world", "tip"), HAND.replace('"hand"', '"other"'), ("hand/world", "hand/tip", "other/world", "other/tip")),
    ],
)
def test_every_frame_is_one_bodys(tmp_path: Path, links: tuple[str, ...], more: str, frames: tuple[str, ...]) -> None:
    made = world(tmp_path, links, HAND + more)
    assert made.frame_names == frames
    assert len(set(frames)) == len(frames)
    assert "world" not in frames
    several = made.avatar_count > 1
    expected = [] if several else [f for b, f in zip(made.body_names, frames, strict=True) if b == f and "hand/" in b]
    assert [renamed.frame for renamed in made.findings.renamed_frames] == expected
    assert len(made.findings.notes) == len(expected)
