"""The loop over chains on small scenes: it ends free, keeps limits, repeats bit for bit; links along a surface."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.driven.chain_loop import draw_order
from geomphys.driven.chains import FREE, STUCK
from geomphys.driven.shift import shift_link
from tests.driven.compound import CONE, shoulder
from tests.driven.rig import Rig, rig
from tests.scene.models import ball, joint, link

GAP = 2e-6
ROD = '<origin xyz="{0} 0 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.01" length="{1}"/></geometry>'


def box(name: str, size: str, at: str) -> str:
    return f'[[object]]\nname = "{name}"\nclass = "fixed"\nbox = {size}\nposition = {at}\nmaterial = "wood"\n'


def chain(name: str, tip: str) -> str:
    return f'[[avatar.chain]]\nname = "{name}"\nbase = "base"\ntip = "{tip}"\n'


def rod(name: str, length: float = 0.1) -> str:
    return link(name, ROD.format(length / 2, length - 0.02))


def inside(axis: str, low: float, high: float) -> str:
    return f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'


def finger(name: str, at: str = "0 0 0", low: float = -1.5, high: float = 1.5) -> tuple[str, ...]:
    """Three links along x that bend up and down about -y, so that angles above 0 lift."""
    names = [f"{name}{k}" for k in range(3)]
    return (
        *(rod(n) for n in names),
        joint(f"{name}_0", "base", names[0], xyz=at, inside=inside("0 -1 0", low, high)),
        joint(f"{name}_1", names[0], names[1], xyz="0.1 0 0", inside=inside("0 -1 0", low, high)),
        joint(f"{name}_2", names[1], names[2], xyz="0.1 0 0", inside=inside("0 -1 0", low, high)),
    )


@pytest.fixture(scope="module")
def pressed(tmp_path_factory) -> Rig:
    """A finger above a box whose top is at z = 0."""
    return rig(
        tmp_path_factory.mktemp("finger"),
        (link("base"), *finger("f", at="0 0 0.03")),
        chain("f", "f2") + box("box", "[1.0, 1.0, 0.2]", "[0.3, 0.0, -0.1]"),
    )


def test_a_free_posture_stays_bit_for_bit(pressed):
    recorded = np.array([0.1, 0.2, -0.1])
    status, rounds, angles = pressed.free(recorded)
    assert (status, rounds) == (FREE, 1)
    assert np.array_equal(angles, recorded)


@pytest.mark.parametrize(
    "recorded", [(-0.3, 0.0, 0.0), (0.2, -0.5, -0.6), (-0.1, -0.4, 0.3), (0.3, -0.1, -1.2), (-0.6, 0.9, -0.9)]
)
def test_a_finger_pressed_into_a_box_comes_out(pressed, recorded):
    status, _, angles = pressed.free(recorded)
    assert status == FREE
    assert pressed.deepest() >= 0.0
    assert np.all(np.abs(angles) <= 1.5)
    assert pressed.room.trial == pytest.approx(angles - recorded, abs=1e-15)
    assert pressed.room.poses[:4] == pytest.approx(pressed.pose(angles)[:4], abs=1e-12)
    # it ends near the surface it was in, not far above it
    assert pressed.deepest() < 0.02


def test_same_seed_same_bits(pressed):
    recorded = (-0.4, 0.3, -0.5)
    first, again = (pressed.free(recorded, seed=3, frame=8)[2] for _ in range(2))
    assert first.tobytes() == again.tobytes()


def test_order_is_a_permutation_that_seed_and_frame_decide(tmp_path):
    hand = rig(tmp_path, (link("base"), *(e for k in range(5) for e in finger(f"f{k}_", at=f"0 {0.05 * k} 0"))),
               "".join(chain(f"f{k}", f"f{k}_2") for k in range(5)))  # fmt: skip
    ccd = hand.packs.ccd

    def order(seed, frame):
        draw_order(ccd, seed, frame)
        assert [hand.ccd.rank[c] for c in hand.ccd.order] == list(range(5))
        return tuple(hand.ccd.order)

    assert order(1, 2) == order(1, 2)
    seen = [order(seed, frame) for seed in range(4) for frame in range(250)]
    assert len(set(seen)) == 120
    firsts = np.bincount([o[0] for o in seen], minlength=5)
    assert np.all(np.abs(firsts - 200) < 60)


def test_two_fingers_share_the_way(tmp_path):
    """Two fingers side by side that meet: both yield, and the loop ends free whichever is first."""
    hand = rig(
        tmp_path,
        (
            ball("base", 0.02, "-0.1 0 0"), rod("a0", 0.2), rod("b0", 0.2),
            joint("a", "base", "a0", xyz="0 0.02 0", inside=inside("0 0 1", -1, 1)),
            joint("b", "base", "b0", xyz="0 -0.02 0", inside=inside("0 0 1", -1, 1)),
        ),
        chain("a", "a0") + chain("b", "b0"),
    )  # fmt: skip
    for frame in range(4):
        status, _, angles = hand.free([-0.08, 0.08], frame=frame)
        assert status == FREE
        assert hand.deepest() >= 0.0
        assert angles == pytest.approx([-0.05, 0.05], abs=0.01)


def test_no_room_within_the_limits_is_told(tmp_path):
    """A stiff finger whose base is in the box."""
    stiff = rig(
        tmp_path,
        (link("base"), *finger("f", at="0 0 -0.05", low=-0.1, high=0.1)),
        chain("f", "f2") + box("box", "[1.0, 1.0, 0.2]", "[0.3, 0.0, -0.1]"),
    )
    status, _, angles = stiff.free([0.0, 0.0, 0.0])
    assert status == STUCK
    assert np.all(np.abs(angles) <= 0.1)


def test_joints_of_the_arm_help_where_the_fingers_cannot(tmp_path):
    """A short stiff finger at the end of an arm: its own chain has no way out, the arm's has."""
    arm = rig(
        tmp_path,
        (
            link("base"), rod("upper", 0.2), rod("hand", 0.1), rod("finger", 0.06),
            joint("shoulder", "base", "upper", xyz="0 0 0.05", inside=inside("0 -1 0", -1.5, 1.5)),
            joint("wrist", "upper", "hand", xyz="0.2 0 0", inside=inside("0 -1 0", -1.0, 1.0)),
            joint("knuckle", "hand", "finger", xyz="0.1 0 0", inside=inside("0 -1 0", -0.05, 0.05)),
        ),
        chain("arm", "hand") + '[[avatar.chain]]\nname = "f"\nbase = "hand"\ntip = "finger"\n'
        + box("box", "[0.06, 1.0, 0.2]", "[0.36, 0.0, -0.1]"),
    )  # fmt: skip
    status, _, angles = arm.free([-0.2, 0.0, 0.0])
    assert status == FREE
    assert arm.deepest() >= 0.0
    assert abs(angles[2]) <= 0.05


