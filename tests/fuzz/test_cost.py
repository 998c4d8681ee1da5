"""Processor time for each byte of a file: it stays within a bound, however large a file that was made to take long."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from tests.fuzz.growing import FAMILIES, LARGE, OVERLAPPING, Family
from tests.fuzz.targets import TARGETS

SECONDS = 0.4
"""What any file may take beside its bytes."""


def check(family: Family, size: int, folder: Path) -> None:
    target, data = TARGETS[family.target], family.make(size)
    target(family.make(2), folder)  # loads what it needs
    start = time.process_time()
    target(data, folder)
    spent = time.process_time() - start
    assert spent < SECONDS + 1e-6 * family.microseconds * len(data), f"{spent:.2f} s for {len(data)} bytes"


@pytest.mark.parametrize("name", FAMILIES)
def test_the_time_of_a_byte_is_bounded(tmp_path: Path, name: str) -> None:
    check(FAMILIES[name], FAMILIES[name].size, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_the_time_of_a_byte_is_bounded_in_large_files_too(tmp_path: Path, name: str) -> None:
    check(FAMILIES[name], LARGE[name], tmp_path)


@pytest.mark.slow
def test_chunks_that_overlap_are_read_in_the_order_of_time_without_a_search(tmp_path: Path) -> None:
    check(OVERLAPPING, OVERLAPPING.size, tmp_path)
