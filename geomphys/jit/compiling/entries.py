"""Kernels as Python sees them: the way in, and everything that is loaded for it."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import _dynfunc
from numba.core import compiler, sigutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import Environment

from geomphys.jit.compiling.crew import compile_all
from geomphys.jit.compiling.keys import symbol_of
from geomphys.jit.compiling.parts import assemble, wrap
from geomphys.jit.compiling.sketches import Callee, Sketched, closure
from geomphys.jit.compiling.units import Unit, load_objects, unit_name


class Entry(NamedTuple):
    """A kernel that Python can call, as an object file."""

    code: bytes
    constants: list[Any]  # objects of Python its wrapper uses
    units: list[str]  # symbols of all units that have to be loaded with it


class Kernel(Sketched):
    """A function that is compiled when it is first called."""

    def compile(self, sig: Any) -> Any:
        """Make this kernel callable with arguments of these types."""
        kinds = tuple(sigutils.normalize_signature(sig)[0])
        if kinds not in self.overloads:
            with global_compiler_lock:
                self._enter(kinds, *(self._find(kinds) or self._find_or_make(kinds)))
        return self.overloads[kinds].entry_point

    def _find(self, kinds: tuple[Any, ...]) -> tuple[Entry, dict[str, bytes]] | None:
        """The entry and its units as they are in the store; None if anything is missing."""
        entry: Entry | None = self.store.load(self._entry_name(kinds))
        if entry is None:
            return None
        units: dict[str, Unit | None] = {symbol: self.store.load(unit_name(symbol)) for symbol in entry.units}
        objects = {symbol: unit.code for symbol, unit in units.items() if unit is not None}
        return (entry, objects) if len(objects) == len(units) else None

    def _find_or_make(self, kinds: tuple[Any, ...]) -> tuple[Entry, dict[str, bytes]]:
        """Compile, unless another process has done so meanwhile."""
        with self.store.alone():
            return self._find(kinds) or self._make(kinds)

    def _make(self, kinds: tuple[Any, ...]) -> tuple[Entry, dict[str, bytes]]:
        """Compile the entry and all units it needs."""
        self.targetctx.refresh()  # slow, and not needed to load what is compiled
        units = compile_all(self.key(kinds))
        parts = [] if self.outlined else closure(self.part(kinds))[0]
        description = self.describe(kinds)
        environment = Environment.from_fndesc(description)
        wrapper = wrap(description, environment, self.flags(), self.targetdescr)
        code = assemble(parts, description.llvm_cpython_wrapper_name, self.targetctx.codegen(), wrapper)
        entry = Entry(code, list(environment.consts), list(units))
        self.store.save(self._entry_name(kinds), entry)
        return entry, {symbol: unit.code for symbol, unit in units.items()}

    def _entry_name(self, kinds: tuple[Any, ...]) -> str:
        return f"{symbol_of(self.key(kinds))}.entry"

    def _enter(self, kinds: tuple[Any, ...], entry: Entry, objects: dict[str, bytes]) -> None:
        """Load the machine code, and let Python call it."""
        codegen, description = self.targetctx.codegen(), self.describe(kinds)
        name = description.llvm_cpython_wrapper_name
        load_objects(codegen, objects | {name: entry.code})
        environment = Environment.from_fndesc(description)
        environment.consts[:] = entry.constants
        codegen.set_env(description.env_name, environment)
        address = codegen._engine.get_function_address(name)
        module = description.lookup_module()
        function = _dynfunc.make_function(module, self.name, self.__doc__ or "", address, environment, ())
        self.add_overload(
            compiler.compile_result(
                typing_context=self.typingctx,
                target_context=self.targetctx,
                entry_point=function,
                signature=Callee(self.key(kinds), description).signature,
                objectmode=False,
                fndesc=description,
                environment=environment,
            )
        )
