"""Of two hands in one topic `init` gave the left one's names to the right one."""

from __future__ import annotations

import math
import tomllib

import pytest

import geomphys
from geomphys.recording.check import check_log
from tests.authoring.test_scene_draft import HAND
from tests.recording.log_files import joints, pose, transforms, write_log

JOINTS = ("index_mcp_flex", "index_pip_flex")
SPELLED = {
    "words": ("left_{}", "right_{}"),
    "letters": ("L_{}", "R_{}"),
    "shadow": ("lh_{}", "rh_{}"),
    "behind": ("{}_l", "{}_r"),
    "inside": ("glove/left/{}", "glove/right/{}"),
}


def write_hands(folder, spelled, *, tf=False):
    items = []
    for k in range(40):
        t, names = 1 + k / 50, {}
        for side, sign in ((0, 1), (1, -1)):
            names |= {spelled[side].format(j): 0.5 + 0.3 * math.sin(k / 4 + side) for j in JOINTS}
            value = (0.1, 0.3 * sign, 0.9 + 0.1 * math.sin(k / 5), 0, 0, 0, 1)
            name = ("left", "right")[side]
            items.append(
                transforms("/tf", t, {f"{name[0]}_wrist": value}) if tf else pose(f"/tracker/{name}_hand", t, value)
            )
        items.append(joints("/gloves/joint_states", t, names))
    return write_log(folder / "log.mcap", items)


def drafted(folder, log, *urdfs):
    """Tables of the avatars of a scene that `check` accepts, joint -> recorded name among them."""
    draft = geomphys.draft_scene(log, urdfs, folder=folder)
    draft.write(folder / "scene.toml", force=True)
    report = check_log(log, geomphys.load_world(folder / "scene.toml"))
    assert report.errors == ()
    avatars = tomllib.loads(draft.text)["avatar"]
    return avatars, {(j.tree, j.joint): j.recorded for j in report.joints}


@pytest.mark.parametrize("tf", [False, True], ids=["topics", "tf"])
@pytest.mark.parametrize("spelled", SPELLED.values(), ids=SPELLED)
@pytest.mark.parametrize("order", [(0, 1), (1, 0), (0,), (1,)], ids=str)
def test_each_hand_gets_its_own_names_and_tracker(tmp_path, spelled, order, tf):
    log = write_hands(tmp_path, spelled, tf=tf)
    urdfs = []
    for side in order:
        urdfs.append(tmp_path / f"{('left', 'right')[side]}_hand.urdf")
        urdfs[-1].write_text(HAND)
    avatars, fed = drafted(tmp_path, log, *urdfs)
    for side, avatar in zip(order, avatars, strict=True):
        name = ("left", "right")[side]
        assert avatar["root"]["topic"] == (f"/tf#{name[0]}_wrist" if tf else f"/tracker/{name}_hand")
        assert {j: fed[avatar["name"], j] for j in JOINTS} == {j: spelled[side].format(j) for j in JOINTS}


@pytest.mark.parametrize("told", ['<robot name="right_hand">', '<link name="palm_r">', '<link name="r_index_1">'])
def test_the_side_is_in_the_robot_the_links_or_the_joints(tmp_path, told):
    log = write_hands(tmp_path, SPELLED["words"])
    text = HAND.replace("index_1", "r_index_1").replace("index_2", "r_index_2") if "r_index" in told else HAND
    text = text.replace('"palm"', '"palm_r"') if "palm" in told else text
    text = text.replace('<robot name="hand">', told) if "robot" in told else text
    urdf = tmp_path / "model.urdf"
    urdf.write_text(text)
    (avatar,), fed = drafted(tmp_path, log, urdf)
    assert avatar["root"]["topic"] == "/tracker/right_hand"
    assert set(fed.values()) == {"right_index_mcp_flex", "right_index_pip_flex"}


def test_where_nothing_says_a_side_nothing_is_taken_for_sure(tmp_path):
    log = write_hands(tmp_path, SPELLED["words"])
    urdf = tmp_path / "model.urdf"
    urdf.write_text(HAND)
    draft = geomphys.draft_scene(log, [urdf], folder=tmp_path)
    assert "joints" not in tomllib.loads(draft.text)["avatar"][0]
    assert "nothing says which of them this is" in draft.text
    (avatar,) = draft.avatars
    assert avatar.two_sides


def test_of_two_urdfs_one_side_is_enough(tmp_path):
    log = write_hands(tmp_path, SPELLED["words"])
    urdfs = [tmp_path / "model.urdf", tmp_path / "hand_left.urdf"]
    for urdf in urdfs:
        urdf.write_text(HAND)
    avatars, fed = drafted(tmp_path, log, *urdfs)
    assert [a["root"]["topic"] for a in avatars] == ["/tracker/right_hand", "/tracker/left_hand"]
    assert fed["model", "index_mcp_flex"] == "right_index_mcp_flex"


def test_real_recordings_of_two_hands(shared_dir, tmp_path):
    models = shared_dir / "models" / "human_hands"
    for name, ending in (("leap_flapping", "protobuf"), ("leap_three_claps", "ros2")):
        log = shared_dir / "recordings" / f"{name}_{ending}.mcap"
        draft = geomphys.draft_scene(log, [models / f"{name}_{s}.urdf" for s in ("right", "left")], folder=tmp_path)
        assert [a.root.name for a in draft.avatars] == ["/tracker/right_hand", "/tracker/left_hand"]
        assert [a.joints_topic for a in draft.avatars] == ["/glove/right/joint_states", "/glove/left/joint_states"]
