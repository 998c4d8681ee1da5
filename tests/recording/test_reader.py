"""Reading MCAP: the same messages as the library reads, whatever the layout; bags; what is no log at all."""

from __future__ import annotations

import random
import tracemalloc
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType

from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.reader import PENDING_LIMIT, open_log
from tests.recording.log_files import IDENTITY, Item, S, joints, pose, write_log

LAYOUTS = [
    {"compression": CompressionType.ZSTD},
    {"compression": CompressionType.LZ4, "chunk_size": 500},
    {"compression": CompressionType.NONE, "chunk_size": 500},
    {"use_chunking": False},
    {"enable_crcs": False, "use_statistics": False, "use_summary_offsets": False},
    {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
    {"enable_data_crcs": True},
    {"use_chunking": False, "enable_data_crcs": True},
]


def some_items(count: int = 60) -> list[Item]:
    items = []
    for k in range(count):
        items.append(pose("/wrist", 5 + k / 100, (k, 0, 0, 0, 0, 0, 1), publish_time=k))
        items.append(joints("/glove", 5 + (k * 7 % count) / 100, {"a": 0.1 * k}))
    return items


def library_messages(path: Path) -> list[tuple]:
    with path.open("rb") as stream:
        found = NonSeekingReader(stream).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.publish_time, m.data) for _, c, m in found]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_messages_are_those_of_the_library_in_the_order_of_their_log_times(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", some_items(), **layout, metadata={"source": {"by": "me"}})
    expected = sorted(library_messages(path), key=lambda m: m[1])
    with open_log(path) as reader:
        got = [(reader.channels[m.key].topic, *m[1:4]) for m in reader.read()]
        assert got == expected
        assert reader.messages == len(expected) == 120
        assert (reader.start_ns, reader.end_ns) == (expected[0][1], expected[-1][1])
        assert reader.topics == ("/glove", "/wrist")
        assert reader.damage is None
        assert dict(reader.metadata) == {"source": {"by": "me"}}
        wrist = {c.key for c in reader.of_topic("/wrist")}
        assert [m[1:4] for m in reader.read(wrist)] == [m[1:] for m in expected if m[0] == "/wrist"]
        keys = set(reader.channels)
        for k, _ in enumerate(reader.read(keys)):
            if k == 4:
                keys.clear()
            assert k <= 4


def test_the_real_recordings_are_read_as_the_library_reads_them(shared_dir):
    for path in sorted((shared_dir / "recordings").glob("*.mcap"))[::4]:
        reader = open_log(path)
        got = [(reader.channels[m.key].topic, *m[1:4]) for m in reader.read()]
        assert got == sorted(library_messages(path), key=lambda m: m[1])


def test_memory_is_that_of_a_few_chunks_not_of_the_log(tmp_path):
    data = bytes(20_000)
    items = (Item("/camera", "raw", data, k * S) for k in range(2000))
    path = write_log(tmp_path / "log.mcap", items, chunk_size=200_000)
    tracemalloc.start()
    reader = open_log(path)
    assert sum(1 for _ in reader.read()) == 2000
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5_000_000 < 2000 * len(data)
    assert PENDING_LIMIT <= 2**28


def test_a_log_that_is_not_there_or_not_one_says_so(tmp_path):
    with pytest.raises(LogError, match="does not exist"):
        open_log(tmp_path / "no.mcap")
    with pytest.raises(LogError, match="not a bag"):
        open_log(tmp_path)
    for content, said in (
        (b"", "is empty"),
        (b"hello, this is text", "not an MCAP"),
        (b"#ROSBAG V2.0\n" + bytes(100), "ROS 1 bag"),
        (b"SQLite format 3\0" + bytes(100), "SQLite"),
        (b"\x28\xb5\x2f\xfd" + bytes(100), "unpack it"),
    ):
        path = tmp_path / "x.mcap"
        path.write_bytes(content)
        with pytest.raises(LogError, match=said) as caught:
            open_log(path, recover=True)
        assert not isinstance(caught.value, DamagedLogError)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


# --- bags


def write_bag(folder: Path, parts: dict[str, list[Item]], **fields: object) -> Path:
    import yaml

    folder.mkdir(parents=True, exist_ok=True)
    for name, items in parts.items():
        write_log(folder / name, items)
    info = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": list(parts), "compression_mode": ""}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": info | fields}))
    return folder


