"""Messages encoded by columns against the protobuf package, which encodes each of them alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import given
from hypothesis import strategies as st

from geomphys.output.byte_strings import ByteStrings
from geomphys.output.proto.geomphys_pb2 import Contact, Contacts, FrameMetrics, PairPenetration
from geomphys.output.protobuf_columns import Rows, message, stamps

DOUBLES = st.floats() | st.sampled_from([0.0, -0.0, float("nan"), float("-inf"), 5e-324])
WHOLE = st.integers(0, 2**32 - 1) | st.sampled_from([0, 1, 127, 128, 2**14 - 1, 2**14])
LONG = st.integers(0, 2**63 - 1) | WHOLE
NAMES = ["", "palm", "x" * 127, "y" * 128, "žlab/näme"]


def columns(rows: list[tuple[Any, ...]], width: int) -> list[np.ndarray]:
    return [np.array([row[k] for row in rows]) for k in range(width)]


@given(st.lists(st.tuples(LONG, WHOLE, DOUBLES, st.booleans(), DOUBLES), min_size=1, max_size=6))
def test_numbers(rows: list[tuple[int, int, float, bool, float]]) -> None:
    frame, contacts, recorded, held, error = columns(rows, 5)
    encoded = message(
        FrameMetrics,
        held=held,
        frame=frame,
        fingertip_error_m=error,
        contacts=contacts,
        recorded_penetration_m=recorded,
    )
    expected = [
        FrameMetrics(frame=f, contacts=c, recorded_penetration_m=r, held=h, fingertip_error_m=e)
        for f, c, r, h, e in rows
    ]
    assert [*encoded.split()] == [m.SerializeToString() for m in expected]


@given(st.lists(st.tuples(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**31), 2**31 - 1)), min_size=1, max_size=6))
def test_negative_numbers(rows: list[tuple[int, int]]) -> None:
    seconds, nanos = columns(rows, 2)
    encoded = message(Timestamp, seconds=seconds, nanos=nanos).split()
    assert [*encoded] == [Timestamp(seconds=s, nanos=n).SerializeToString() for s, n in rows]


@given(st.lists(st.integers(0, 2**62), max_size=6))
def test_stamps(times: list[int]) -> None:
    expected = [Timestamp(seconds=t // 10**9, nanos=t % 10**9).SerializeToString() for t in times]
    assert [*stamps(np.array(times, np.int64)).split()] == expected


@given(
    st.lists(
        st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4), WHOLE, DOUBLES, DOUBLES, DOUBLES), max_size=4),
        max_size=5,
    )
)
def test_messages_in_messages_and_how_many_belong_together(frames: list[list[tuple[Any, ...]]]) -> None:
    rows, names = [row for frame in frames for row in frame], ByteStrings.of([name.encode() for name in NAMES])
    a, b, pairs, x, z, depth = columns(rows, 6) if rows else [np.zeros(0, np.int64)] * 3 + [np.zeros(0)] * 3
    encoded = message(
        PairPenetration,
        body_a=names[a],
        body_b=names[b],
        pd=message(Vector3, x=x, z=z),
        convex_pairs=pairs,
        largest=depth,
        method=b"global",
    )
    expected = [
        b"".join(
            PairPenetration(
                body_a=NAMES[a], body_b=NAMES[b], pd=Vector3(x=x, z=z), convex_pairs=n, largest=d, method="global"
            ).SerializeToString()
            for a, b, n, x, z, d in frame
        )
        for frame in frames
    ]
    assert [*encoded.split(np.array([len(frame) for frame in frames], np.int64))] == expected


@given(st.lists(st.binary(max_size=300), min_size=1, max_size=6))
def test_strings_that_are_pieces_of_another(parts: list[bytes]) -> None:
    pieces = ByteStrings.of([part for part in parts for part in (part[:7], part[7:])])
    whole = pieces.grouped(np.full(len(parts), 2))
    assert [*whole] == parts
    assert [*pieces[2:].grouped(np.full(len(parts) - 1, 2))] == parts[1:]
    clouds = message(PointCloud, frame_id=b"world", data=whole).split()
    assert [*clouds] == [PointCloud(frame_id="world", data=part).SerializeToString() for part in parts]


@pytest.mark.parametrize("count", [1, 2])
def test_a_message_of_what_is_the_same_in_all_and_of_columns(count: int) -> None:
    texts = [f"{k}" * 70 for k in range(count)]
    names = message(SceneEntity, id=ByteStrings.of([text.encode() for text in texts])).split()
    entity = Rows.beside([message(SceneEntity, timestamp=stamps(np.array([1]))), names])
    expected = []
    for text in texts:
        update = SceneUpdate()
        update.entities.add(id=text).timestamp.nanos = 1
        expected.append(update.SerializeToString())
    assert [*message(SceneUpdate, entities=entity).split()] == expected
    depth = message(Contact, depth=1.0, point=message(Vector3, x=-0.0, y=0.0))
    point = Contact(depth=1.0)
    point.point.x = -0.0
    assert [*depth.split()] == [point.SerializeToString()]


def test_an_empty_message_in_a_message_is_there() -> None:
    contact = Contact(depth=1.0)
    contact.point.SetInParent()
    encoded = message(Contact, point=message(Vector3, x=np.zeros(2)), depth=np.ones(2)).split()
    assert [*encoded] == [contact.SerializeToString()] * 2
    nothing = message(Contacts, contacts=message(Contact, depth=np.zeros(0)))
    assert [*nothing.split(np.array([0, 0]))] == [b"", b""]


def test_rows_are_taken_and_put_side_by_side() -> None:
    names = ByteStrings.of([b"", b"ab", b"cde"])[np.array([2, 0, 1])]
    numbers = ByteStrings.of_rows(np.array([[1, 2], [3, 4], [5, 6]], np.uint8))
    assert [*Rows.beside([b"-", names, numbers]).split()] == [
        b"-cde\1\2",
        b"-\3\4",
        b"-ab\5\6",
    ]
