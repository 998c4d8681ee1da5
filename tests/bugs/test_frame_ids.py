"""Frame ids were ignored: a pose in `lighthouse` counted as one in the world, and a child of two parents jumped between them.

What must hold: wherever the numbers of a pose are given, its frames are those of the same motion given in the world.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.load import load_world
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.poses import compose, invert
from geomphys.results import Frame
from tests.recording.log_files import IDENTITY, Item, S, Tree, make_world, pose, transforms, turned, write_log

HAND = Tree(root="/wrist")
TF_HAND = Tree(root="/tf#wrist")
LIGHTHOUSE = (0.2, -0.1, 0.9, *turned(0.7, axis=1))
RATE = 50

Pose = tuple[float, ...]


def moves(t: float) -> Pose:
    """A pose of the hand in the world."""
    return (0.3 * math.sin(t), 0.1 * t, 0.5 + 0.1 * math.cos(2 * t), *turned(0.8 * math.sin(t), axis=0))


def cart(t: float) -> Pose:
    """A pose of something that drives about."""
    return (0.5 * t, 0.2 * math.sin(3 * t), 0.0, *turned(0.4 * t))


def seen_from(frame: Callable[[float], Pose], what: Callable[[float], Pose], t: float) -> Pose:
    return compose(invert(frame(t)), what(t))


def still(value: Sequence[float]) -> Callable[[float], Pose]:
    return lambda t: tuple(value)


def frames_of(
    tmp_path: Path, items: list[Item], *trees: Tree, recording=None, encoding="ros2", **config
) -> list[Frame]:
    source = source_of(tmp_path, items, *trees, recording=recording, encoding=encoding, **config)
    with source:
        return list(source)


def source_of(
    tmp_path: Path, items: list[Item], *trees: Tree, recording=None, encoding="ros2", **config
) -> FrameSource:
    items = sorted(items, key=lambda item: item.log_time)
    log = write_log(tmp_path / "log.mcap", items, encoding=encoding)
    return FrameSource(log, make_world(*trees, recording=recording), Config(**config))


def assert_follow(frames: list[Frame], what: Callable[[float], Pose], tree: int = 0, atol: float = 1e-12) -> None:
    """Frames must pose a tree as `what` says, rotations up to the sign of their quaternion."""
    for frame in frames:
        expected, found = np.array(what(frame.time_ns / S)), frame.roots[tree].copy()
        found[3:] *= np.sign(found[3:] @ expected[3:])
        np.testing.assert_allclose(found, expected, atol=atol)


def times(count: int = 60) -> list[float]:
    return [k / RATE for k in range(count)]


@pytest.mark.parametrize("encoding", ["ros2", "protobuf", "json", "json-ros"])
def test_a_pose_in_a_frame_of_the_static_tree(tmp_path, encoding):
    items = [transforms("/tf_static", 0.0, {"lighthouse": LIGHTHOUSE})]
    items += [pose("/wrist", t, seen_from(still(LIGHTHOUSE), moves, t), frame="lighthouse") for t in times()]
    frames = frames_of(tmp_path, items, HAND, encoding=encoding)
    assert len(frames) == 60
    assert not any(f.held for f in frames)
    assert_follow(frames, moves)


def test_a_child_of_tf_in_a_chain_of_frames(tmp_path):
    """world -> room -> lighthouse (static, of two messages) -> wrist."""
    room = (1.0, 2.0, 3.0, *turned(0.3, axis=2))
    items = [
        transforms("/tf_static", 0.0, {"room": room}),
        transforms("/tf_static", 0.1, {"lighthouse": compose(invert(room), LIGHTHOUSE)}, frame="room"),
    ]
    items += [
        transforms("/tf", t, {"wrist": seen_from(still(LIGHTHOUSE), moves, t)}, frame="lighthouse") for t in times()
    ]
    source = source_of(tmp_path, items, TF_HAND)
    with source:
        assert_follow(list(source), moves)
        (use,) = source.report.transforms
        assert (use.topic, use.frame, use.space, use.through) == ("/tf#wrist", "lighthouse", "world", ("/tf_static",))
        assert not use.moving
        assert source.report.warnings == ()


@pytest.mark.parametrize("tf_rate", [RATE, 23.0, 200.0])
def test_a_pose_in_a_frame_that_moves(tmp_path, tf_rate):
    """A tracker seen from a cart: exact where the cart's poses stand at the same times, else to what is interpolated."""
    items = [transforms("/tf", k / tf_rate, {"cart": cart(k / tf_rate)}) for k in range(int(1.4 * tf_rate))]
    items += [pose("/wrist", t, seen_from(cart, moves, t), frame="cart") for t in times()]
    frames = frames_of(tmp_path, items, HAND)
    assert len(frames) == 60
    assert not any(f.held for f in frames)
    assert_follow(frames, moves, atol=1e-12 if tf_rate in (RATE, 200.0) else 2e-3)