def halves() -> dict[str, list[Item]]:
    items = some_items()
    return {"bag_10.mcap": items[:60], "bag_9.mcap": items[60:]}


def test_a_bag_is_its_parts_in_the_order_of_its_metadata(tmp_path):
    bag = write_bag(tmp_path / "bag", halves())
    reader = open_log(bag)
    assert [f.name for f in reader.files] == ["bag_10.mcap", "bag_9.mcap"]
    whole = open_log(write_log(tmp_path / "one.mcap", some_items()))
    assert [m[1:4] for m in reader.read()] == [m[1:4] for m in whole.read()]
    assert len(reader.channels) == 4
    assert len(reader.of_topic("/wrist")) == 2


def test_older_bags_name_their_parts_with_the_folders_name(tmp_path):
    bag = write_bag(tmp_path / "bag", halves(), relative_file_paths=["bag/bag_10.mcap", "bag/bag_9.mcap"])
    assert len(open_log(bag).files) == 2


def test_a_bag_without_metadata_or_with_a_missing_part_needs_recover(tmp_path):
    bag = write_bag(tmp_path / "bag", halves())
    (bag / "metadata.yaml").unlink()
    with pytest.raises(DamagedLogError, match=r"no metadata\.yaml.*--recover"):
        open_log(bag)
    reader = open_log(bag, recover=True)
    assert [f.name for f in reader.files] == ["bag_9.mcap", "bag_10.mcap"]
    assert "metadata.yaml is missing" in reader.damage.text
    bag = write_bag(tmp_path / "other", halves())
    (bag / "bag_9.mcap").unlink()
    with pytest.raises(DamagedLogError, match=r"bag_9\.mcap.*not there.*--recover"):
        open_log(bag)
    reader = open_log(bag, recover=True)
    assert reader.messages == 60
    assert "bag_9.mcap is not in the bag" in reader.damage.text


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"storage_identifier": "sqlite3"}, "ros2 bag convert"),
        ({"compression_mode": "FILE"}, "ros2 bag convert"),
        ({"relative_file_paths": ["../log.mcap"]}, "outside of the bag"),
        ({"relative_file_paths": ["/etc/passwd"]}, "outside of the bag"),
        ({"relative_file_paths": []}, "not a list of file names"),
        ({"relative_file_paths": [3]}, "not a list of file names"),
        ({"relative_file_paths": ["a\0b"]}, "no file can have"),
    ],
)
def test_bags_that_cannot_be_read_say_why(tmp_path, fields, said):
    write_log(tmp_path / "log.mcap", some_items())
    with pytest.raises(LogError, match=said):
        open_log(write_bag(tmp_path / "bag", halves(), **fields), recover=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- just\n- a list", "is this a ROS 2 bag"),
        ("a: [1, 2", "not readable as YAML at line"),
        ("a: !!python/object/apply:os.system ['true']", "not readable as YAML"),
        ("[" * 5000, "not readable as YAML"),
        ("\x00", "not readable as YAML"),
        ("x" * (5 * 2**20), "larger than"),
    ],
)
def test_metadata_that_is_none_is_an_error(tmp_path, text, said):
    bag = write_bag(tmp_path / "bag", halves())
    (bag / "metadata.yaml").write_text(text)
    with pytest.raises(LogError, match=said):
        open_log(bag)


def test_a_link_out_of_the_bag_is_not_followed(tmp_path):
    bag = write_bag(tmp_path / "bag", halves())
    write_log(tmp_path / "secret.mcap", some_items())
    (bag / "bag_9.mcap").unlink()
    (bag / "bag_9.mcap").symlink_to(tmp_path / "secret.mcap")
    with pytest.raises(LogError, match="outside of the bag"):
        open_log(bag)


def test_chunks_that_overlap_are_read_in_the_order_of_their_times(tmp_path):
    """Of one time, in the order of the file."""
    chance = random.Random(1)
    times = [chance.randrange(50) for _ in range(600)]
    path = write_log(tmp_path / "log.mcap", [pose("/a", k / 1000, IDENTITY) for k in times], chunk_size=400)
    expected = sorted(range(600), key=lambda number: times[number])
    reader = open_log(path)
    assert len(reader._scans[0].spans) > 20
    assert [message.sequence for message in reader.read()] == expected
