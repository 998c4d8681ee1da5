"""Messages of an unchanging layout are read as the decoder of their encoding reads them, and without it."""

from __future__ import annotations

import random
import struct
import threading

import pytest

from geomphys.recording.channels import kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.fixed_layout import FIRST_TRIALS, TRIALS_PER_MESSAGE, FixedLayoutReader
from geomphys.recording.samples import JointSample
from tests.recording.made_messages import content, make, pairs, ros2_data
from tests.recording.test_message_kinds import channel_of

CDR = [name for name, encoding in pairs() if encoding == "cdr"]
DOUBLE = [name for name in CDR if "Manus" not in name and "vicon" not in name]
"""Types whose numbers have double precision: of the others only the times are found."""


class Counted:
    """A reader that counts what is decoded."""

    def __init__(self, name):
        channel = channel_of(make(name, "cdr"))
        self.decode = make_message_reader(channel, kind_of(channel))._read
        self.count = 0
        self.fast = FixedLayoutReader(self._counted)

    def _counted(self, data):
        self.count += 1
        return self.decode(data)


def bits(value):
    return value if value is None or isinstance(value, int | str) else struct.pack("<d", value)


def plain(found):
    """A content with all its bits."""
    if isinstance(found, JointSample):
        return (bits(found.stamp), list(found.names), list(map(bits, found.values)), found.side)
    return [(bits(p.stamp), p.child, list(map(bits, p.value)), p.frame) for p in found]


def message(name, source):
    special = (0.0, -0.0, 1.0, float("nan"), float("inf"), -1e30, 1e-40)
    seven = tuple(source.choice(special) if source.random() < 0.2 else source.gauss(0, 2) for _ in range(7))
    stamp = source.choice([source.randrange(2**31) * 10**9 + source.randrange(10**9), source.randrange(3 * 10**9)])
    return ros2_data(name, content(name, seven, stamp, source.gauss(0, 1)))


@pytest.mark.parametrize("name", CDR)
def test_every_message_is_read_to_the_bit(name):
    source, reader = random.Random(name), Counted(name)
    for _ in range(60):
        data = message(name, source)
        assert plain(reader.fast(data)) == plain(reader.decode(data))


@pytest.mark.parametrize("name", DOUBLE)
def test_messages_of_one_layout_are_soon_read_without_the_decoder(name):
    source, reader = random.Random(name), Counted(name)
    for _ in range(40):
        reader.fast(message(name, source))
    before = reader.count
    for _ in range(40):
        reader.fast(message(name, source))
    assert reader.count == before


def test_other_names_of_the_same_length_are_not_taken_for_the_known_ones():
    reader, name = Counted("sensor_msgs/msg/JointState"), "sensor_msgs/msg/JointState"
    source, value = random.Random(1), content("sensor_msgs/msg/JointState")
    for _ in range(20):
        reader.fast(message(name, source))
    other = ros2_data(name, value | {"name": ["a", "c"], "position": [3.0, 4.0]})
    assert reader.fast(other).names == ["a", "c"]
    again = ros2_data(name, value | {"position": [5.0, 6.0]})
    assert (list(reader.fast(again).names), list(reader.fast(again).values)) == (["a", "b"], [5.0, 6.0])


def test_a_time_that_cannot_be_is_refused_as_the_decoder_refuses_it():
    name = "geometry_msgs/msg/PoseStamped"
    source, reader = random.Random(2), Counted(name)
    for _ in range(20):
        reader.fast(message(name, source))
    data = bytearray(message(name, source))
    data[4:8] = struct.pack("<i", -5)
    with pytest.raises(BadMessageError):
        reader.fast(bytes(data))


def test_bytes_that_are_not_used_may_differ_but_must_be_readable():
    """Velocities are not read; a frame id that is no text makes the message a bad one."""
    name, value = "sensor_msgs/msg/JointState", content("sensor_msgs/msg/JointState")
    source, reader = random.Random(3), Counted(name)
    for k in range(30):
        moving = {"position": [source.random(), k], "velocity": [source.random(), source.random()]}
        reader.fast(ros2_data(name, value | moving))
    before = reader.count
    data = ros2_data(name, value | {"position": [1.0, 2.0], "velocity": [-7.0, float("nan")]})
    assert list(reader.fast(data).values) == [1.0, 2.0]
    assert reader.count == before
    at = data.index(b"room")
    with pytest.raises(BadMessageError):
        reader.fast(data[:at] + b"\xff\xff\xff\xff" + data[at + 4 :])


def test_what_does_not_pay_costs_a_few_times_as_much_at_most():
    """Names that change in every message: no layout is found, and few are sought."""
    name, value = "sensor_msgs/msg/JointState", content("sensor_msgs/msg/JointState")
    source, reader = random.Random(4), Counted(name)
    for _ in range(300):
        names = ["".join(source.choices("abcdef", k=20)) for _ in range(2)]
        reader.fast(ros2_data(name, value | {"name": names, "velocity": [source.random(), 1.0]}))
    assert reader.count <= FIRST_TRIALS + (1 + TRIALS_PER_MESSAGE) * 300


def outcome(read, data):
    """The content with all its bits, or the error's text."""
    try:
        return plain(read(data))
    except BadMessageError as problem:
        return str(problem)


@pytest.mark.parametrize("name", CDR)
def test_a_reader_goes_on_with_the_next_log_whatever_it_has_read(name):
    """Messages of several logs, some cut off, with other bytes or of other names: as the decoder alone reads them."""
    source, decode = random.Random(name), Counted(name).decode
    for _ in range(4):
        channel = channel_of(make(name, "cdr"))
        reader = make_message_reader(channel, kind_of(channel))
        for _ in range(60):
            data = bytearray(message(name, source))
            for _ in range(source.choice([0, 0, 1, 3])):
                data[source.randrange(len(data))] = source.randrange(256)
            data = bytes(data[: len(data) if source.random() < 0.9 else source.randrange(len(data))])
            assert outcome(reader, data) == outcome(decode, data)


def test_each_thread_has_readers_of_its_own():
    channel = channel_of(make("sensor_msgs/msg/JointState", "cdr"))
    kind, found = kind_of(channel), []
    reader = make_message_reader(channel, kind)
    assert make_message_reader(channel, kind) is reader
    thread = threading.Thread(target=lambda: found.append(make_message_reader(channel, kind)))
    thread.start()
    thread.join()
    assert found
    assert found[0] is not reader
