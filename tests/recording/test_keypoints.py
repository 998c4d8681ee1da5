"""Keypoints of every kind of message, with dropouts, of one side of two, by layout or name: the posture they come from."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mcap.writer import Writer

import geomphys
from geomphys.config import Config
from geomphys.load import load_world
from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.message_kinds import HAND_JOINTS
from geomphys.recording.point_labels import label_manus_nodes, label_names, layout_labels, links_of_labels
from tests.keypoints.hands import FINGERS, S, motion, openxr_points, write_hand, write_points, write_scene
from tests.recording.made_messages import SCHEMAS, hand_record

UNSCALED = 'layout = "openxr", scale = "none"'


@pytest.fixture
def hand(tmp_path):
    skeleton = write_hand(tmp_path)
    angles, roots = motion(skeleton, 30)
    return skeleton, angles, roots, openxr_points(skeleton, angles, roots)


def frames_of(log, scene, config=None):
    with FrameSource(log, load_world(scene), config or Config()) as source:
        frames = list(source)
        return frames, source.report


def tips(skeleton, frames):
    angles, roots = np.array([f.angles for f in frames]), np.array([f.roots[0] for f in frames])
    poses = skeleton.forward(angles, matrix_from_pose(roots))
    return poses[:, [skeleton.index(f"{finger}_tip") for finger in FINGERS]][..., :3, 3]


def true_tips(points):
    return points[:, [HAND_JOINTS.index(f"{finger}_tip") for finger in FINGERS]]


@pytest.mark.parametrize(
    ("kind", "keypoints"),
    [
        ("PoseArray", f'topic = "/hand", {UNSCALED}'),
        ("PosesInFrame", f'topic = "/hand", {UNSCALED}'),
        ("NamedPoseArray", f'topic = "/hand", {UNSCALED}'),
        ("teleop", f'topic = "/hand", {UNSCALED}'),
        ("RigidBodies", f'topic = "/hand", {UNSCALED}'),
        ("TFMessage", f'topic = "/tf", {UNSCALED}'),
        ("ManusGlove", 'topic = "/hand", layout = "manus", scale = "none"'),
    ],
)
def test_points_of_any_kind_of_message(tmp_path, hand, kind, keypoints):
    skeleton, _, _, points = hand
    frames, report = frames_of(write_points(tmp_path / "log.mcap", points, kind), write_scene(tmp_path, keypoints))
    assert len(frames) == len(points)
    assert not any(f.held for f in frames)
    np.testing.assert_allclose(tips(skeleton, frames), true_tips(points), atol=1e-3)
    assert len(report.fits[0].points) == 21


def test_hands_of_isaac_teleop(tmp_path, hand):
    skeleton, _, _, points = hand
    log = tmp_path / "log.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        definition = (SCHEMAS / "isaac.bfbs").read_bytes()
        channel = writer.register_channel(
            "/hand", "flatbuffer", writer.register_schema("core.HandPoseRecord", "flatbuffer", definition)
        )
        for k, frame in enumerate(points):
            poses = [None if np.isnan(p).any() else (*map(float, p), 0.0, 0.0, 0.0, 1.0) for p in frame]
            writer.add_message(channel, S + k * S // 60, hand_record(poses, S + k * S // 60), S + k * S // 60)
        writer.finish()
    frames, _ = frames_of(log, write_scene(tmp_path, f'topic = "/hand", {UNSCALED}'))
    np.testing.assert_allclose(tips(skeleton, frames), true_tips(points), atol=1e-3)


def test_mediapipe_and_webxr_lists(tmp_path, hand):
    skeleton, _, _, points = hand
    fingers = [k for k, name in enumerate(HAND_JOINTS) if name != "palm"]
    log = write_points(tmp_path / "web.mcap", points[:, fingers])
    frames, _ = frames_of(log, write_scene(tmp_path, f'topic = "/hand", {UNSCALED}'))
    np.testing.assert_allclose(tips(skeleton, frames), true_tips(points), atol=1e-3)
    of_21 = [k for k in fingers if HAND_JOINTS[k] == "thumb_metacarpal" or "metacarpal" not in HAND_JOINTS[k]]
    log = write_points(tmp_path / "media.mcap", points[:, of_21])
    frames, _ = frames_of(log, write_scene(tmp_path, 'topic = "/hand", layout = "mediapipe", scale = "none"'))
    np.testing.assert_allclose(tips(skeleton, frames), true_tips(points), atol=1e-3)


def test_links_alone_and_beside_a_layout(tmp_path, hand):
    skeleton, _, _, points = hand
    log = write_points(tmp_path / "log.mcap", points)
    names = {str(k): name.replace("intermediate", "middle") for k, name in enumerate(HAND_JOINTS)}
    links = ", ".join(f'"{k}" = "{n}"' for k, n in names.items() if not np.isnan(points[0, int(k)]).any())
    frames, report = frames_of(log, write_scene(tmp_path, f'topic = "/hand", scale = "none", links = {{ {links} }}'))
    np.testing.assert_allclose(tips(skeleton, frames), true_tips(points), atol=1e-3)
    _, report = frames_of(
        log, write_scene(tmp_path, f'topic = "/hand", {UNSCALED}, links = {{ "index_tip" = "wrist" }}')
    )
    assert report.fits[0].points["10"] == "wrist"


def test_what_has_no_link_is_left_out_and_listed_by_check(tmp_path):
    skeleton = write_hand(tmp_path, tips=False)
    angles, roots = motion(skeleton, 30)
    log = write_points(tmp_path / "log.mcap", np.nan_to_num(openxr_points(skeleton, angles, roots)))
    report = check_log(log, load_world(write_scene(tmp_path, f'topic = "/hand", {UNSCALED}')))
    (fit,) = report.recording.fits
    assert {"10 (index_tip)", "0 (palm)", "6 (index_cmc)"} <= set(fit.left_out)
    assert {u.joint for u in fit.unshown} >= {"index_distal_j", "thumb_distal_j"}
    assert report.errors == ()


def test_joints_that_the_points_take_beyond_their_limits_are_named_with_their_share(tmp_path):
    skeleton = write_hand(tmp_path)
    angles, roots = motion(skeleton, 64)  # measured in every 16th frame
    angles[:] = angles[0]
    angles[:, skeleton.dof_names.index("index_proximal_j")] = 1.6 + 0.3
    angles[32:, skeleton.dof_names.index("ring_proximal_j")] = -0.4 - 0.3
    log = write_points(tmp_path / "log.mcap", np.nan_to_num(openxr_points(skeleton, angles, roots)))
    report = check_log(log, load_world(write_scene(tmp_path, f'topic = "/hand", {UNSCALED}')))
    (told,) = [warning for warning in report.warnings if "beyond" in warning]
    assert told.startswith("joints of hand that the points take beyond the limits of its URDF in part of the frames: ")
    assert told.endswith(": index_proximal_j (100 %), ring_proximal_j (50 %)")


def test_gaps_are_interpolated_and_hold_no_frame(tmp_path, hand):
    skeleton, _, _, points = hand
    missing = np.random.default_rng(3).random(points.shape[:2]) < 0.1
    missing[0] = missing[-1] = False
    holes = np.where(missing[..., None], np.nan, points)
    frames, report = frames_of(
        write_points(tmp_path / "log.mcap", holes), write_scene(tmp_path, f'topic = "/hand", {UNSCALED}')
    )
    assert not any(f.held for f in frames)
    assert report.bad_samples == 0
    error = np.linalg.norm(tips(skeleton, frames) - true_tips(points), axis=2)
    assert np.median(error) < 1e-3
    assert error.max() < 6e-3


def test_a_finger_lost_for_longer_holds_the_frames_and_says_so(tmp_path, hand):
    _, _, _, points = hand
    holes = points.copy()
    holes[8:22, 6:11] = np.nan  # the index finger, 0.23 s
    frames, report = frames_of(
        write_points(tmp_path / "log.mcap", holes), write_scene(tmp_path, f'topic = "/hand", {UNSCALED}')
    )
    assert [f.index for f in frames if f.held] == list(range(8, 22))
    assert report.held_frames == 14
    assert any("the points of hand: the fit lacks points" in w for w in report.warnings)
    longer, _ = frames_of(tmp_path / "log.mcap", tmp_path / "scene.toml", Config(max_gap=0.5))
    assert not any(f.held for f in longer)


def test_a_tracker_gives_the_root_where_the_scene_names_one(tmp_path, hand):
    _, _, roots, points = hand
    log = write_points(tmp_path / "log.mcap", points, "TFMessage")
    scene = write_scene(tmp_path, f'topic = "/tf", {UNSCALED}', 'root = { topic = "/tf#right_wrist" }')
    frames, _ = frames_of(log, scene)
    for frame, root in zip(frames, roots, strict=True):
        np.testing.assert_allclose(frame.roots[0, :3], root[:3], atol=1e-12)
        assert tuple(frame.roots[0, 3:]) == (0.0, 0.0, 0.0, 1.0)
    assert len(frames) == 30


def test_the_side_of_the_links_picks_the_points_of_two_hands(tmp_path):
    skeleton = write_hand(tmp_path, prefix="right_")
    plain = tmp_path / "plain"
    plain.mkdir()
    angles, roots = motion(write_hand(plain), 30)
    points = openxr_points(write_hand(plain), angles, roots)
    log = tmp_path / "log.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            "/tf", "json", writer.register_schema("tf2_msgs/msg/TFMessage", "jsonschema", b"{}")
        )
        for k, frame in enumerate(points):
            ns = S + k * S // 60
            header = {"stamp": {"sec": ns // S, "nanosec": ns % S}, "frame_id": "world"}
            transforms = [
                {
                    "header": header,
                    "child_frame_id": f"{side}_{name}",
                    "transform": {
                        "translation": dict(zip("xyz", map(float, point + shift), strict=True)),
                        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                    },
                }
                for side, shift in (("left", 0.7), ("right", 0.0))
                for name, point in zip(HAND_JOINTS, frame, strict=True)
                if not np.isnan(point).any()
            ]
            writer.add_message(channel, ns, json.dumps({"transforms": transforms}).encode(), ns)
        writer.finish()
    frames, _ = frames_of(log, write_scene(tmp_path, f'topic = "/tf", {UNSCALED}'))
    assert len(frames) == 30
    poses = skeleton.forward(frames[10].angles, matrix_from_pose(frames[10].roots[0]))
    np.testing.assert_allclose(poses[skeleton.index("right_ring_tip"), :3, 3], points[10, 20], atol=1e-3)


def test_delay_shifts_the_points(tmp_path, hand):
    _, _, _, points = hand
    log = write_points(tmp_path / "log.mcap", points)
    frames, _ = frames_of(log, write_scene(tmp_path, f'topic = "/hand", delay = 0.25, {UNSCALED}'))
    assert frames[0].time_ns == S + S // 4


@pytest.mark.parametrize(
    ("keypoints", "message"),
    [
        ('topic = "/hands", layout = "openxr"', r"topic '/hands' for the keypoints of 'hand' is not in the log"),
        ('topic = "/hand", links = { "3" = "wrist" }', r"1 of its points have a link of 'hand', at least 3 are needed"),
    ],
)
def test_what_cannot_be_fitted_is_one_line(tmp_path, hand, keypoints, message):
    log = write_points(tmp_path / "log.mcap", hand[3])
    with pytest.raises(geomphys.LogError, match=message):
        frames_of(log, write_scene(tmp_path, keypoints))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('keypoints = { topic = "/hand" }', "needs layout"),
        ('keypoints = { topic = "/hand", layout = "leap" }', "layout"),
        ('keypoints = { topic = "/hand", layout = "openxr", scale = "arms" }', "scale"),
        ('keypoints = { topic = "/hand", links = { "1" = "wrst" } }', "did you mean 'wrist'"),
        ('keypoints = { topic = "/hand", layout = "openxr" }\njoints = { topic = "/j" }', "both joints and keypoints"),
    ],
)
def test_wrong_tables_are_errors_that_name_the_key(tmp_path, table, message):
    write_hand(tmp_path)
    scene = tmp_path / "scene.toml"
    scene.write_text(f'[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n{table}\n')
    with pytest.raises(geomphys.SceneError, match=message):
        load_world(scene)


def test_labels_of_links_in_several_styles():
    shadow = [
        "palm",
        "ffknuckle",
        "ffproximal",
        "ffmiddle",
        "ffdistal",
        "thbase",
        "thproximal",
        "thhub",
        "thmiddle",
        "thdistal",
    ]
    found = links_of_labels(shadow, "")
    assert found["index_mcp"] == "ffproximal"
    assert found["index_pip"] == "ffmiddle"
    assert [found[f"thumb_{s}"] for s in ("cmc", "mcp", "ip")] == ["thproximal", "thmiddle", "thdistal"]
    assert label_names(["middle_middle", "little_middle"])["middle_middle"].point == "middle_pip"


def test_nodes_of_manus_are_labelled_by_their_order():
    nodes = [f"left/{k}/Index/{name}" for k, name in enumerate(("MCP", "PIP", "IP", "DIP", "TIP"))]
    labels = label_manus_nodes([*nodes, "left/9/Hand/Invalid"])
    assert [labels[n].point for n in nodes] == [f"index_{s}" for s in ("cmc", "mcp", "pip", "dip", "tip")]
    assert labels["left/9/Hand/Invalid"].point == "wrist"


@pytest.mark.parametrize(("layout", "count", "index", "label"), [
    ("openxr", 26, 10, "index_tip"), ("openxr", 25, 9, "index_tip"), ("mediapipe", 21, 8, "index_tip"),
    ("manus", 25, 9, "index_tip"),
    ("openxr", 26, 1, "wrist"), ("mediapipe", 21, 3, "thumb_ip"),
])  # fmt: skip
def test_lists_in_the_order_of_their_layout(layout, count, index, label):
    labels = layout_labels(layout, count)
    assert len(labels) == count
    assert labels[index] == label
