"""Which logs a batch finds, and what their outputs are called."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from geomphys.batch.plan import plan_logs
from geomphys.errors import LogError, OutputError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Logs and other files; nobody reads them here."""
    for name in (
        "a.mcap", "b.mcap", "notes.txt", ".hidden.mcap", "old.partial.mcap", "monday/a.mcap", "monday/late/c.mcap",
        "bag.2024/metadata.yaml", "bag.2024/bag_0.mcap", "bag.2024/bag_1.mcap", ".git/d.mcap", "out/a.mcap",
    ):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    return tmp_path


def names(*inputs: Path, folder: Path) -> list[str]:
    """Names of the outputs."""
    return [plan.name for plan in plan_logs(inputs, folder)]


def test_a_folder_gives_all_below_it_in_its_place(folder: Path) -> None:
    assert names(folder, folder=folder / "out") == ["a", "b", "bag.2024", "monday/a", "monday/late/c"]


def test_files_and_bags_are_named_by_themselves(folder: Path) -> None:
    assert names(folder / "b.mcap", folder / "bag.2024", folder=folder / "out") == ["b", "bag.2024"]
    assert names(folder / "monday", folder=folder / "out") == ["a", "late/c"]


def test_a_log_named_twice_is_one(folder: Path) -> None:
    assert names(folder / "a.mcap", folder / "monday" / ".." / "a.mcap", folder=folder / "out") == ["a"]


def test_two_logs_of_one_name_are_refused(folder: Path) -> None:
    with pytest.raises(OutputError, match=r"monday/a\.mcap.*subfolders"):
        plan_logs([folder / "a.mcap", folder / "monday" / "a.mcap"], folder / "out")


def test_an_output_that_is_a_folder_of_others_is_refused(folder: Path) -> None:
    inner = folder / "x" / "a.mcap"
    (inner / "deep").mkdir(parents=True)
    (inner / "deep" / "e.mcap").write_bytes(b"")
    with pytest.raises(OutputError, match="folder of other outputs"):
        plan_logs([folder / "a.mcap", folder / "x"], folder / "out")


@pytest.mark.parametrize("name", ["nothing.mcap", "empty"])
def test_no_log(folder: Path, name: str) -> None:
    (folder / "empty").mkdir()
    with pytest.raises(LogError, match=name):
        plan_logs([folder / name], folder / "out")


def test_time_goes_with_the_number_of_logs(tmp_path: Path) -> None:
    """Not with its square: three thousand logs took 40 s."""
    for number in range(3000):
        (tmp_path / f"{number}.mcap").write_bytes(b"")
    before = time.process_time()
    assert len(names(tmp_path, folder=tmp_path / "out")) == 3000
    assert time.process_time() - before < 8
