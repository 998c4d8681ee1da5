"""The outlined kernels that have to be compiled before a kernel can run, shared between this process and others.

What each kernel returns is known from its annotation, so kernels do not wait for each other: which are needed is found
when their callers are compiled. Processes share the work without speaking to each other: each locks the kernel it is at,
and finds on disk what others have made.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial

from geomphys.jit.products import CacheEntry, Key, plain_key, symbol_of
from geomphys.jit.slots import Unit, fill_slot, is_loaded, make_slots, units
from geomphys.storage.child_process import available_cores

MOST_PROCESSES = 4
"""More would have little to do; each takes 0.3 GB."""

WORTHWHILE = 6
"""Kernels to be compiled from which on others are called in: a process takes two seconds to get ready."""

LOOK_AGAIN_S = 0.02
"""While others are at all that is left."""

Listener = Callable[[int, int], None]

_listeners: list[Listener] = []


@contextmanager
def telling(listener: Listener | None) -> Iterator[None]:
    """Within the block, `listener` gets how many kernels are compiled, and how many are known to be needed.

    What it raises ends the compiling; what is done by then is kept.
    """
    before = list(_listeners)
    _listeners[:] = before if listener is None else [listener]
    try:
        yield
    finally:
        _listeners[:] = before


@contextmanager
def undisturbed() -> Iterator[None]:
    """Within the block no time is spent on looking for garbage: a fifth of it would be, and there is little."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def complete(keys: Sequence[Key]) -> None:
    """Load outlined kernels and all they jump to; compile those that are not on disk, with helpers if they are many."""
    helpers: list[subprocess.Popen[bytes]] = []

    def each(done: int, known: int, waiting: Sequence[Key]) -> None:
        if not helpers and len(waiting) >= WORTHWHILE:
            missing = [key for key in waiting if CacheEntry(f"{symbol_of(key)}.unit").peek() is None]
            if len(missing) >= WORTHWHILE:
                helpers.extend(_helper(missing) for _ in range(processes() - 1))
        for listener in _listeners:
            listener(done, known)

    try:
        work(keys, load=True, newest_first=False, before_compiling=each)
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


def work(
    keys: Sequence[Key],
    *,
    load: bool,
    newest_first: bool,
    before_compiling: Callable[[int, int, Sequence[Key]], None] = lambda *_: None,
) -> None:
    """See to it that outlined kernels and all they jump to are on disk.

    Parameters
    ----------
    keys
        The kernels.
    load
        Whether they are needed in this process too.
    newest_first
        The order: processes that begin at different ends meet late.
    before_compiling
        Called before each that is not on disk, with the number of those done, of those known, and those that wait.
    """
    waiting, known, locked = deque(keys), set(keys), 0
    while waiting:
        key = waiting.pop() if newest_first else waiting.popleft()
        done = len(known) - len(waiting) - 1
        needs = _provide(key, load, partial(before_compiling, done, len(known), waiting))
        if needs is None:  # someone else is at it
            waiting.appendleft(key) if newest_first else waiting.append(key)
            locked += 1
            if locked >= len(waiting):
                time.sleep(LOOK_AGAIN_S)
                locked = 0
            continue
        locked = 0
        waiting.extend(need for need in needs if need not in known)
        known.update(needs)


def _provide(key: Key, load: bool, before_compiling: Callable[[], None]) -> list[Key] | None:
    """Compile an outlined kernel or, to `load` it, take it from disk. Returns those it jumps to; None if it is locked."""
    make_slots([key])
    unit, stored = _unit(key), CacheEntry(f"{symbol_of(key)}.unit")
    if is_loaded(key):
        return unit.loaded[key][1]
    if not load and (product := stored.peek()) is not None:
        return product.callees()
    if not stored.is_there():
        before_compiling()
    with stored.locked(wait=False) as free:
        if not free:
            return None
        product = stored.find()
        needs = [] if product is None else product.callees()
        make_slots(needs)
        compiled = unit.make(key, stored)
        if not compiled.cache_hits:
            needs = unit.needs()
            stored.save(needs)
    unit.loaded[key] = compiled, needs
    fill_slot(key, compiled.address)
    return needs


def _unit(key: Key) -> Unit:
    """The kernel of a key."""
    if (key.module, key.name) not in units:
        importlib.import_module(key.module)
    return units[key.module, key.name]


def processes() -> int:
    """How many processes compile at once."""
    return min(available_cores(), MOST_PROCESSES)


def _helper(keys: Sequence[Key]) -> subprocess.Popen[bytes]:
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
        process.stdin.write(json.dumps([plain_key(key) for key in keys]).encode())
        process.stdin.close()
    return process
