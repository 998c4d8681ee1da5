"""Files that an unfinished download leaves said "holds no triangles"; capsules and free roots of URDFs were refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import InputError, LogError, MeshError, SceneError
from geomphys.load import load_world
from geomphys.output.output_log import open_output
from geomphys.recording.reader import open_log
from geomphys.scene.arrays import CAPSULE
from geomphys.scene.meshes import load_mesh
from tests.cli.press import command_line
from tests.scene.models import ball, cube, joint, link, stl, urdf
from tests.zoo import through_all

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + "ab" * 32 + "\nsize 68484\n"
CAPSULE_SHAPE = (
    '<origin xyz="0.01 0.02 0.03" rpy="0.3 -0.4 0.5"/><geometry><capsule radius="0.03" length="0.05"/></geometry>'
)


@pytest.mark.parametrize("name", ["a.stl", "hand.urdf", "scene.toml", "log.mcap"])
def test_a_git_lfs_pointer_is_named_as_such(tmp_path: Path, name: str) -> None:
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    urdf(tmp_path / "hand.urdf", link("palm", '<geometry><mesh filename="a.stl"/></geometry>'))
    stl(tmp_path / "a.stl", *cube())
    (tmp_path / name).write_text(POINTER)
    opening = (
        (lambda: open_log(tmp_path / name)) if name == "log.mcap" else (lambda: load_world(tmp_path / "scene.toml"))
    )
    with pytest.raises(InputError, match="is a Git LFS pointer, not the file itself: run `git lfs pull`") as caught:
        opening()
    assert name in str(caught.value)
    assert (type(caught.value) is SceneError) == (name == "scene.toml")
    assert (type(caught.value) is LogError) == (name == "log.mcap")


def test_an_stl_that_is_cut_off_tells_how_far(tmp_path: Path) -> None:
    path = stl(tmp_path / "a.stl", *cube())
    path.write_bytes(path.read_bytes()[: 84 + 50 * 4])
    with pytest.raises(MeshError, match="is cut off: 12 triangles announced, 4 there"):
        load_mesh(path)


def test_a_capsule_goes_all_the_way_and_viewers_get_what_they_know(tmp_path: Path) -> None:
    text = link("palm", CAPSULE_SHAPE).replace("collision", "visual")
    both = text.replace("</link>", f"<collision>{CAPSULE_SHAPE}</collision></link>")
    outcome = through_all(urdf(tmp_path / "hand.urdf", both, ball("tip"), joint("j", "palm", "tip")), tmp_path)
    assert outcome.audit["same_world"]
    world = load_world(tmp_path / "made.toml")
    assert world.scene.pieces.kind[0] == CAPSULE
    assert world.scene.pieces.size[0].tolist() == [0.03, 0.025, 0.0]
    assert world.triangles[0][0].shape[0] > 20
    description = open_output(outcome.out).descriptions()["/robot_description"]
    assert "capsule" not in description
    assert description.count("<sphere") == 2 + 1  # of the visual capsule, and the tip
    assert description.count("<cylinder") == 1


def test_the_parts_of_a_capsule_stand_where_it_stands(tmp_path: Path) -> None:
    """The hulls of both are the same: the union of the parts is the capsule."""
    from geomphys.output.urdf_description import ShownLink, urdf_for_viewers
    from geomphys.scene.skeleton import load_skeleton

    path = urdf(tmp_path / "a.urdf", link("palm", CAPSULE_SHAPE))
    text = urdf_for_viewers(path, {"palm": ShownLink("palm", ())}, (1, 2, 3, 255))
    (tmp_path / "b.urdf").write_text(text)
    (whole,) = load_skeleton(path).links[0].collisions
    middle, *caps = load_skeleton(tmp_path / "b.urdf").links[0].visuals
    assert np.allclose(middle.link_from_shape, whole.link_from_shape)
    ends = [whole.link_from_shape @ [0, 0, side * 0.025, 1] for side in (1, -1)]
    assert np.allclose([cap.link_from_shape[:, 3] for cap in caps], ends)


def test_a_floating_root_goes_all_the_way(tmp_path: Path) -> None:
    rest = (ball("palm"), ball("tip"), joint("j", "palm", "tip"))
    visual = '<link name="base"><visual><geometry><mesh filename="a.stl"/></geometry></visual></link>'
    free, plain = tmp_path / "free", tmp_path / "plain"
    for folder in (free, plain):
        folder.mkdir()
    one = through_all(urdf(free / "hand.urdf", visual, *rest, joint("free", "base", "palm", "floating")), free)
    other = through_all(urdf(plain / "hand.urdf", *rest), plain)
    assert one.audit["same_world"]
    for a, b in zip(open_output(one.out).frames(["/tf"]), open_output(other.out).frames(["/tf"]), strict=True):
        assert a.tf.names == b.tf.names
        assert np.array_equal(a.tf.values, b.tf.values)
    assert 'name="base"' not in open_output(one.out).descriptions()["/robot_description"]


def test_the_shared_case(shared_dir: Path, tmp_path: Path) -> None:
    case = shared_dir / "cases" / "mesh_messages"
    for name, says in (("lfs.stl", "run `git lfs pull`"), ("trunc.stl", "is cut off: 12 triangles announced, 4 there")):
        with pytest.raises(MeshError, match=says):
            load_mesh(case / name)
    done = command_line("info", case / "lfs.mcap")
    assert done.returncode == 1
    assert "git lfs pull" in done.stderr
    for name in ("capsule", "floating"):
        (tmp_path / name).mkdir()
        through_all(case / f"{name}.urdf", tmp_path / name)
