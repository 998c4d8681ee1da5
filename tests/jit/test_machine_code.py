"""Object files from LLVM's text: of one function each, which needs nothing of numba or Python."""

from __future__ import annotations

import ctypes
import math

import numba
import numpy as np
import pytest

from geomphys.jit.machine_code import link, object_file

TEXT = """
declare void @numba_gil_ensure(ptr)
declare double @sin(double)

define linkonce_odr i64 @helper(i64 %x) {{
  %y = mul i64 %x, 3
  ret i64 %y
}}

define i64 @function(i64 %x) {{
entry:
  %wrong = icmp slt i64 %x, 0
  br i1 %wrong, label %{name}, label %{name}.more
{name}:
  call void @numba_gil_ensure(ptr null)
  ret i64 0
{name}.more:
  %y = call i64 @helper(i64 %x)
  ret i64 %y
}}
"""


@pytest.mark.parametrize("length", [10, 1022, 1030, 5000])
def test_a_text_with_long_names_becomes_a_function(length: int) -> None:
    """LLVM itself cuts names at 1,024 characters, by which the two blocks would be one."""
    code, callees = object_file(TEXT.format(name="b" * length), "function", f"tests.long.{length}")
    assert callees == []
    (address,) = link({f"tests.long.{length}": code}).values()
    assert ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(address)(14) == 42


def test_two_functions_of_one_name_stay_apart() -> None:
    texts = [TEXT.format(name="b"), TEXT.format(name="b").replace("%x, 3", "%x, 5")]
    codes = {f"tests.apart.{k}": object_file(text, "function", f"tests.apart.{k}")[0] for k, text in enumerate(texts)}
    called = [ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(address)(2) for address in link(codes).values()]
    assert called == [6, 10]


def test_functions_of_the_c_library_are_found() -> None:
    compiled = numba.cfunc("float64(float64)")(lambda x: math.sin(x))
    code, _ = object_file(compiled.inspect_llvm(), compiled.native_name, "tests.sine")
    (address,) = link({"tests.sine": code}).values()
    assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(address)(0.5) == math.sin(0.5)


def test_what_allocates_is_refused() -> None:
    compiled = numba.cfunc("float64(int64)")(lambda n: np.zeros(n).sum())
    with pytest.raises(TypeError, match=r"tests\.zeros calls NRT_"):
        object_file(compiled.inspect_llvm(), compiled.native_name, "tests.zeros")


def test_what_is_nowhere_is_refused() -> None:
    """LLVM's linker would end the process."""
    with pytest.raises(TypeError, match="calls nowhere"):
        object_file("declare void @nowhere()\ndefine void @f() {\n call void @nowhere()\n ret void\n}", "f", "tests.f")