def test_frames_wait_for_the_transforms_around_the_samples_around_them(tmp_path):
    """Without allowance for late messages: a sample up to `max_gap` ahead needs transforms up to `max_gap` further on."""
    mug = Tree(name="mug", root="/mug", avatar=False)
    at = (0.4, 0.0, 0.8, *turned(0.5))
    items = [pose("/wrist", k / 200, moves(k / 200)) for k in range(400)]
    items += [transforms("/tf", k * 0.09 + 0.001, {"cart": cart(k * 0.09 + 0.001)}) for k in range(30)]
    items += [
        pose("/mug", k * 0.08 + 0.01, seen_from(cart, still(at), k * 0.08 + 0.01), frame="cart") for k in range(30)
    ]
    frames = frames_of(tmp_path, items, HAND, mug, max_delay=0.0)
    assert [f.time_ns / S for f in frames if f.held] == [0.0, 0.005]
    assert_follow(frames, still(at), tree=1, atol=5e-3)


def test_composed_at_the_time_of_the_sample_not_of_the_frame(tmp_path):
    """A thing that stands still in the world, seldom seen from a moving cart, stands still in every frame."""
    mug = Tree(name="mug", root="/mug", avatar=False)
    at = (0.4, 0.0, 0.8, *turned(0.5))
    items = [pose("/wrist", t, moves(t)) for t in times(120)]
    items += [transforms("/tf", k / 100, {"cart": cart(k / 100)}) for k in range(300)]
    items += [pose("/mug", k * 0.07, seen_from(cart, still(at), k * 0.07), frame="cart") for k in range(36)]
    frames = frames_of(tmp_path, items, HAND, mug)
    assert not any(f.held for f in frames)
    assert_follow(frames, still(at), tree=1, atol=1e-9)
    assert_follow(frames, moves)


def test_what_is_static_in_a_frame_that_moves_goes_along_with_it(tmp_path):
    mount = (0.0, 0.0, 0.4, *turned(0.2, axis=1))
    shelf = Tree(name="shelf", root="/tf_static#shelf", avatar=False)
    items = [pose("/wrist", t, moves(t)) for t in times()]
    items += [transforms("/tf", t, {"cart": cart(t)}) for t in times(70)]
    items += [transforms("/tf_static", 0.0, {"shelf": mount}, frame="cart")]
    frames = frames_of(tmp_path, items, HAND, shelf)
    assert not any(f.held for f in frames)
    assert_follow(frames, lambda t: compose(cart(t), mount), tree=1)


def test_a_recorded_space_that_is_not_the_root_takes_inverses(tmp_path):
    """The space is a table that hangs on the room's camera: up from the wrist, down to the table."""
    table = (0.1, 0.2, 0.3, *turned(1.1, axis=0))
    items = [
        transforms("/tf_static", 0.0, {"lighthouse": LIGHTHOUSE}, frame="room"),
        transforms("/tf_static", 0.0, {"table": table}, frame="room"),
    ]
    items += [pose("/wrist", t, seen_from(still(LIGHTHOUSE), moves, t), frame="/lighthouse") for t in times()]
    frames = frames_of(tmp_path, items, HAND, recording={"frame": "/table"})
    assert_follow(frames, lambda t: compose(invert(table), moves(t)))


