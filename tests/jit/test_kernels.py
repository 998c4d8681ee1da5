"""What holds for every kernel of the package."""

from __future__ import annotations

import ast

from numba import types

import geomphys.engine.step  # noqa: F401 - brings in all kernels of a frame
from geomphys.jit import compiler
from geomphys.jit.compiler import OPTIONS, compile_entry, compile_unit
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.registry import definitions
from geomphys.jit.returns import declared_return
from tests.house.sources import modules, tree

PUBLIC = ("numba", "numba.extending", "llvmlite", "llvmlite.ir", "llvmlite.binding")
DOCUMENTED = {"numba.core": {"cgutils"}, "numba.core.typing.templates": {"AttributeTemplate"}}
"""Of numba's core, what its manual's chapter on the low-level extension interface uses."""


def test_only_the_public_interface_of_numba_is_used() -> None:
    for name, path in modules("geomphys").items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in ("numba", "llvmlite"):
                names = {alias.name for alias in node.names}
                assert node.module in PUBLIC or names <= DOCUMENTED.get(str(node.module), set()), f"{name}: {names}"


def test_results_do_not_depend_on_the_machine() -> None:
    assert "fastmath" not in OPTIONS
    assert "parallel" not in OPTIONS


def test_every_outlined_kernel_says_what_it_returns() -> None:
    outlined = [definition for definition in definitions.values() if definition.noinline]
    assert len(outlined) > 30
    for definition in outlined:
        declared_return(definition.py_func)


@kernel
def _scaled(x: float, factor: int) -> float:
    return x * factor


@noinline
def _at_the_bottom(x: float) -> float:
    return _scaled(x, 3)


@kernel
def _of_all_callers(x: float, factor: int) -> float:
    return _scaled(x, 1) + _scaled(x, factor=2) + _scaled(x, factor) + _at_the_bottom(x)


def test_a_kernel_is_compiled_into_its_callers_once_for_the_types_of_its_arguments() -> None:
    """Not again for constants, for arguments by name, or inside a function of other options."""
    scaled, bottom, top = (definitions[__name__, name] for name in ("_scaled", "_at_the_bottom", "_of_all_callers"))
    compile_entry(top, top.key(("float64", "int64")))
    compile_unit(bottom, bottom.key(("float64",)))
    assert compiler._inside[scaled].signatures == [(types.float64, types.int64)]
