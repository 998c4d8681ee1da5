"""Definitions of ROS 1 never run, and cannot make a short message take all memory."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

import pytest

from geomphys.errors import LogError
from geomphys.recording.channels import JointSample, Pose, kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.reader import LogChannel
from geomphys.recording.ros1 import DefinitionError, Field, make_ros1_decoder, parse_definition
from geomphys.recording.ros_definitions import ROS1_TYPES
from tests.recording.made_messages import SEVEN, STAMP, make

BAR = "\n" + "=" * 80 + "\n"
JOINT_STATE = "sensor_msgs/JointState"


def channel(schema: str | bytes, name: str = JOINT_STATE, encoding: str = "ros1msg") -> LogChannel:
    data = schema if isinstance(schema, bytes) else schema.encode()
    return LogChannel(0, "/t", name, encoding, data, "ros1", 1, 0, 0)


def reader(c: LogChannel):
    kind = kind_of(c)
    assert kind is not None
    return make_message_reader(c, kind)


def test_a_definition_is_read_with_comments_constants_defaults_and_short_names():
    text = f"Header header # when\nint32 A=1\nstring B=#\nFoo[] foos\nfloat64[3] v 0{BAR}MSG: p/Foo\nfloat64 x 0\n\n time t"
    types = parse_definition("p/Root", text)
    assert types["p/Root"] == (
        Field("std_msgs/Header", "", "header"), Field("p/Foo", "[]", "foos"), Field("float64", "[3]", "v"),
    )  # fmt: skip
    assert types["p/Foo"] == (Field("float64", "", "x"), Field("time", "", "t"))


@pytest.mark.parametrize(
    "schema",
    [
        b"", b"] broken", b"float64 W(", b"\xff\xfe\0", b"Foo[] name", b"float64 import os", b"bool _x",
        ROS1_TYPES["sensor_msgs/msg/JointState"].replace("\n", " 0\n", 3).encode(),
    ],
)  # fmt: skip
def test_a_standard_type_is_read_whatever_its_schema_is(schema):
    made = make("sensor_msgs/msg/JointState", "ros1")
    assert reader(channel(schema))(made.data) == JointSample(STAMP, ["a", "b"], (0.5, -0.5), "")
    assert reader(channel(b"", encoding=""))(made.data).stamp == STAMP


def test_another_type_with_a_broken_schema_is_an_error_of_one_line():
    for schema, why in (
        ("] broken", "a line that is no field"),
        ("", "missing|ros1msg"),
        ("Foo[] poses", "lacks the type"),
    ):
        c = channel(schema, "mocap4r2_msgs/RigidBodies")
        with pytest.raises(
            LogError, match=f"^topic /t: mocap4r2_msgs/RigidBodies \\(ros1\\) cannot be decoded: .*{why}"
        ) as found:
            reader(c)
        assert "\n" not in str(found.value)


EVIL = [
    'string A="""\nimport os\nos.abort()\n"""\nstring[] name',
    "string A='\\\nfloat64 x",
    "float64 x\\\nfloat64 y",
    "float64 x;import_os",
    "float64 x\rfloat64 __class__",
    "float64 x\x0cfloat64 _spec",
    "float64 deserialize",
    "float64 None",
    "string S = ''' + str(__import__('os').abort()) + '''\nfloat64 x",
    '# """ \\\nfloat64 x',
    f"a/B b{BAR}MSG: a/B\nfloat64 x\n{BAR}MSG: __import__('os').abort()\nfloat64 x",
    "a/B.C b",
]


@pytest.mark.parametrize("text", EVIL)
def test_no_text_of_a_definition_is_run(text, tmp_path, monkeypatch):
    """What is left of a definition is names and types; the rest is not even in the source that is generated."""
    path = list(sys.path)
    monkeypatch.chdir(tmp_path)
    with suppress(DefinitionError):
        decode, _ = make_ros1_decoder("p/Evil", text)
        source = Path(sys.modules[type(decode(bytes(400))).__module__].__file__).read_text()
        assert "abort" not in source
        assert "import os" not in source
    assert sys.path == path


@pytest.mark.parametrize(
    "text",
    [
        f"a/E[] name{BAR}MSG: a/E\n",
        f"a/E[] name{BAR}MSG: a/E\nuint8[8] x",
        f"a/E[] name{BAR}MSG: a/E\nfloat64[0] x",
        "float64[99999] name",
        "float64[9999999999] name",
        f"a/A name{BAR}MSG: a/A\na/B b{BAR}MSG: a/B\na/A a",
        BAR.join(["a/T0 x", *(f"MSG: a/T{k}\na/T{k + 1}[9] x\na/T{k + 1}[9] y" for k in range(20)), "MSG: a/T20\nbool x"]),
    ],
)  # fmt: skip
def test_a_definition_that_blows_up_is_refused(text):
    with pytest.raises(DefinitionError):
        make_ros1_decoder("p/Bomb", text)


def test_messages_that_are_cut_off_or_claim_too_much_are_bad(tmp_path):
    made = make("tf2_msgs/msg/TFMessage", "ros1")
    read = reader(LogChannel(0, "/t", made.schema, "ros1msg", made.schema_data, "ros1", 1, 0, 0))
    assert read(made.data) == [Pose(STAMP, "wrist", SEVEN, "room")]
    for size in range(len(made.data)):
        with pytest.raises(BadMessageError):
            read(made.data[:size])
    with pytest.raises(BadMessageError):
        read(b"\xff\xff\xff\xff" + made.data[4:])