def test_the_root_of_the_tree_is_the_recorded_space_also_above_the_frame_that_poses_name(tmp_path):
    """map -> world -> …: a pose in `world` counts there, and the space is `map`."""
    world = (0.0, 0.0, 1.0, *turned(0.5))
    items = [transforms("/tf_static", 0.0, {"world": world}, frame="map")]
    items += [pose("/wrist", t, moves(t), frame="world") for t in times()]
    assert_follow(frames_of(tmp_path, items, HAND), lambda t: compose(world, moves(t)))
    assert_follow(frames_of(tmp_path, items, HAND, recording={"frame": "world"}), moves)


def test_another_tree_in_the_log_does_not_matter(tmp_path):
    """A robot of its own, not related to the room: the space is the root of the tree that the hand hangs in."""
    items = [
        transforms("/tf_static", 0.0, {"arm": IDENTITY, "gripper": IDENTITY}, frame="robot"),
        transforms("/tf_static", 0.0, {"lighthouse": LIGHTHOUSE}),
    ]
    items += [pose("/wrist", t, seen_from(still(LIGHTHOUSE), moves, t), frame="lighthouse") for t in times()]
    assert_follow(frames_of(tmp_path, items, HAND), moves)


@pytest.mark.parametrize("frame", ["", "world", "/world", "map", "tracker_origin"])
@pytest.mark.parametrize("tree", [False, True])
def test_one_frame_id_that_is_in_no_tree_is_the_recorded_space_bit_for_bit(tmp_path, frame, tree):
    """The common log, with or without the tree of a robot that has nothing to do with it."""
    robot = [transforms("/tf", t, {"gripper": moves(t)}, frame="base_link") for t in times()] if tree else []
    items = [pose("/wrist", t, moves(t), frame=frame) for t in times()]
    frames = frames_of(tmp_path, robot + items, HAND)
    assert [tuple(f.roots[0]) for f in frames] == [moves(t) for t in times()]


def test_a_leading_slash_makes_no_other_frame(tmp_path):
    mug = Tree(name="mug", root="/mug", avatar=False)
    items = [pose("/wrist", t, moves(t), frame="/world") for t in times()]
    items += [pose("/mug", t, moves(t), frame="world") for t in times()]
    frames = frames_of(tmp_path, items, HAND, mug)
    assert all(tuple(f.roots[0]) == tuple(f.roots[1]) for f in frames)


def problem(tmp_path: Path, items: list[Item], *trees: Tree, **more) -> str:
    """The one line that refuses a log."""
    with pytest.raises(LogError) as caught:
        frames_of(tmp_path, items, *trees, **more)
    text = str(caught.value)
    assert text.startswith(str(tmp_path / "log.mcap"))
    assert text.isprintable()
    return text


def test_a_frame_that_leads_nowhere_is_an_error_that_names_both(tmp_path):
    mug = Tree(name="mug", root="/mug", avatar=False)
    items = [pose("/wrist", t, moves(t)) for t in times()]
    items += [pose("/mug", t, moves(t), frame="camera") for t in times()]
    text = problem(tmp_path, items, HAND, mug)
    assert "topic '/mug' gives poses in 'camera'" in text
    assert "leads from there to 'world'" in text
    assert 'frame = ["world", "camera"] under [recording]' in text
    frames = frames_of(tmp_path, items, HAND, mug, recording={"frame": ("world", "camera")})
    assert [tuple(f.roots[1]) for f in frames] == [moves(t) for t in times()]


def test_a_recorded_space_that_the_log_does_not_know(tmp_path):
    items = [pose("/wrist", t, moves(t)) for t in times()]
    text = problem(tmp_path, items, HAND, recording={"frame": "wrold"})
    assert "gives poses in 'world' (did you mean 'wrold'?)" in text


@pytest.mark.parametrize("second", [0.05, 5.0, 14.0])
def test_a_child_with_two_parents_is_an_error_that_names_both(tmp_path, second):
    """Early, it is found when the log is opened; late, when the second parent comes. Never does the hand jump."""
    moments = np.arange(0.0, 15.0, 0.1)
    items = [transforms("/tf", t, {"wrist": moves(t)}) for t in moments]
    items += [transforms("/tf", t + 0.05, {"wrist": moves(t)}, frame="camera") for t in moments if t + 0.05 > second]
    text = problem(tmp_path, items, TF_HAND)
    assert "the frame 'wrist' has two parents, 'world' (topic '/tf') and 'camera' (topic '/tf')" in text


