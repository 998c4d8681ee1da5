"""A bag written by --ros2 is read by rosbags: every message, by its own definitions and by those of a ROS 2 release."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.output.output_log import open_output
from geomphys.output.provenance import provenance_of
from geomphys.output.ros2_sink import Ros2Sink
from geomphys.results import FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World
from tests.output.made_world import frames, make_world

STORES = [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.EMPTY]


@pytest.fixture(scope="module", params=[("hand",), ("left", "right")], ids=["one", "two"])
def made(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, World, list[FrameResult]]:
    folder = tmp_path_factory.mktemp("bag")
    world = make_world(folder / "scene", avatars=request.param)
    results = list(frames(world, 30))
    with Ros2Sink(folder / "out.mcap") as sink:
        sink.open(world, Config(), provenance_of(world.path, world, Config()))
        for result in results:
            sink.write(result)
    return folder / "out.mcap", world, results


def messages(path: Path, topic: str, store: Stores = Stores.ROS2_HUMBLE) -> list:
    with AnyReader([path], default_typestore=get_typestore(store)) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        return [(time, reader.deserialize(data, c.msgtype)) for c, time, data in reader.messages(chosen)]


def poses(message) -> dict[str, list[float]]:
    found = {}
    for t in message.transforms:
        p, q = t.transform.translation, t.transform.rotation
        assert t.header.frame_id == "world"
        found[t.child_frame_id] = [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
    return found


@pytest.mark.parametrize("store", STORES, ids=lambda store: store.name)
def test_every_message_is_read(made, store: Stores) -> None:
    path, world, results = made
    with AnyReader([path], default_typestore=get_typestore(store)) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
        count = sum(1 for c, _, data in reader.messages() if reader.deserialize(data, c.msgtype) is not None)
        assert count == reader.message_count > 4 * len(results)
    assert kinds["/tf"] == kinds["/tf_static"] == kinds["/recorded/tf"] == "tf2_msgs/msg/TFMessage"
    assert kinds["/contacts/markers"] == kinds["/meshes"] == "visualization_msgs/msg/MarkerArray"
    joints = {"/joint_states"} if world.avatar_count == 1 else {"/left/joint_states", "/right/joint_states"}
    assert {topic for topic, kind in kinds.items() if kind == "sensor_msgs/msg/JointState"} == joints


def test_poses_and_stamps_are_the_frames_bit_for_bit(made) -> None:
    path, world, results = made
    ((_, static),) = messages(path, "/tf_static")
    still = poses(static)
    for (time, message), result in zip(messages(path, "/tf"), results, strict=True):
        assert time == result.frame.time_ns
        assert {t.header.stamp.sec * 10**9 + t.header.stamp.nanosec for t in message.transforms} == {time}
        both = still | poses(message)
        assert set(both) == set(world.frame_names)
        for name, body in zip(world.frame_names, result.corrected, strict=True):
            assert both[name] == body.tolist() or name in still
    for (_, message), result in zip(messages(path, "/recorded/tf"), results, strict=True):
        driven = np.flatnonzero(world.scene.bodies.role == DRIVEN)
        assert poses(message) == {f"recorded/{world.frame_names[b]}": result.recorded[b].tolist() for b in driven}


def test_an_arrow_for_each_contact_and_none_left_over(made) -> None:
    path, _, results = made
    shown: set[int] = set()
    for (_, message), result in zip(messages(path, "/contacts/markers"), results, strict=True):
        added = [m for m in message.markers if m.action == 0]
        assert [[m.points[0].x, m.points[0].y, m.points[0].z] for m in added] == result.contacts.point.tolist()
        for marker, normal in zip(added, result.contacts.normal, strict=True):
            start, end = (np.array([p.x, p.y, p.z]) for p in marker.points)
            assert (end - start) / np.linalg.norm(end - start) == pytest.approx(normal, abs=1e-9)
        shown = (shown | {m.id for m in added}) - {m.id for m in message.markers if m.action == 2}
        assert len(shown) == len(result.contacts.depth)
    assert any(len(r.contacts.depth) for r in results)


def test_surfaces_are_in_the_frames_of_their_bodies(made) -> None:
    path, world, _ = made
    ((_, message),) = messages(path, "/meshes")
    drawn = {marker.ns: marker for marker in message.markers}
    for body, (vertices, faces) in enumerate(world.triangles):
        marker = drawn[world.body_names[body]]
        assert (marker.header.frame_id, marker.type, marker.frame_locked) == (world.frame_names[body], 11, True)
        assert [[p.x, p.y, p.z] for p in marker.points] == vertices[faces].reshape(-1, 3).tolist()
        assert marker.color.a == 1.0
        assert marker.pose.orientation.w == 1.0


def test_profile_and_latched_topics(made) -> None:
    path, _, _ = made
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        channels = {c.topic: c.metadata for c in reader.get_summary().channels.values()}
        assert "scene.toml" in {a.name for a in reader.iter_attachments()}
    assert "durability: 1" in channels["/tf_static"]["offered_qos_profiles"]
    assert channels["/tf"] == {}


def test_commands_that_need_metrics_say_so(made) -> None:
    with pytest.raises(LogError, match="is a bag for ROS 2 tools"):
        open_output(made[0])
