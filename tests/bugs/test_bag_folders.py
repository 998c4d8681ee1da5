"""Bag folders as tools leave them: no storage named, parts that are not named, several parts a topic, folders of logs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from geomphys_cli.main import run

from geomphys.config import Config
from geomphys.errors import DamagedLogError, LogError
from geomphys.load import load_world
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.inspect import inspect_log
from geomphys.recording.reader import open_log
from tests.recording.log_files import Tree, joints, make_world, pose, write_log

HAND = make_world(Tree(root="/wrist", topic="/glove", joints=("a",)))
PARTS = 3
EACH = 20


def bag(folder: Path, named: Sequence[str] | None, storage: str | None = "mcap", stem: str = "take_") -> Path:
    """A bag of three parts of 20 messages a topic; `named` are those in its metadata."""
    folder.mkdir()
    for part in range(PARTS):
        items = []
        for k in range(part * EACH, (part + 1) * EACH):
            items += [
                pose("/wrist", 10 + k / 60, (k / 128, 0, 0, 0, 0, 0, 1)),
                joints("/glove", 10 + k / 60, {"a": 0.01 * k}),
            ]
        write_log(folder / f"{stem}{part}.mcap", items)
    if named is not None:
        storage_line = "" if storage is None else f"  storage_identifier: {json.dumps(storage)}\n"
        files = "".join(f"    - {name}\n" for name in named)
        (folder / "metadata.yaml").write_text(
            f"rosbag2_bagfile_information:\n  version: 5\n{storage_line}  relative_file_paths:\n{files}"
        )
    return folder


ALL = [f"take_{k}.mcap" for k in range(PARTS)]


@pytest.mark.parametrize("storage", ["", None, "mcap"])
def test_a_storage_that_is_not_named_is_that_of_the_files(tmp_path: Path, storage: str | None) -> None:
    with FrameSource(bag(tmp_path / "take", ALL, storage), HAND, Config()) as source:
        assert [128 * f.roots[0, 0] for f in source] == list(range(PARTS * EACH))
        assert source.report.warnings == ()


@pytest.mark.parametrize("named", [["take_0.mcap"], ["take_2.mcap"], ["take_1.mcap", "take_0.mcap"]])
def test_parts_that_the_metadata_does_not_name_are_read_and_told(tmp_path: Path, named: list[str]) -> None:
    folder = bag(tmp_path / "take", named)
    with FrameSource(folder, HAND, Config()) as source:
        assert [128 * f.roots[0, 0] for f in source] == list(range(PARTS * EACH))
        told = [w for w in source.report.warnings if "metadata.yaml does not name" in w]
    assert len(told) == 1
    assert all((name in told[0]) == (name not in named) for name in ALL)
    info = inspect_log(folder)
    assert info.messages == 2 * PARTS * EACH
    assert list(info.notes) == told


def test_a_log_of_another_name_in_a_bag_is_told_and_not_read(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", ALL)
    write_log(folder / "other.mcap", [pose("/wrist", 10.5, (99, 0, 0, 0, 0, 0, 1))])
    with FrameSource(folder, HAND, Config()) as source:
        assert [128 * f.roots[0, 0] for f in source] == list(range(PARTS * EACH))
        assert any("other.mcap" in w and "not read" in w for w in source.report.warnings)


def test_a_part_named_twice_is_read_once(tmp_path: Path) -> None:
    assert open_log(bag(tmp_path / "take", ["take_0.mcap", *ALL])).messages == 2 * PARTS * EACH


def test_a_part_that_is_not_there_is_told_and_recovered_from(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", [*ALL, "take_3.mcap"])
    with pytest.raises(DamagedLogError, match=r"take_3\.mcap.*--recover"):
        open_log(folder)
    assert open_log(folder, recover=True).messages == 2 * PARTS * EACH


@pytest.mark.parametrize("storage", ["sqlite3", "", None])
def test_bags_of_sqlite_are_told_with_the_conversion(tmp_path: Path, storage: str | None) -> None:
    folder = bag(tmp_path / "take", ["take_0.db3", "take_1.db3"], storage)
    for file in folder.glob("*.mcap"):
        file.rename(file.with_suffix(".db3"))
    with pytest.raises(LogError, match=r"sqlite3.*ros2 bag convert.*mcap convert"):
        open_log(folder)
    (folder / "metadata.yaml").unlink()
    with pytest.raises(LogError, match=r"sqlite3.*ros2 bag convert.*mcap convert"):
        open_log(folder)


def test_info_has_one_row_a_topic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = bag(tmp_path / "take", ALL)
    topics = inspect_log(folder).topics
    assert [(t.topic, t.messages) for t in topics] == [("/glove", 60), ("/wrist", 60)]
    for topic in topics:
        assert topic.rate_hz == pytest.approx(60, rel=1e-6)
        assert topic.longest_gap_s == pytest.approx(1 / 60, abs=1e-6)
    assert topics[0].joints == ("a",)
    assert topics[0].ranges == {"a": (0.0, pytest.approx(0.59))}
    assert run(["info", str(folder)]) == 0
    assert capsys.readouterr().out.count("/wrist") == 1


@pytest.mark.parametrize("recover", [False, True])
def test_a_folder_of_logs_is_no_bag(tmp_path: Path, recover: bool, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "takes"
    folder.mkdir()
    for name in ("grab.mcap", "pinch.mcap"):
        write_log(folder / name, [pose("/wrist", k / 10, (k, 0, 0, 0, 0, 0, 1)) for k in range(10)])
    with pytest.raises(LogError, match=r"folder of 2 logs \(grab\.mcap, pinch\.mcap\).*name one.*geomphys batch"):
        open_log(folder, recover=recover)
    assert run(["info", str(folder), *(["--recover"] if recover else [])]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_parts_without_metadata_are_those_of_a_recorder_that_was_not_closed(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", None)
    with pytest.raises(DamagedLogError, match=r"metadata\.yaml.*--recover.*take_0\.mcap.*name one of them"):
        open_log(folder)
    assert open_log(folder, recover=True).messages == 2 * PARTS * EACH


@pytest.mark.parametrize("name", ["empty_storage_id", "split"])
def test_the_cases(shared_dir: Path, name: str) -> None:
    folder = shared_dir / "cases" / "bags"
    report = check_log(folder / name, load_world(folder / "scene.toml"))
    assert report.errors == ()
    assert report.recording is not None
    assert report.recording.frames == 60
    topics = inspect_log(folder / name).topics
    assert len({t.topic for t in topics}) == len(topics)
    assert {t.topic: t.messages for t in topics}["/tracker/wrist"] == 60