def test_a_frame_on_the_way_that_gets_another_parent_late_is_an_error(tmp_path):
    moments = np.arange(0.0, 15.0, 0.1)
    items = [transforms("/tf", t, {"cart": cart(t)}, frame="world" if t < 14 else "hall") for t in moments]
    items += [pose("/wrist", t, seen_from(cart, moves, t), frame="cart") for t in moments]
    text = problem(tmp_path, items, HAND)
    assert "the frame 'cart' has two parents, 'world' (topic '/tf') and 'hall' (topic '/tf')" in text


def test_two_parents_of_a_frame_on_the_way_are_an_error(tmp_path):
    items = [
        transforms("/tf_static", 0.0, {"lighthouse": LIGHTHOUSE}),
        transforms("/other/tf_static", 0.0, {"lighthouse": LIGHTHOUSE}, frame="map"),
    ]
    items += [pose("/wrist", t, moves(t), frame="lighthouse") for t in times()]
    text = problem(tmp_path, items, HAND)
    assert "'lighthouse' has two parents, 'world' (topic '/tf_static') and 'map' (topic '/other/tf_static')" in text


def test_two_parents_of_a_frame_that_is_not_used_do_not_matter(tmp_path):
    items = [transforms("/tf_static", 0.0, {"x": IDENTITY}, frame=frame) for frame in ("world", "map")]
    items += [pose("/wrist", t, moves(t)) for t in times()]
    assert_follow(frames_of(tmp_path, items, HAND), moves)


def test_frames_that_go_round_in_a_circle(tmp_path):
    items = [
        transforms("/tf_static", 0.0, {"a": IDENTITY}, frame="b"),
        transforms("/tf_static", 0.0, {"b": IDENTITY}, frame="a"),
    ]
    items += [pose("/wrist", t, moves(t), frame="a") for t in times()]
    assert "'a', 'b' are given in one another" in problem(tmp_path, items, HAND, recording={"frame": "world"})


def test_a_topic_may_change_the_frame_it_names_between_frames_at_rest(tmp_path):
    items = [transforms("/tf_static", 0.0, {"lighthouse": LIGHTHOUSE})]
    for t in times(100):
        early = t < 1.5
        value = moves(t) if early else seen_from(still(LIGHTHOUSE), moves, t)
        items.append(pose("/wrist", t, value, frame="world" if early else "lighthouse"))
    assert_follow(frames_of(tmp_path, items, HAND), moves)


def test_a_topic_that_changes_to_a_frame_that_moves_is_refused(tmp_path):
    items = [transforms("/tf", t, {"cart": cart(t)}) for t in times(120)]
    items += [pose("/wrist", t, moves(t), frame="world" if t < 1.5 else "cart") for t in times(100)]
    text = problem(tmp_path, items, HAND)
    assert "topic '/wrist' gives poses in 'cart', a frame that moves, only after the log's beginning" in text


def test_a_topic_that_changes_to_a_frame_that_leads_nowhere_is_refused(tmp_path):
    items = [pose("/wrist", t, moves(t), frame="world" if t < 1.5 else "map") for t in times(100)]
    assert "topic '/wrist' gives poses in 'map', and nothing in the log leads from there" in problem(
        tmp_path, items, HAND
    )


def test_the_same_transform_from_two_publishers_is_one(tmp_path):
    items = [transforms(topic, 0.0, {"lighthouse": LIGHTHOUSE}) for topic in ("/tf_static", "/bridge/tf_static")]
    for t in times():
        value = seen_from(still(LIGHTHOUSE), moves, t)
        items += [transforms(topic, t, {"wrist": value}, frame="lighthouse") for topic in ("/tf", "/bridge/tf")]
    assert_follow(frames_of(tmp_path, items, TF_HAND), moves)


