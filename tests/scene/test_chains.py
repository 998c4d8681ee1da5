"""Chains named in a scene file, and chains suggested by a tree."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import SceneError
from geomphys.scene.chains import named_chains, suggested_chains
from geomphys.scene.scene_file import AvatarTable, parse_scene
from geomphys.scene.skeleton import Skeleton, load_skeleton
from tests.scene.models import joint, link, urdf

SCENE = Path("s.toml")


def row(start: str, name: str, count: int, kind: str = "revolute") -> list[str]:
    """A row of links name0 … hanging on `start`."""
    parts, parent = [], start
    for k in range(count):
        parts += [link(f"{name}{k}"), joint(f"{name}_j{k}", parent, f"{name}{k}", kind)]
        parent = f"{name}{k}"
    return parts


def named(skeleton: Skeleton, chains: list[tuple[int, ...]]) -> list[list[str]]:
    return [[skeleton.links[k].name for k in chain] for chain in chains]


def avatar(*chains: tuple[str, str, str]) -> AvatarTable:
    text = '[[avatar]]\nname = "body"\nurdf = "a.urdf"\n'
    for name, base, tip in chains:
        text += f'[[avatar.chain]]\nname = "{name}"\nbase = "{base}"\ntip = "{tip}"\n'
    return parse_scene(text, SCENE).avatar[0]


def test_a_chain_runs_from_below_its_base_to_its_tip(tmp_path: Path) -> None:
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("torso"), *row("torso", "arm", 4), *row("torso", "leg", 3)))
    chains = named_chains(avatar(("arm", "torso", "arm2"), ("leg", "leg0", "leg2")), skeleton, SCENE)
    assert named(skeleton, chains) == [["arm0", "arm1", "arm2"], ["leg1", "leg2"]]


@pytest.mark.parametrize(
    ("chains", "says"),
    [
        ([("c", "torso", "arm9")], "no link 'arm9' in"),
        ([("c", "torse", "arm2")], "did you mean 'torso'?"),
        ([("c", "leg0", "arm2")], "the tip 'arm2' is no descendant of the base 'leg0'"),
        ([("c", "arm2", "arm0")], "the tip 'arm0' is no descendant of the base 'arm2'"),
        ([("c", "torso", "torso")], "no joint moves between 'torso' and 'torso'"),
        ([("c", "torso", "box0")], "no joint moves between 'torso' and 'box0'"),
        ([("c", "torso", "arm2"), ("d", "arm0", "arm1")], "the link 'arm1' belongs to chain 'c' already"),
    ],
)
def test_faults_name_avatar_chain_and_link(tmp_path: Path, chains: list[tuple[str, str, str]], says: str) -> None:
    parts = [*row("torso", "arm", 3), *row("torso", "leg", 2), *row("torso", "box", 1, "fixed")]
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("torso"), *parts))
    with pytest.raises(SceneError) as caught:
        named_chains(avatar(*chains), skeleton, SCENE)
    assert str(caught.value).startswith(f"s.toml: chain {chains[-1][0]!r} of avatar 'body': ")
    assert says in str(caught.value)


def test_a_hand_gets_its_fingers(tmp_path: Path) -> None:
    fingers = [part for name in "abcde" for part in row("wrist1", name, 4)]
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("arm"), *row("arm", "wrist", 2), *fingers))
    chains = named(skeleton, suggested_chains(skeleton))
    assert [c[0] for c in chains] == ["a0", "b0", "c0", "d0", "e0"]
    assert [c[-1] for c in chains] == ["a3", "b3", "c3", "d3", "e3"]


def test_fixed_links_count_for_nothing_and_short_branches_hang_off(tmp_path: Path) -> None:
    parts = [*row("a4", "nail", 1), *row("a4", "pad", 2, "fixed"), *row("base", "stub", 1)]
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("base"), *row("base", "a", 5), *parts))
    assert named(skeleton, suggested_chains(skeleton)) == [["a0", "a1", "a2", "a3", "a4", "nail0"]]


def test_an_arm_goes_on_through_the_longer_of_two_short_ends(tmp_path: Path) -> None:
    parts = [*row("torso", "left", 6), *row("torso", "right", 6), *row("left5", "thumb", 2), *row("left5", "hand", 3)]
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("torso"), *parts))
    chains = named(skeleton, suggested_chains(skeleton))
    assert [(c[0], c[-1]) for c in chains] == [("left0", "hand2"), ("right0", "right5")]


def test_real_models(shared_dir: Path) -> None:
    expected = {
        "human_hands/leap_grab_right.urdf": 5,
        "adroit/adroit_hand.urdf": 5,
        "allegro_right/allegro_hand_right.urdf": 4,
        "cmu_body/cmu_subject_02.urdf": 5,
    }
    for model, count in expected.items():
        skeleton = load_skeleton(shared_dir / "models" / model)
        chains = suggested_chains(skeleton)
        assert len(chains) == count, model
        assert len({k for chain in chains for k in chain}) == sum(map(len, chains))  # they share nothing
    tips = {c[-1] for c in named(skeleton, chains)}
    assert tips == {"lfingers", "rfingers", "ltoes", "rtoes", "head"}


def test_fingers_of_one_joint_are_chains_where_there_is_no_longer_limb(tmp_path: Path) -> None:
    parts = [*row("palm", "a", 1), *row("palm", "b", 1), *row("palm", "tag", 1, "fixed")]
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", link("palm"), *parts))
    assert named(skeleton, suggested_chains(skeleton)) == [["a0"], ["b0"]]
    skeleton = load_skeleton(urdf(tmp_path / "b.urdf", link("palm"), *parts, *row("palm", "c", 2)))
    assert named(skeleton, suggested_chains(skeleton)) == [["c0", "c1"]]
