"""Which files make up a log: the parts of a bag in their order, none from outside, and what is missing said."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.bag import METADATA_LIMIT, log_files


def bag(folder: Path, names: list[str], present: list[str], **fields: str) -> Path:
    """A bag whose metadata names some files, and the (empty) files that are there."""
    folder.mkdir(exist_ok=True)
    for name in present:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    lines = ["rosbag2_bagfile_information:", *(f"  {key}: {value}" for key, value in fields.items())]
    lines += ["  relative_file_paths:", *(f"    - {name}" for name in names)]
    (folder / "metadata.yaml").write_text("\n".join(lines))
    return folder


def names(folder: Path, **options: bool) -> list[str]:
    return [file.name for file in log_files(folder, **options).files]


def test_a_file_is_a_log_of_one(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch()
    assert log_files(tmp_path / "a.mcap").files == (tmp_path / "a.mcap",)


def test_parts_are_read_in_the_order_of_the_metadata_once_each(tmp_path: Path) -> None:
    parts = ["b.mcap", "a.mcap", "b.mcap"]
    assert names(bag(tmp_path / "take", parts, ["a.mcap", "b.mcap"])) == ["b.mcap", "a.mcap"]


def test_numbers_in_names_count_as_numbers(tmp_path: Path) -> None:
    present = [f"take_{k}.mcap" for k in (10, 9, 2, 11)]
    folder = bag(tmp_path / "take", ["take_2.mcap"], present)
    assert names(folder) == [f"take_{k}.mcap" for k in (2, 9, 10, 11)]
    (folder / "metadata.yaml").unlink()
    assert names(folder, recover=True) == [f"take_{k}.mcap" for k in (2, 9, 10, 11)]


def test_an_unrelated_log_beside_the_parts_is_told_and_not_read(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", ["take_0.mcap"], ["take_0.mcap", "other.mcap"])
    found = log_files(folder)
    assert [file.name for file in found.files] == ["take_0.mcap"]
    assert "other.mcap" in found.notes[0]


def test_a_missing_part_is_damage_unless_it_is_recovered(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", ["take_0.mcap", "take_1.mcap"], ["take_1.mcap"])
    with pytest.raises(DamagedLogError, match=r"take_0\.mcap"):
        log_files(folder)
    found = log_files(folder, recover=True)
    assert [file.name for file in found.files] == ["take_1.mcap"]
    assert found.missing == ("take_0.mcap is not in the bag",)
    (folder / "take_1.mcap").unlink()
    with pytest.raises(LogError, match="none of the 2 files"):
        log_files(folder, recover=True)


@pytest.mark.parametrize("name", ["../secret.mcap", "/etc/passwd", "sub/../../secret.mcap"])
def test_a_part_outside_of_the_bag_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.mcap").touch()
    with pytest.raises(LogError, match="outside of the bag"):
        log_files(bag(tmp_path / "take", [name], []))


def test_older_recorders_put_the_name_of_the_bag_before_a_part(tmp_path: Path) -> None:
    assert names(bag(tmp_path / "take", ["take/take_0.mcap"], ["take_0.mcap"])) == ["take_0.mcap"]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"storage_identifier": "sqlite3"}, "sqlite3"),
        ({"storage_identifier": "rosbag_v2"}, "ros2 bag convert"),
        ({"storage_identifier": "mcap", "compression_mode": "file"}, "compression"),
    ],
)
def test_bags_that_cannot_be_read_are_told_with_a_remedy(tmp_path: Path, fields: dict[str, str], said: str) -> None:
    with pytest.raises(LogError, match=said):
        log_files(bag(tmp_path / "take", ["a.mcap"], ["a.mcap"], **fields))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- 1",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information:\n  relative_file_paths: []",
        "a: [",
        "\0",
    ],
)
def test_metadata_that_is_none_is_an_error_that_names_it(tmp_path: Path, text: str) -> None:
    folder = bag(tmp_path / "take", ["a.mcap"], ["a.mcap"])
    (folder / "metadata.yaml").write_text(text)
    with pytest.raises(LogError, match=r"metadata\.yaml"):
        log_files(folder)
    (folder / "metadata.yaml").write_bytes(b" " * (METADATA_LIMIT + 1))
    with pytest.raises(LogError, match="larger than"):
        log_files(folder)


def test_a_folder_of_logs_and_an_empty_one_are_no_bags(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="not a bag"):
        log_files(tmp_path)
    for name in ("morning.mcap", "evening.mcap"):
        (tmp_path / name).touch()
    with pytest.raises(LogError, match="folder of 2 logs"):
        log_files(tmp_path, recover=True)
    with pytest.raises(LogError, match="does not exist"):
        log_files(tmp_path / "absent")