def shift(model: Rig, name, recorded, n, far):
    recorded, bend = np.array(recorded, float), np.zeros(model.dofs)
    angles, body = recorded.copy(), model.body(name)
    before = model.pose(angles)
    poses, p = before.copy(), model.packs
    done = shift_link(
        p.scene, model.origins, p.joints, p.ccd, body, -1, recorded, bend, angles, poses, tuple(map(float, n)), far
    )  # fmt: skip
    after = model.pose(angles)
    assert poses[: body + 1] == pytest.approx(after[: body + 1], abs=1e-9)
    turned = (Rotation.from_quat(after[body, 3:]) * Rotation.from_quat(before[body, 3:]).inv()).magnitude()
    return done, bend, after[body, :3] - before[body, :3], turned


def test_shift_is_a_turn_of_the_parent_and_its_opposite(pressed):
    """In the plane: the parent's angle from the height it gains, the link's own the negative of it."""
    done, bend, moved, turned = shift(pressed, "f2", [0.0, 0.0, 0.0], (0, 0, 1), 0.02)
    assert done
    assert bend == pytest.approx([0.0, np.arcsin(0.2), -np.arcsin(0.2)], abs=1e-5)
    assert moved[2] == pytest.approx(0.02, rel=1e-3)
    assert turned < 1e-6


def test_shift_with_a_compound_parent_joint(tmp_path):
    """The forearm moves out by the shoulder's three joints and the elbow."""
    arm = Rig(shoulder(tmp_path, CONE))
    tried = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        done, bend, moved, turned = shift(arm, "lower", [*rng.uniform(-0.3, 0.3, 3), -1.2], n, 0.01)
        if done:
            tried += 1
            assert turned < 5e-4
            assert moved @ n == pytest.approx(0.01, rel=0.03)
        else:
            assert not bend.any()
    assert tried >= 5


def test_shift_that_limits_forbid_changes_nothing(pressed):
    done, bend, moved, turned = shift(pressed, "f2", [0.0, 1.49, -1.49], (0, 0, 1), 0.03)
    assert not done
    assert not bend.any()
    assert (moved == 0).all()
    assert turned == 0


def test_no_shift_where_the_own_joint_cannot_turn_back(tmp_path):
    """The parent joint tilts the link about y, its own turns it about z."""
    crossed = rig(
        tmp_path,
        (
            link("base"), rod("one"), rod("two"),
            joint("a", "base", "one", xyz="0 0 0", inside=inside("0 -1 0", -1, 1)),
            joint("b", "one", "two", xyz="0.1 0 0", inside=inside("0 0 1", -1, 1)),
        ),
        chain("c", "two"),
    )  # fmt: skip
    done, bend, _, _ = shift(crossed, "two", [0.0, 0.0], (0, 0, 1), 0.01)
    assert not done
    assert not bend.any()


def test_a_link_along_the_surface_keeps_its_orientation(pressed):
    """The last link lies flat in the box, 3 mm deep, the others bend over it."""
    rise = np.arcsin((0.1 * np.sin(0.3) + 0.03 - 0.007) / 0.1)
    recorded = np.array([0.3, -0.3 - rise, rise])
    before = pressed.pose(recorded)[pressed.body("f2")]
    assert before[2] == pytest.approx(0.007, abs=1e-12)
    status, _, angles = pressed.free(recorded)
    after = pressed.pose(angles)[pressed.body("f2")]
    assert status == FREE
    assert pressed.deepest() >= 0
    assert (Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()).magnitude() < 1e-3
    assert after[2] - before[2] == pytest.approx(0.003 + GAP, rel=0.05)
