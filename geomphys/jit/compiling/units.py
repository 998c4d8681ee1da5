"""Units of machine code: made, kept, and loaded."""

from __future__ import annotations

import pickle
from typing import Any, NamedTuple

from llvmlite.binding.object_file import ObjectFileRef
from numba.core.compiler_lock import global_compiler_lock

from geomphys.jit.compiling.keys import Key, symbol_of
from geomphys.jit.compiling.parts import assemble
from geomphys.jit.compiling.sketches import closure, kernel_of

_loaded: dict[str, Any] = {}


class Unit(NamedTuple):
    """An outlined kernel as an object file."""

    code: bytes
    needs: bytes  # keys of the units it jumps to, pickled: they are seldom asked for

    def callees(self) -> list[Key]:
        """Keys of the units it jumps to."""
        keys: list[Key] = pickle.loads(self.needs)
        return keys


def unit_name(symbol: str) -> str:
    """Name of a unit in the store."""
    return f"{symbol}.unit"


def find_unit(key: Key) -> Unit | None:
    """An outlined kernel from the store, or None."""
    unit: Unit | None = kernel_of(key).store.load(unit_name(symbol_of(key)))
    return unit


def make_unit(key: Key) -> Unit:
    """Compile an outlined kernel, but not those it jumps to, and store it."""
    kernel, symbol = kernel_of(key), symbol_of(key)
    with global_compiler_lock:
        parts, needs = closure(kernel.part(key.types))
        unit = Unit(assemble(parts, symbol, kernel.targetctx.codegen()), pickle.dumps(needs))
    kernel.store.save(unit_name(symbol), unit)
    return unit


def load_objects(codegen: Any, objects: dict[str, bytes]) -> None:
    """Load object files into this process, each once; they may refer to each other."""
    for name, code in objects.items():
        if name not in _loaded:
            _loaded[name] = ObjectFileRef.from_data(code)  # kept: the code lives as long as the process
            codegen._engine._ee.add_object_file(_loaded[name])
    codegen._engine.finalize_object()
