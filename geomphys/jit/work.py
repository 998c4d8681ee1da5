"""The noinline kernels that have to be compiled before a kernel can run, shared between this process and others.

What each kernel returns is known from its annotation, so kernels do not wait for each other: which are needed is found
when their callers are compiled. Processes share the work without speaking to each other: each locks the kernel it compiles,
and finds on disk what others have compiled.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

from geomphys.jit.calls import Entry
from geomphys.jit.kinds import Kind
from geomphys.jit.machine_code import is_linked, link, make_slots
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
from geomphys.jit.registry import PLAIN_NUMBA, Definition, definitions
from geomphys.storage.child_process import available_cores
from geomphys.storage.deferred_signals import signals_deferred

MAX_PROCESSES = 4
"""More would have little to do; each takes 0.3 GB."""

MIN_FOR_HELPERS = 6
"""Kernels to be compiled from which on others are called in: a process takes two seconds to get ready."""

POLL_INTERVAL_S = 0.02
"""While others are at all that is left."""

Listener = Callable[[int, int], None]

_listeners: list[Listener] = []
_ahead: list[subprocess.Popen[bytes]] = []
"""Processes that `compile_ahead` started."""


@contextmanager
def progress_to(listener: Listener | None) -> Iterator[None]:
    """Within the block, `listener` gets how many kernels are compiled, and how many are known to be needed.

    What it raises ends the compiling; what is done by then is kept. What `compile_ahead` started ends with the block.
    """
    before = list(_listeners)
    _listeners[:] = before if listener is None else [listener]
    try:
        yield
    finally:
        _listeners[:] = before
        _end(_ahead)


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Within the block no time is spent on looking for garbage: a fifth of it would be, and there is little."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def load_entry(kernel: Definition, kinds: tuple[Kind, ...]) -> Entry:
    """A kernel as Python calls it, for arguments of these kinds; compiles what is not compiled yet."""
    key = kernel.key(kinds)
    if PLAIN_NUMBA:
        from geomphys.jit.compiler import compile_in_memory

        with without_garbage_collection(), signals_deferred():
            address, returns = compile_in_memory(kernel, key)
        return Entry(address, kinds, returns)
    with without_garbage_collection():
        program = load_program(symbol_of(key)) or _program(key)
        units = {symbol: code for symbol, code in program.units.items() if not is_linked(symbol)}
        make_slots(units)
        name = f"{symbol_of(key)}.entry"
        addresses = link(units | {name: program.entry})
    return Entry(addresses[name], kinds, program.returns)


def _program(key: Key) -> Program:
    """A kernel with all that it jumps to, put together from their products; stored for the next process."""
    entry = _provide(key, entry=True)
    assert entry is not None  # it waits for other processes
    units = {symbol: unit.code for symbol, unit in complete(entry.callees).items()}
    program = Program(entry.code, units, entry.returns)
    save_program(symbol_of(key), program)
    return program


def compile_ahead(kernel: Definition, kinds: tuple[Kind, ...]) -> None:
    """Let other processes begin to compile a kernel, which Python will call, and all it jumps to; returns at once."""
    key = kernel.key(kinds)
    if not (PLAIN_NUMBA or _ahead or is_there(f"{symbol_of(key)}.program")):
        _ahead.extend(_helper(entries=[key], units=[]) for _ in range(processes() - 1))


def complete(keys: Sequence[Key]) -> dict[str, Product]:
    """Noinline kernels and all they jump to, by their symbols.

    Compiles those that are not on disk, with helpers if they are many.
    """
    helpers: list[subprocess.Popen[bytes]] = []

    def each(done: int, known: int, waiting: Sequence[Key]) -> None:
        if not helpers and len(waiting) >= MIN_FOR_HELPERS and all(process.poll() is not None for process in _ahead):
            missing = [key for key in waiting if not is_there(f"{symbol_of(key)}.unit")]
            if len(missing) >= MIN_FOR_HELPERS:
                helpers.extend(_helper(entries=[], units=missing) for _ in range(processes() - 1))
        for listener in _listeners:
            listener(done, known)

    try:
        return work(keys, from_end=False, before_compiling=each)
    finally:
        _end(helpers)


def help_with(entries: Sequence[Key], units: Sequence[Key]) -> None:
    """Compile kernels that Python calls, and noinline ones, with all they jump to; the last by name first."""
    products = [_provide(key, entry=True) for key in entries]
    callees = [callee for product in products if product is not None for callee in product.callees]
    work([*units, *callees], from_end=True)


def work(
    keys: Sequence[Key],
    *,
    from_end: bool,
    before_compiling: Callable[[int, int, Sequence[Key]], None] = lambda *_: None,
) -> dict[str, Product]:
    """Compile noinline kernels and all they call, unless they are on disk; returns them by their symbols.

    Parameters
    ----------
    keys
        The kernels.
    from_end
        Whether the last by name are compiled first. Kernels of one module or folder call the same functions, which each process
        compiles once: two that begin at opposite ends of the names compile few twice.
    before_compiling
        Called before each that is not on disk, with the number of those done, of those known, and those that wait.
    """
    known = set(keys)
    waiting = sorted(known)
    products: dict[str, Product] = {}
    while waiting:
        for key in reversed(waiting) if from_end else list(waiting):
            done = len(known) - len(waiting)
            product = _provide(key, entry=False, before_compiling=partial(before_compiling, done, len(known), waiting))
            if product is not None:
                break
        else:  # others are at all of them
            time.sleep(POLL_INTERVAL_S)
            continue
        waiting.remove(key)
        products[symbol_of(key)] = product
        new = set(product.callees) - known
        known |= new
        waiting = sorted([*waiting, *new])
    return products


def _provide(key: Key, *, entry: bool, before_compiling: Callable[[], None] = lambda: None) -> Product | None:
    """A kernel from disk, or compiled: as Python calls it, an `entry`, or as other kernels do.

    While another process is at it, an entry is waited for; a noinline kernel is not, but is None.
    """
    name = f"{symbol_of(key)}.{'entry' if entry else 'unit'}"
    product = load(name)
    if product is not None:
        return product
    before_compiling()
    with locked(name, wait=entry) as free:
        if not free:
            return None
        product = load(name)
        if product is None:
            product = _compiled(key, entry)
            save(name, product)
    return product


def _compiled(key: Key, entry: bool) -> Product:
    """Compile a kernel, as Python calls it or as other kernels do."""
    with signals_deferred():  # one of numba's C modules prints a traceback where a signal ends its import
        from geomphys.jit.compiler import compile_entry, compile_unit
    if (key.module, key.name) not in definitions:
        importlib.import_module(key.module)
    kernel = definitions[key.module, key.name]
    return compile_entry(kernel, key) if entry else compile_unit(kernel, key)


def processes() -> int:
    """How many processes compile at once."""
    return min(available_cores(), MAX_PROCESSES)


def _helper(entries: Sequence[Key], units: Sequence[Key]) -> subprocess.Popen[bytes]:
    """Start a process that compiles too, from the other end; nothing depends on its success."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "geomphys.jit.helper", str(os.getpid())],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.write(json.dumps([entries, units]).encode())
        process.stdin.close()
    return process


def _end(helpers: list[subprocess.Popen[bytes]]) -> None:
    """End processes, and forget them."""
    for helper in helpers:
        helper.kill()
        helper.wait()
    helpers.clear()
