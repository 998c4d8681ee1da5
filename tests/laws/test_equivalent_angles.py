"""One motion written with other angles gives the same links: whole turns, and second solutions of a wrist (z, y, z).

Rz(a) Ry(b) Rz(c) = Rz(a + π) Ry(-b) Rz(c + π): the links between have no geometry, so nothing else tells the two apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.driven.compound import CAPSULE, limit
from tests.driven.logs import Floats, Run, Thing, assert_free, play
from tests.scene.models import joint, link, urdf

JOINTS = ("azimuth", "height", "roll", "elbow")
LINKS = ("upper", "lower")
FRAMES = 60


def motion() -> Floats:
    """(n, 4) rad: an arm that swings into two posts, rolls on them and comes back."""
    s = np.sin(np.linspace(0.0, np.pi, FRAMES))
    return np.column_stack([0.1 + 0.9 * s, 0.7 + 0.3 * s, 0.3 - 0.5 * s, 0.4 + 0.5 * s**2])


def replayed(folder: Path, angles: Floats) -> Run:
    """The arm between the posts."""
    folder.mkdir()
    free = 4.0 * np.pi
    urdf(
        folder / "arm.urdf",
        *(link(name) for name in ("base", "a", "b")),
        *(link(name, CAPSULE.format(-0.15)) for name in LINKS),
        joint("azimuth", "base", "a", xyz="0 0 0", inside=limit(-free, free, "0 0 1")),
        joint("height", "a", "b", xyz="0 0 0", inside=limit(-free, free, "0 1 0")),
        joint("roll", "b", "upper", xyz="0 0 0", inside=limit(-free, free, "0 0 1")),
        joint("elbow", "upper", "lower", xyz="0 0 -0.3", inside=limit(-free, free, "0 1 0")),
    )
    arm = '[[avatar]]\nname="arm"\nurdf="arm.urdf"\nmode="chains"\nmaterial="human"\njoints={topic="/angles"}\n'
    arm += '[[avatar.chain]]\nname="arm"\nbase="base"\ntip="lower"\n'
    posts = [
        Thing(name="post", shape=("capsule", 0.03, 0.4), at=(-0.35, -0.25, -0.35)),
        Thing(name="pole", shape=("capsule", 0.02, 0.4), at=(-0.15, -0.13, -0.2)),
    ]
    return play(folder, posts, avatars=arm, angles={"/angles": (JOINTS, angles)})


def links_of(run: Run) -> Floats:
    """(n, L, 3, 3) m: origin and two points 0.2 m along the axes of each link."""
    poses = np.stack([run.path(f"arm/{name}") for name in LINKS], axis=1)
    turned = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
    return np.stack([poses[..., :3], *(poses[..., :3] + 0.2 * turned[..., k] for k in (0, 2))], axis=2)


def turned(joint_of: int, turns: float) -> Callable[[Floats], Floats]:
    """Whole turns more of a joint."""
    return lambda angles: angles + 2.0 * np.pi * turns * (np.arange(4) == joint_of)


def second(angles: Floats) -> Floats:
    """The other solution of the wrist."""
    return angles * np.array([1.0, -1.0, 1.0, 1.0]) + np.pi * np.array([1.0, 0.0, 1.0, 0.0])


def halfway(other: Callable[[Floats], Floats], frame: int) -> Callable[[Floats], Floats]:
    """From a frame on written the other way."""
    return lambda angles: np.vstack([angles[:frame], other(angles)[frame:]])


WAYS: Sequence[tuple[str, Callable[[Floats], Floats]]] = (
    *((f"{JOINTS[k]} {turns:+}", turned(k, turns)) for k, turns in ((0, 1), (1, -1), (2, 1), (3, -1))),
    ("second solution", second),
    ("second solution, a turn on", lambda angles: turned(0, -1)(second(angles))),
    ("a turn more from frame 30 on", halfway(turned(0, 1), 30)),
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """As it is."""
    run = replayed(tmp_path_factory.mktemp("angles") / "plain", motion())
    assert run.figures("recorded_penetration_m").max() > 5e-3
    assert_free(run)
    assert run.touched().sum() > 20
    return run


@pytest.mark.parametrize(("name", "other"), WAYS, ids=[name for name, _ in WAYS])
def test_same_links(plain: Run, tmp_path: Path, name: str, other: Callable[[Floats], Floats]) -> None:
    run = replayed(tmp_path / "other", other(motion()))
    assert np.abs(links_of(run) - links_of(plain)).max() < 1e-6