def test_a_frame_that_comes_late_is_looked_for_in_the_whole_log(tmp_path):
    items = [
        pose("/wrist", t, seen_from(still(LIGHTHOUSE), moves, t), frame="lighthouse") for t in np.arange(0, 15, 0.1)
    ]
    items += [transforms("/tf_static", 0.0, {"other": IDENTITY})]
    items += [transforms("/tf_static", 14.0, {"lighthouse": LIGHTHOUSE})]
    assert_follow(frames_of(tmp_path, items, HAND), moves)


def test_without_a_transform_near_in_time_a_pose_counts_as_missing(tmp_path):
    """The cart is lost for half a second: the hand keeps its last good place, held, and nothing jumps."""
    items = [transforms("/tf", t, {"cart": cart(t)}) for t in times(100) if not 0.5 < t < 1.0]
    items += [pose("/wrist", t, seen_from(cart, moves, t), frame="cart") for t in times(80)]
    source = source_of(tmp_path, items, HAND)
    with source:
        frames = list(source)
        assert any(
            "25 poses have no transform" in w or "24 poses have no transform" in w for w in source.report.warnings
        )
    held = [f.time_ns / S for f in frames if f.held]
    assert held == [t for t in times(80) if 0.5 < t < 1.0]
    assert_follow([f for f in frames if not f.held], moves)
    last = moves(0.5)
    assert_follow([f for f in frames if f.held], still(last))


def test_before_its_frame_is_known_a_pose_has_its_first_known_value(tmp_path):
    items = [transforms("/tf", t, {"cart": cart(t)}) for t in times(100) if t >= 0.6]
    items += [pose("/wrist", t, seen_from(cart, moves, t), frame="cart") for t in times(80)]
    frames = frames_of(tmp_path, items, HAND)
    assert [f.time_ns / S for f in frames if f.held] == [t for t in times(80) if t < 0.6]
    assert_follow([f for f in frames if f.held], still(moves(0.6)))
    assert_follow([f for f in frames if not f.held], moves)


def test_a_frame_told_seldom_that_does_not_move_is_known_at_all_times(tmp_path):
    """As old static publishers do, ten times a second or less, on /tf."""
    items = [transforms("/tf", t, {"lighthouse": LIGHTHOUSE}) for t in (0.3, 0.8)]
    items += [pose("/wrist", t, seen_from(still(LIGHTHOUSE), moves, t), frame="lighthouse") for t in times()]
    frames = frames_of(tmp_path, items, HAND)
    assert not any(f.held for f in frames)
    assert_follow(frames, moves)


def test_memory_does_not_grow_with_the_log(tmp_path):
    items = [transforms("/tf", t, {"cart": cart(t)}) for t in times(4000)]
    items += [pose("/wrist", t, seen_from(cart, moves, t), frame="cart") for t in times(4000)]
    source = source_of(tmp_path, items, HAND)
    with source:
        most = 0
        for _frame in source:
            (track,) = source._run.tracks.tracks.values()
            (root,) = source._run.roots
            most = max(most, len(track.times), len(root._waiting), len(root.stream.times))
        assert source.report.frames == 4000
    assert most < 2 * RATE * (2 * 0.1 + 1.0)


@pytest.fixture
def case(shared_dir: Path) -> Path:
    folder = shared_dir / "cases" / "frame_id_ignored"
    if not folder.is_dir():
        pytest.skip("the shared cases are not there")
    return folder


@pytest.mark.parametrize(("log", "scene"), [("chain", "scene_tf"), ("pose", "scene")])
def test_the_reported_logs(case, log, scene):
    with FrameSource(case / f"{log}.mcap", load_world(case / f"{scene}.toml"), Config()) as source:
        heights = [f.roots[0, 2] for f in source]
        assert source.report.warnings == ()
    assert len(heights) == 60
    assert heights[0] == heights[-1] == pytest.approx(0.9)
    assert min(heights) == pytest.approx(0.78, abs=1e-3)


def test_the_reported_log_with_two_parents(case):
    (error,) = check_log(case / "two_parents.mcap", load_world(case / "scene_tf.toml")).errors
    assert "'world'" in error
    assert "'camera'" in error
