"""Machine code on disk: one process at a time makes a product, and one that dies while it is at it is waited for by nobody."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from geomphys.jit.folder import cache_folder, store
from geomphys.jit.products import (
    Key,
    Product,
    Program,
    is_there,
    load,
    load_program,
    locked,
    save,
    save_program,
    symbol_of,
)
from geomphys.storage.cache import user_cache_folder

HOLD = """
import sys, time
from geomphys.jit.products import locked
with locked("m.kernel.unit", wait=True) as free:
    print(free, flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A cache of its own."""
    remembered = (cache_folder, store, user_cache_folder)
    with monkeypatch.context() as changed:
        changed.setenv("XDG_CACHE_HOME", str(tmp_path))
        for function in remembered:
            function.cache_clear()
        yield
    for function in remembered:
        function.cache_clear()


def test_a_process_that_dies_at_work_leaves_the_work_to_others() -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "True\n"
        with locked("m.kernel.unit", wait=False) as free:
            assert not free
        with locked("m.other.unit", wait=False) as free:
            assert free
    finally:
        holder.kill()
        holder.communicate()
    begin = time.monotonic()
    with locked("m.kernel.unit", wait=True) as free:
        assert free
    assert time.monotonic() - begin < 5.0


def test_a_lock_is_given_back_where_the_work_fails() -> None:
    with pytest.raises(ZeroDivisionError), locked("m.kernel.unit", wait=True):
        raise ZeroDivisionError
    with locked("m.kernel.unit", wait=False) as free:
        assert free


def test_a_product_comes_back_as_it_was() -> None:
    callees = [Key("m", "f", "float64", ""), Key("n", "g", "int64 float64", "1a2b")]
    product = Product(b"\x00machine\xff", callees, "float64")
    assert load("m.kernel.unit") is None
    assert not is_there("m.kernel.unit")
    save("m.kernel.unit", product)
    assert is_there("m.kernel.unit")
    assert load("m.kernel.unit") == product


def test_a_program_comes_back_as_it_was() -> None:
    program = Program(b"\x00machine\xff", {"m.f.1a2b": b"code", "n.g.3c4d": b""}, ("float64", "int64"))
    assert load_program("m.kernel") is None
    save_program("m.kernel", program)
    assert load_program("m.kernel") == program
    assert not is_there("m.kernel.entry")


def test_symbols_tell_kernels_kinds_and_versions_apart() -> None:
    key = Key("m", "f", "float64", "")
    others = [key._replace(**{name: "x"}) for name in key._fields]
    symbols = {symbol_of(k) for k in [key, *others]}
    assert len(symbols) == 5
    assert all("/" not in symbol for symbol in symbols)
    assert symbol_of(Key(*key)) == symbol_of(key)
