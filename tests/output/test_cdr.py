"""Messages in CDR, read back by another library: alignment, strings, stamps, sequences."""

from __future__ import annotations

import random
import struct

import pytest
from rosbags.typesys import Stores, get_typestore

from geomphys.output.cdr import HEADER, CdrWriter

STORE = get_typestore(Stores.ROS2_HUMBLE)
TIME = 1_760_601_601_208_333_333  # ns


@pytest.mark.parametrize("frame_id", ["", "a", "world", "hand/α", "x" * 100])
def test_a_header_is_read_by_rosbags(frame_id: str) -> None:
    writer = CdrWriter()
    assert writer.header(TIME, frame_id) == len(HEADER)
    read = STORE.deserialize_cdr(bytes(writer.data()), "std_msgs/msg/Header")
    assert (read.stamp.sec, read.stamp.nanosec, read.frame_id) == (TIME // 10**9, TIME % 10**9, frame_id)


@pytest.mark.parametrize("frame_id", ["", "abc", "world"])
@pytest.mark.parametrize("count", [0, 1, 5])
def test_doubles_after_a_string_of_any_length_are_aligned(frame_id: str, count: int) -> None:
    rng = random.Random(count)
    rows = [[rng.uniform(-1, 1) for _ in range(7)] for _ in range(count)]
    writer = CdrWriter()
    writer.header(TIME, frame_id)
    writer.vectors(rows)
    read = STORE.deserialize_cdr(bytes(writer.data()), "geometry_msgs/msg/PoseArray")
    found = [
        [p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w]
        for p in read.poses
    ]
    assert found == rows
    again = STORE.serialize_cdr(read, "geometry_msgs/msg/PoseArray")
    assert bytes(writer.data()) == bytes(again)


def test_numbers_are_aligned_to_their_size_counted_after_the_header() -> None:
    writer = CdrWriter()
    writer.numbers("B", 1)
    writer.numbers("d", 2.5)
    writer.numbers("H", 3, 4)
    assert writer.length == len(HEADER) + 8 + 8 + 4
    data = bytes(writer.data())[len(HEADER) :]
    assert data == b"\x01" + bytes(7) + struct.pack("<dHH", 2.5, 3, 4)


def test_times_before_the_epoch_count_nanoseconds_forwards() -> None:
    writer = CdrWriter()
    writer.stamp(-1)
    assert struct.unpack("<iI", bytes(writer.data())[4:]) == (-1, 999_999_999)
