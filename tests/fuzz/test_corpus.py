"""The corpus of the fuzz runs, replayed: what was found once is not found again, and a few mutations of each file."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from tests.fuzz.run import CORPUS, MEGABYTES, forget_peak, peak_mb, seconds_for
from tests.fuzz.targets import TARGETS

FILES = sorted(path for path in CORPUS.glob("*/*") if path.is_file())
MUTATIONS = 30


def mutations(data: bytes, seed: int) -> list[bytes]:
    """The bytes, cut off, and with bytes changed, left out and repeated, the same at every call."""
    chance, made = random.Random(seed), [data, data[: len(data) // 2]]
    for _ in range(MUTATIONS):
        other = bytearray(data)
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(len(other) + 1)
            length = chance.choice((1, 1, 4, 8))
            kind = chance.randrange(4)
            if kind == 0:
                other[at : at + length] = chance.randbytes(length)
            elif kind == 1:
                other[at : at + length] = chance.choice((b"\xff", b"\0", b"\x7f")) * length
            elif kind == 2:
                del other[at : at + length]
            else:
                other[at:at] = other[max(0, at - 32) : at] * chance.choice((1, 3))
        made.append(bytes(other))
    return made


def test_every_target_has_a_corpus() -> None:
    assert {path.parent.name for path in FILES} == set(TARGETS)
    assert all(path.stat().st_size < 20_000 for path in FILES)


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_nothing_but_an_error_of_one_line_in_little_time_and_memory(path: Path, tmp_path: Path) -> None:
    target = TARGETS[path.parent.name]
    target(b"", tmp_path)  # loads what it needs
    forget_peak()
    before = peak_mb()
    for number, data in enumerate(mutations(path.read_bytes(), seed=1)):
        start = time.process_time()
        target(data, tmp_path)
        assert time.process_time() - start < seconds_for(len(data)), number
    assert peak_mb() < before + MEGABYTES
