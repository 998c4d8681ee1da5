"""Machine code on disk, made by one process at a time."""

from __future__ import annotations

import fcntl
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple

from geomphys.jit.folder import cache_folder, store
from geomphys.jit.kinds import Kind, kind_of_text, text_of


class Key(NamedTuple):
    """A kernel, and the kinds of arguments it is compiled for."""

    module: str
    name: str
    kinds: str
    """As a text, see `geomphys.jit.kinds.text_of`."""
    stamp: str
    """Distinguishes versions of a kernel outside the package; empty inside it, see `cache_folder`."""


class Product(NamedTuple):
    """A kernel as it is on disk."""

    code: bytes  # object file, see `geomphys.jit.machine_code`
    callees: list[Key]  # the noinline kernels it jumps to
    returns: Kind


class Program(NamedTuple):
    """A kernel as Python calls it, and every noinline kernel that it jumps to, directly or through others."""

    entry: bytes  # object file
    units: dict[str, bytes]  # object files by symbol
    returns: Kind


@lru_cache(maxsize=4096)
def symbol_of(key: Key) -> str:
    """Name of the machine code of a kernel: the same in all processes, and fit for a file."""
    digest = hashlib.sha256(f"{key.stamp} {key.kinds}".encode()).hexdigest()[:16]
    return f"{key.module}.{key.name}.{digest}"


def load(name: str) -> Product | None:
    """A product that was saved, if it is there and unharmed."""
    content: Any = store().load(name)
    if content is None:
        return None
    return Product(content["code"], [Key(*plain) for plain in content["callees"]], kind_of_text(content["returns"]))


def save(name: str, product: Product) -> None:
    """Store a product; where nothing can be written it is made again next time."""
    callees = list(map(list, product.callees))
    store().save(name, {"code": product.code, "callees": callees, "returns": text_of(product.returns)})


def load_program(symbol: str) -> Program | None:
    """A program that was saved, if it is there and unharmed: in a tenth of the time that its products take."""
    content: Any = store().load(f"{symbol}.program")
    if content is None:
        return None
    return Program(content["entry"], content["units"], kind_of_text(content["returns"]))


def save_program(symbol: str, program: Program) -> None:
    """Store a program; where nothing can be written it is put together again next time."""
    store().save(f"{symbol}.program", {**program._asdict(), "returns": text_of(program.returns)})


def is_there(name: str) -> bool:
    """Whether there is a product, good or not."""
    return (cache_folder() / name).is_file()


@contextmanager
def locked(name: str, wait: bool) -> Iterator[bool]:
    """Within the block no other process makes this product; False if one is at it and `wait` is not set."""
    with _lock_file(cache_folder() / f"{name}.lock") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        except OSError:  # a file system without locks: the work is done twice
            pass
        yield True


def _lock_file(path: Path) -> IO[bytes]:
    try:
        return path.open("wb")
    except OSError:  # nothing can be written, so nothing would be found
        return Path("/dev/null").open("wb")
