"""What holds for every kernel of the package."""

from __future__ import annotations

import ast

import geomphys.engine.step  # noqa: F401 - brings in all kernels of a frame
from geomphys.jit.compiler import OPTIONS
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
    noinline = [kernel for kernel in definitions.values() if kernel.noinline]
    assert len(noinline) > 30
    for kernel in noinline:
        declared_return(kernel.py_func)
