"""MuJoCo gets the same world: the same pieces and masses, and a hand that follows where nothing is in its way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geomphys.bench.experiments import Experiment, experiment_files, load_experiment
from geomphys.bench.measure import measure
from geomphys.bench.scaling import slide, world_of_objects
from geomphys.config import Config
from geomphys.engine.pipeline import Pipeline
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

mujoco = pytest.importorskip("mujoco")

from geomphys.bench.mujoco_grip import MujocoGripPeer  # noqa: E402
from geomphys.bench.mujoco_peer import MujocoPeer  # noqa: E402
from geomphys.bench.mujoco_scene import body_name  # noqa: E402

FRAMES = 40
HIGH = 0.5  # m above the table: nothing to touch


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world_of_objects(tmp_path_factory.mktemp("room"), 3, ball=True)


def results(experiment: Experiment) -> list[FrameResult]:
    pipeline = Pipeline(experiment.world, Config())
    batches = iter([(list(experiment.frames), 0)])
    blocks = [pipeline.results(chunk) for chunk in pipeline.chunks(batches)]
    return [block.result(row) for block in blocks for row in range(len(block))]


def lifted(experiment: Experiment) -> Experiment:
    frames = []
    for frame in experiment.frames:
        roots = frame.roots.copy()
        roots[0, 2] += HIGH
        frames.append(replace(frame, roots=roots))
    return replace(experiment, frames=frames)


@pytest.mark.parametrize("jointed", [False, True])
def test_the_model_holds_the_same_pieces_and_masses(world: World, jointed: bool) -> None:
    model = MujocoPeer(world, results(slide("x", world, 1))[0], jointed).model
    assert model.ngeom == len(world.scene.pieces.kind)
    assert model.nu == (len(world.dof_names) if jointed else 0)
    ball = world.body_names.index("ball")
    assert model.body(body_name(ball)).mass[0] == pytest.approx(world.scene.bodies.mass[ball], rel=1e-12)
    driven = np.flatnonzero(world.scene.bodies.role == DRIVEN)
    weight = sum(model.body(body_name(int(body))).mass[0] for body in driven)
    assert weight == pytest.approx(world.scene.trees.mass[0], rel=0.02)  # massless links have some


@pytest.mark.parametrize("jointed", [False, True])
def test_a_hand_in_the_air_follows_and_a_pressed_one_does_not_get_through(world: World, jointed: bool) -> None:
    in_air = results(lifted(slide("x", world, FRAMES)))
    peer = MujocoPeer(world, in_air[0], jointed)
    frames = [peer.frame(result) for result in in_air[1:]]
    assert max(frame.residual for frame in frames) == 0.0
    assert sum(frame.steps for frame in frames) == round((FRAMES - 1) / 60.0 / 0.002)
    for body in np.flatnonzero(world.scene.bodies.role == DRIVEN):
        place = peer.data.body(body_name(int(body))).xpos
        assert np.linalg.norm(place - in_air[-1].recorded[body, :3]) < 0.002, world.body_names[body]
    assert max(frame.tips.error_m for frame in frames) < 0.002
    pressed = results(slide("x", world, FRAMES))
    peer = MujocoPeer(world, pressed[0], jointed)
    last = [peer.frame(result) for result in pressed[1:]][-1]
    assert 0.0 < last.residual < pressed[-1].metrics.recorded_penetration_m
    assert peer.warnings == 0


@pytest.mark.parametrize(("softer", "lifts"), [(1.0, True), (20.0, False)])
def test_hands_that_yield_lift_what_their_springs_press_hard_enough(softer: float, lifts: bool) -> None:
    (files,) = experiment_files(None, ["gripper_cube"])
    experiment = load_experiment(files, Config())
    experiment = replace(experiment, frames=experiment.frames[:280])
    world, cube = experiment.world, experiment.world.body_names.index("cube")
    trees = world.scene.trees
    soft = trees._replace(stiffness=trees.stiffness / softer, damping=trees.damping / np.sqrt(softer))
    ours = results(experiment)
    peer = MujocoGripPeer(replace(world, scene=world.scene._replace(trees=soft)), ours[0])
    for result in ours[1:]:
        peer.frame(result)
    heights = [poses[cube, 2] - ours[0].corrected[cube, 2] for poses in (ours[-1].corrected, peer.poses(ours[-1]))]
    assert heights[0] > 0.15
    assert (heights[1] > 0.15) == lifts
    jaw = world.body_names.index("gripper/left_jaw")
    if lifts:  # pressed by the cube as far as ours is
        assert np.linalg.norm(peer.poses(ours[-1])[jaw, :3] - ours[-1].corrected[jaw, :3]) < 0.006
    assert peer.warnings == 0


def test_ratios_are_of_the_same_frames(world: World) -> None:
    figures = measure(slide("x", world, FRAMES), Config(), 1, (MujocoPeer.rigid, MujocoPeer.jointed))
    assert [peer.engine.split(", ")[1] for peer in figures.peers] == ["rigid", "jointed"]
    assert all(peer.ns.count == figures.step.count for peer in figures.peers)


def test_without_mujoco_the_extra_is_named(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    from geomphys.errors import ConfigError

    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(ConfigError, match=r"geomphys\[bench\]"):
        MujocoPeer(world, results(slide("x", world, 1))[0], jointed=False)
