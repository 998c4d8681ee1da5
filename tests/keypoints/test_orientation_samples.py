"""The rotation between a recorded palm and the root link is measured, and refused where it is no constant one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.keypoints.fit_model import FitModel
from geomphys.keypoints.palm_orientation import MAX_LEVER, MIN_SAMPLES, OrientationSamples, _mean_rotation, _sensitivity
from geomphys.keypoints.setup import make_model
from geomphys.load import load_world
from geomphys.scene.topic_sources import PalmOrientation
from tests.driven.compound import limit
from tests.scene.models import ball, joint, link, urdf

CONVENTION = Rotation.from_euler("xyz", [0.4, -1.1, 2.0])
FIXED = {"wrist": (0, 0, 0), "a": (0.08, 0.03, 0), "b": (0.08, -0.03, 0), "c": (0.09, 0, 0.02), "tip": (0.11, 0.03, 0)}
"""m: points that no joint moves relative to the root; `tip` is on the axis of the only one."""
OWN = np.array(list(FIXED.values()), float)


def model(folder: Path) -> tuple[FitModel, list[int]]:
    """A wrist with three points fixed to it and a finger; and which of its points are those of `FIXED`."""
    parts = [link("wrist"), *(ball(name) for name in ("a", "b", "c", "tip", "end"))]
    for name in "abc":
        parts.append(joint(f"j{name}", "wrist", name, "fixed", xyz=" ".join(map(str, FIXED[name]))))
    parts.append(joint("bend", "a", "tip", xyz="0.03 0 0", inside=limit(-1, 1, "0 1 0")))
    parts.append(joint("on", "tip", "end", "fixed", xyz="0.03 0 0"))
    urdf(folder / "hand.urdf", *parts)
    (folder / "scene.toml").write_text('[[avatar]]\nname="hand"\nurdf="hand.urdf"\nmaterial="human"\n')
    world = load_world(folder / "scene.toml")
    count = len(world.body_names)
    made = make_model(world.scene, 0, np.arange(count), np.ones(count), fits_root=True)
    return made, [world.body_names.index(f"hand/{name}") for name in FIXED]


def measured(
    folder: Path, frames: int = 100, noise: float = 0.0, wobble: float = 0.0, constant: bool = False, lost: int = 0
) -> PalmOrientation | None:
    """What is found where the wrist's orientation is recorded with the convention above."""
    rng = np.random.default_rng(1)
    made, fixed = model(folder)
    samples = OrientationSamples(made, [0])
    assert samples.is_possible
    count = len(made.body)
    for k in range(frames):
        turn = Rotation.from_rotvec([0.5 * np.sin(0.1 * k), 0.02 * k, 0.3 * np.cos(0.07 * k)])
        poses = np.zeros((count, 7))
        poses[:, 6] = 1.0
        poses[fixed, :3] = np.array([1.0, 2.0, 3.0]) + turn.apply(OWN) + rng.normal(0, noise, OWN.shape)
        recorded = CONVENTION if constant else turn * CONVENTION * Rotation.from_rotvec(wobble * rng.normal(size=3))
        poses[0, 3:] = recorded.as_quat() * (1 if k % 2 else -1)
        seen = np.ones(count, np.int64)
        seen[fixed[:lost]] = 0
        samples.add(poses, seen)
    return samples.orientation()


def test_the_convention_of_the_source_is_found(tmp_path: Path) -> None:
    found = measured(tmp_path, noise=1e-3)
    assert found is not None
    assert found.point == 0
    turn = Rotation.from_quat(found.point_from_root) * CONVENTION  # point_from_root is its inverse
    assert turn.magnitude() < 5e-3
    assert 0.0 < found.lever <= MAX_LEVER


def test_an_orientation_that_is_less_exact_weighs_less(tmp_path: Path) -> None:
    exact, rough = (measured(tmp_path, noise=1e-3, wobble=w) for w in (0.005, 0.05))
    assert exact is not None
    assert rough is not None
    assert rough.lever < 0.5 * exact.lever


@pytest.mark.parametrize(
    "options", [{"constant": True}, {"wobble": 0.5}, {"frames": MIN_SAMPLES - 1}, {"lost": 1}, {"lost": 3}],
    ids=["not filled in", "does not agree", "too few frames", "wrist not seen", "points not seen"],
)  # fmt: skip
def test_others_are_not_used(tmp_path: Path, options: dict[str, float]) -> None:
    assert measured(tmp_path, noise=1e-3, **options) is None  # type: ignore[arg-type]


def test_the_mean_rotation_is_that_of_the_nearer_half_whatever_the_signs() -> None:
    rng = np.random.default_rng(2)
    turns = Rotation.from_rotvec(rng.normal(0, 0.02, (100, 3))) * CONVENTION
    quats = turns.as_quat() * np.where(rng.random(100) < 0.5, -1.0, 1.0)[:, None]
    quats[:20] = Rotation.random(20, random_state=3).as_quat()
    found = _mean_rotation(quats)
    assert (Rotation.from_quat(found) * CONVENTION.inv()).magnitude() < 0.01
    assert found[3] > 0.0


def test_the_sensitivity_is_the_deviation_of_a_rotation_fitted_to_noisy_points() -> None:
    """By drawing noise and fitting it (Kabsch, by scipy)."""
    rng, size = np.random.default_rng(4), 1e-4
    points = OWN - OWN.mean(axis=0)
    found = [
        Rotation.align_vectors(points + rng.normal(0, size, points.shape), points)[0].as_rotvec() for _ in range(4000)
    ]
    assert _sensitivity(OWN) == pytest.approx(np.sqrt(np.mean(np.square(found))) / size, rel=0.05)
