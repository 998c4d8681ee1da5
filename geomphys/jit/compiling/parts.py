"""Code for LLVM: a kernel as a part of others, and parts put together to a unit of machine code.

numba compiles each kernel to machine code of its own, with all it calls inside, and again with each kernel that calls
it. Here a kernel is only brought into the compiler's language. A unit is put together from a kernel and all it calls,
is optimised as a whole, and translated once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import llvmlite.binding as llvm
from numba.core import compiler
from numba.core.codegen import JITCodeLibrary
from numba.core.funcdesc import FunctionDescriptor
from numba.core.runtime import rtsys

from geomphys.jit.compiling.keys import Key, symbol_of

UNUSED = {
    "FindLiterallyCalls",
    "InlineClosureLikes",
    "InlineInlinables",
    "InlineOverloads",
    "LiteralPropagationSubPipelinePass",
    "LiteralUnroll",
    "MakeFunctionToJitFunction",
    "NopythonRewrites",
    "RewriteDynamicRaises",
    "WithLifting",
}
"""Passes of numba for closures, literal arguments, array expressions, exceptions and the like: kernels have none."""


@dataclass(frozen=True, eq=False)
class Part:
    """A kernel in the language of LLVM, to be put together with what it calls."""

    key: Key
    parts: tuple[Key, ...]  # kernels compiled into it
    units: tuple[Key, ...]  # kernels it jumps to
    bitcode: bytes


class _Description(FunctionDescriptor):  # type: ignore[misc]  # numba is untyped
    __slots__ = ()

    @property
    def llvm_cpython_wrapper_name(self) -> str:
        """Name of the function Python calls."""
        return f"python.{self.mangled_name}"


def describe(key: Key, returns: Any, arguments: tuple[str, ...], inline: bool = False) -> Any:
    """What callers have to know of a kernel."""
    symbol = symbol_of(key)
    return _Description(
        native=True,
        modname=key.module,
        qualname=key.name,
        unique_name=symbol,
        doc="",
        typemap=None,
        restype=returns,
        calltypes=None,
        args=arguments,
        kws=(),
        mangler=lambda *_, **__: symbol,
        argtypes=key.types,
        inline=inline,
        env_name=f"{symbol}.environment",
    )


class _Sketch(JITCodeLibrary):  # type: ignore[misc]  # numba is untyped
    """Takes the code numba makes of one kernel, and does nothing with it yet."""

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self.enable_object_caching()

    def add_llvm_module(self, module: Any) -> None:
        """Take a module."""
        self._final_module.link_in(module)

    def bitcode(self, symbol: str, own_name: str) -> bytes:
        """The code of the kernel with the helpers of numba it needs, under its name for all processes."""
        module = self._final_module
        for library in dict.fromkeys(self._linking_libraries):
            if library is not rtsys.library:  # memory management, which kernels have no use for
                module.link_in(library._get_module_for_linking(), preserve=True)
        module.get_function(own_name).name = symbol
        for value in (*module.functions, *module.global_variables):
            if not value.is_declaration and value.name != symbol:
                value.linkage = "internal"
        _simplify(self.codegen, module)
        code: bytes = module.as_bitcode()
        return code


class _Pipeline(compiler.CompilerBase):  # type: ignore[misc]  # numba is untyped
    """numba's way from a function to LLVM, without what kernels have no use for: half of its passes, a sixth of its time."""

    def define_pipelines(self) -> list[Any]:
        """Tell numba the passes."""
        usual = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes = compiler.PassManager("kernel")
        for one, description in usual.passes:
            if one.__name__ not in UNUSED:
                passes.add_pass(one, description)
        passes.finalize()
        return [passes]


def sketch(key: Key, function: Any, flags: Any, target: Any) -> tuple[Any, bytes]:
    """Bring a kernel into the language of LLVM: what it returns, and its code.

    `target` is numba's descriptor of the machine. Raises numba's errors.
    """
    codegen = target.target_context.codegen()
    library = _Sketch(codegen, key.name)
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    done = compiler.compile_extra(
        target.typing_context, target.target_context, function, key.types, None, flags, {}, library=library,
        pipeline_class=_Pipeline,
    )  # fmt: skip
    return done.signature.return_type, library.bitcode(symbol_of(key), done.fndesc.llvm_func_name)


def assemble(parts: Iterable[Part], exported: str, codegen: Any, wrapper: Any = None) -> bytes:
    """Put parts together, keep only what the symbol `exported` needs, and translate it to an object file.

    `wrapper` is a module that is added.
    """
    module = llvm.parse_assembly(str(codegen._create_empty_module(exported)))
    if wrapper is not None:
        module.link_in(wrapper)
    for part in parts:
        module.link_in(llvm.parse_bitcode(part.bitcode))
    for function in module.functions:
        if not function.is_declaration and function.name != exported:
            function.linkage = "internal"
    module.data_layout = codegen._data_layout
    passes, builder = codegen._module_pass_manager()
    passes.run(module, builder)
    code: bytes = codegen._tm.emit_object(module)
    return code


def wrap(description: Any, environment: Any, flags: Any, target: Any) -> Any:
    """What Python calls a kernel through, as a module of LLVM."""
    context = compiler._make_subtarget(target.target_context, flags)
    context = context.subtarget(environment=environment, fndesc=description)
    library = _Sketch(context.codegen(), description.qualname)
    context.create_cpython_wrapper(library, description, environment, None)
    return library._final_module


def _simplify(codegen: Any, module: Any) -> None:
    """Tidy up each function by itself, once for all units it will be part of."""
    module.data_layout = codegen._data_layout
    passes, builder = codegen._function_pass_manager()
    for function in module.functions:
        if not function.is_declaration:
            passes.run(function, builder)
