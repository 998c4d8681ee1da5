"""Encoded messages against what the message libraries decode."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.contact_arrows import ARROW_SCALE, MIN_ARROW_LENGTH, arrow_orientations
from geomphys.output.encoders import (
    JOINT_STATE_DEFINITION,
    STRING_DEFINITION,
    ContactArrowsEncoder,
    ContactPointsEncoder,
    FrameEncoder,
    JointStateEncoder,
    TransformsEncoder,
    encode_string,
)
from geomphys.output.frame_columns import RaggedContacts, RaggedPenetrations
from geomphys.output.proto.geomphys_pb2 import Contacts
from geomphys.results import Contacts as ContactArrays
from geomphys.results import Penetrations

NAMES = ("palm", "", "a name of more than a hundred and twenty-seven bytes " + 120 * "x", "žlab/näme")
TIMES = st.one_of(
    st.integers(0, 2**31 * 10**9 - 1),
    st.builds(
        lambda s, n: s * 10**9 + n, st.sampled_from([0, 1, 127, 128, 1_700_000_000]), st.sampled_from([0, 1, 128])
    ),
)
DOUBLES = st.floats(allow_nan=False, allow_infinity=False)


@given(TIMES, st.lists(DOUBLES, min_size=28, max_size=28))
def test_transforms_decode_to_what_went_in(time: int, numbers: list[float]) -> None:
    poses = np.array(numbers).reshape(4, 7)
    message = FrameTransforms.FromString(TransformsEncoder(NAMES).encode(poses[None], at(time))[0])
    assert [t.child_frame_id for t in message.transforms] == list(NAMES)
    for transform, pose in zip(message.transforms, poses, strict=True):
        assert transform.timestamp.ToNanoseconds() == time
        assert transform.parent_frame_id == "world"
        p, q = transform.translation, transform.rotation
        assert np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]).tobytes() == pose.tobytes()


@given(TIMES, st.lists(DOUBLES, max_size=5))
def test_joint_states_decode_to_what_went_in(time: int, angles: list[float]) -> None:
    names = [f"j{'x' * i}" for i in range(len(angles))]
    data = JointStateEncoder(names).encode(np.array([angles], float), at(time))[0]
    schema = Schema(id=1, name="sensor_msgs/msg/JointState", encoding="ros2msg", data=JOINT_STATE_DEFINITION)
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    message = decode(data)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(time, 10**9)
    assert list(message.name) == names
    assert list(message.position) == angles
    assert len(message.velocity) == len(message.effort) == 0


def test_string_decodes_to_what_went_in() -> None:
    schema = Schema(id=1, name="std_msgs/msg/String", encoding="ros2msg", data=STRING_DEFINITION)
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    assert decode(encode_string("<robot name='žlab'/>")).data == "<robot name='žlab'/>"


@given(TIMES, st.integers(0, 2**40))
def test_frame_and_time_decode_to_what_went_in(time: int, frame: int) -> None:
    message = Contacts.FromString(FrameEncoder(NAMES).contacts(ragged(contacts([])), np.array([frame]), at(time))[0])
    assert (message.frame, message.timestamp.ToNanoseconds()) == (frame, time)


def at(*times: int) -> np.ndarray:
    return np.array(times, np.int64)


def ragged(*frames: ContactArrays) -> RaggedContacts:
    columns = ContactArrays(*map(np.concatenate, zip(*frames, strict=True)))
    return RaggedContacts(columns, np.array([len(frame.depth) for frame in frames]))


def test_frames_are_encoded_together_as_alone() -> None:
    times, poses = at(1_999_999_999, 2_000_000_000, 0), np.ones((3, 4, 7))
    poses[1], poses[2] = 0.0, -0.0
    some = [contacts([(0, 1), (1, 2)]), contacts([]), contacts([(0, 1)])]
    depths = [Penetrations(c.body_a, c.body_b, c.point, c.body_b, c.depth, c.body_a) for c in some]
    pairs = RaggedPenetrations(Penetrations(*map(np.concatenate, zip(*depths, strict=True))), at(2, 0, 1))
    encoder, points, arrows = FrameEncoder(NAMES), ContactPointsEncoder(), ContactArrowsEncoder()
    transforms, joints = TransformsEncoder(NAMES), JointStateEncoder(["a", "b"])
    stages, ns, counts = ["step", "step.some"], np.array([[1, 300], [0, 0], [7, 5]]), np.array([[1, 0], [1, 0], [1, 2]])
    together = [
        transforms.encode(poses, times),
        joints.encode(poses[:, 0, :2], times),
        encoder.contacts(ragged(*some), at(0, 1, 2), times),
        points.encode(ragged(*some), times),
        arrows.encode(ragged(*some), times, np.array([0.0, 0.1, 0.1])),
        encoder.penetrations(pairs, at(0, 1, 2), times),
        encoder.timing(stages, ns, counts, at(0, 1, 2), times),
    ]
    for k in range(3):
        one, time, frame = ragged(some[k]), times[k : k + 1], at(k)
        alone = [
            transforms.encode(poses[k : k + 1], time),
            joints.encode(poses[k : k + 1, 0, :2], time),
            encoder.contacts(one, frame, time),
            points.encode(one, time),
            arrows.encode(one, time, np.array([0.1 if k else 0.0])),
            encoder.penetrations(RaggedPenetrations(depths[k], one.counts), frame, time),
            encoder.timing(stages, ns[k : k + 1], counts[k : k + 1], frame, time),
        ]
        assert [column[k] for column in together] == [data for (data,) in alone]
        for kind, (data,) in zip(
            (FrameTransforms, Contacts, PointCloud, SceneUpdate), alone[:1] + alone[2:5], strict=True
        ):
            assert kind.FromString(data).SerializeToString() == data


def contacts(pairs: list[tuple[int, int]]) -> ContactArrays:
    random = np.random.default_rng(1)
    n = len(pairs)
    normals = random.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ids = np.array(pairs, np.int64).reshape(n, 2)
    return ContactArrays(
        ids[:, 0], ids[:, 1], random.normal(size=(n, 3)), normals, random.random(n), random.random(n), np.zeros(n)
    )


@pytest.mark.parametrize("pairs", [[], [(0, 1)], [(0, 1), (0, 1), (1, 2)], [(0, 1), (1, 2), (0, 1)]])
def test_contacts_decode_to_what_went_in(pairs: list[tuple[int, int]]) -> None:
    given_contacts = contacts(pairs)
    encoder = FrameEncoder(NAMES)
    for frame in (0, 300):
        message = Contacts.FromString(encoder.contacts(ragged(given_contacts), np.array([frame]), at(5))[0])
        assert message.frame == frame
        assert message.timestamp.ToNanoseconds() == 5
        rows = [(NAMES.index(c.body_a), NAMES.index(c.body_b)) for c in message.contacts]
        assert rows == pairs
        for i, c in enumerate(message.contacts):
            assert (c.point.x, c.point.y, c.point.z) == tuple(given_contacts.point[i])
            assert (c.normal.x, c.normal.y, c.normal.z) == tuple(given_contacts.normal[i])
            assert (c.depth, c.normal_impulse) == (given_contacts.depth[i], given_contacts.normal_impulse[i])
            assert c.tangential_impulse == 0.0


def test_contact_points_are_packed_as_their_fields_say() -> None:
    some = contacts([(0, 1), (2, 3)])
    message = PointCloud.FromString(ContactPointsEncoder().encode(ragged(some), at(7_000_000_001))[0])
    assert message.timestamp.ToNanoseconds() == 7_000_000_001
    assert message.frame_id == "world"
    layout = np.dtype(
        {
            "names": [f.name for f in message.fields],
            "formats": ["<f4"] * len(message.fields),
            "offsets": [f.offset for f in message.fields],
            "itemsize": message.point_stride,
        }
    )
    points = np.frombuffer(message.data, layout)
    assert np.allclose(np.stack([points[a] for a in "xyz"], 1), some.point, atol=1e-6)
    assert np.allclose(points["depth"], some.depth)
    assert points["body_b"].tolist() == [1, 3]
    assert message.SerializeToString() == ContactPointsEncoder().encode(ragged(some), at(7_000_000_001))[0]
    empty = ContactPointsEncoder().encode(ragged(contacts([])), at(0))[0]
    assert PointCloud.FromString(empty).SerializeToString() == empty


def test_encoding_many_frames_takes_no_more_memory_than_some() -> None:
    some, encoder = contacts([(0, 1), (2, 3)] * 4), FrameEncoder(NAMES)
    points, arrows, transforms = ContactPointsEncoder(), ContactArrowsEncoder(), TransformsEncoder(NAMES)
    depths = Penetrations(
        body_a=some.body_a, body_b=some.body_b, pd=some.point, convex_pairs=some.body_a, largest=some.depth,
        method=np.zeros(8, np.int64),
    )  # fmt: skip
    batch = ragged(*[some] * 100)
    pairs = RaggedPenetrations(Penetrations(*map(np.concatenate, zip(*[depths] * 100, strict=True))), batch.counts)

    def encode(frames: int) -> None:
        for first in range(0, frames, 100):
            numbers = np.arange(first, first + 100)
            points.encode(batch, numbers)
            arrows.encode(batch, numbers, np.ones(100))
            transforms.encode(np.full((100, 4, 7), float(first)), numbers)
            encoder.contacts(batch, numbers, numbers)
            encoder.penetrations(pairs, numbers, numbers)
            stages = ["step.some_stage"] * 10
            encoder.timing(stages, np.tile(numbers[:, None], 10), np.ones((100, 10), np.int64), numbers, numbers)
            for k in numbers.tolist():
                encoder.log("info", f"frame {k}", k)

    encode(2_000)
    before = resident_bytes()
    encode(10_000)
    assert resident_bytes() - before < 2 * 2**20


def resident_bytes() -> int:
    """What this process has in memory, also what no tracer of Python's sees."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_contact_arrows_stand_at_the_points_along_the_normals() -> None:
    some = contacts([(0, 1), (2, 3)])
    message = SceneUpdate.FromString(ContactArrowsEncoder().encode(ragged(some), at(9), np.ones(1))[0])
    (entity,) = message.entities
    assert entity.timestamp.ToNanoseconds() == 9
    assert entity.frame_id == "world"
    assert len(entity.arrows) == 2
    for arrow, point, normal in zip(entity.arrows, some.point, some.normal, strict=True):
        q, p = arrow.pose.orientation, arrow.pose.position
        assert (p.x, p.y, p.z) == tuple(point)
        assert rotation_from_quaternion([q.x, q.y, q.z, q.w])[:, 0] == pytest.approx(normal, abs=1e-12)
        assert arrow.shaft_length > 0
    empty = SceneUpdate.FromString(ContactArrowsEncoder().encode(ragged(contacts([])), at(9), np.ones(1))[0])
    assert [len(e.arrows) for e in empty.entities] == [0]
    assert empty.entities[0].id == entity.id, "an entity of the same id replaces the arrows of before"


def test_arrows_turn_x_to_any_direction() -> None:
    directions = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, -1], [-0.6, 0.8, 0]], float)
    turned = rotation_from_quaternion(arrow_orientations(directions))[:, :, 0]
    assert turned == pytest.approx(directions, abs=1e-12)
    assert MIN_ARROW_LENGTH > 0
    assert ARROW_SCALE > 1
