"""No number of a column carries a meaning: what has parts is a record with names, but for vectors, poses and matrices.

Arrays of numbers have vectors (3), quaternions and planes (4), twists and wrenches (6), poses (7), rotations (9) or frames
(12) as rows; anything else is a structured type or a named tuple of arrays.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.house.sources import modules, tree

ROWS = {3, 4, 6, 7, 9, 12}
"""Lengths of rows that need no names."""
FIELD = re.compile(r"^    (\w+): (?:Floats|Ints|NDArray\[np\.\w+\])  # \(([^()]*)\)")
"""Name and shape of an array in a record."""
OF_FIXED_LAYOUT = {"poses", "frames"}
"""Arrays that kernels read by numbers: x y z and a quaternion; a rotation and x y z."""
KERNELS = {"kernel", "noinline", "inlined"}


def widths(source: str) -> Iterator[tuple[str, int]]:
    """The arrays declared in records, and their last dimension where that is a number and not the only one."""
    for line in source.splitlines():
        if found := FIELD.match(line):
            dimensions = [part.strip() for part in found[2].split(",") if part.strip()]
            if len(dimensions) > 1 and dimensions[-1].isdigit():
                yield found[1], int(dimensions[-1])


def is_number(node: ast.expr | None, least: int) -> bool:
    """Whether an index is a literal of at least `least`, or such a literal plus something."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        node = node.left
    return isinstance(node, ast.Constant) and isinstance(node.value, int) and node.value >= least


def name_of(node: ast.expr) -> str:
    """The last name of `a`, `x.a` or `x.a[i]`."""
    while isinstance(node, ast.Subscript):
        node = node.value
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def is_kernel(node: ast.AST) -> bool:
    """Whether a definition is compiled."""
    return isinstance(node, ast.FunctionDef) and any(name_of(d) in KERNELS for d in node.decorator_list)


def rows_of(function: ast.AST) -> dict[str, str]:
    """Variables of a function that are elements of arrays, such as rows: name -> name of the array."""
    found = {}
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = (
                    zip(target.elts, node.value.elts, strict=False)
                    if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                    else [(target, node.value)]
                )
                for variable, value in pairs:
                    if isinstance(variable, ast.Name) and isinstance(value, ast.Subscript):
                        found[variable.id] = name_of(value)
    return found


def numbered_in_kernels(module: ast.Module) -> Iterator[str]:
    """Elements of rows from the fourth on that kernels take by number."""
    for function in filter(is_kernel, ast.walk(module)):
        rows = rows_of(function)
        for node in ast.walk(function):
            if not isinstance(node, ast.Subscript) or name_of(node.value) in OF_FIXED_LAYOUT:
                continue
            if isinstance(node.slice, ast.Tuple):
                found = is_number(node.slice.elts[-1], 3)
            else:
                of = rows.get(node.value.id, "") if isinstance(node.value, ast.Name) else name_of(node.value)
                is_row = isinstance(node.value, ast.Subscript) or (isinstance(node.value, ast.Name) and of)
                found = bool(is_row) and of not in OF_FIXED_LAYOUT and is_number(node.slice, 3)
            if found:
                yield f"line {node.lineno}: {ast.unparse(node)}"


def numbered_columns(module: ast.Module) -> Iterator[str]:
    """Columns from the fifth on taken by number, and blocks of columns other than the halves of a twist."""
    for node in ast.walk(module):
        if not isinstance(node, ast.Subscript) or not isinstance(node.slice, ast.Tuple):
            continue
        last = node.slice.elts[-1]
        if isinstance(last, ast.Slice):
            ends = [end.value if isinstance(end, ast.Constant) else None for end in (last.lower, last.upper)]
            found = isinstance(ends[0], int) and isinstance(ends[1], int) and ends[0] > 0 and ends != [3, 6]
        else:
            found = is_number(last, 4) and name_of(node.value) not in OF_FIXED_LAYOUT
        if found:
            yield f"line {node.lineno}: {ast.unparse(node)}"


BY_NUMBER = {"numerics.row_vectors", "scene.kinematics"}
"""Modules that read and write the rows of fixed layout for all others."""


@pytest.mark.parametrize(("name", "path"), [item for item in modules("geomphys").items() if item[0] not in BY_NUMBER])
def test_columns_have_names(name: str, path: Path) -> None:
    numbered = [*numbered_in_kernels(tree(path)), *numbered_columns(tree(path))]
    assert not numbered, (
        f"geomphys.{name}: columns by number; make it a record with names (CONTRIBUTING.md): {numbered}"
    )
    wide = [f"{field} (…, {width})" for field, width in widths(path.read_text("utf-8")) if width not in ROWS]
    assert not wide, f"geomphys.{name}: rows that are no vectors, poses or matrices: {wide}"


@pytest.mark.parametrize(
    "source",
    [
        "@kernel\ndef f(work, i):\n    return work.spots[i, 3]",
        "@kernel\ndef f(values, i, k):\n    values[i, 3 + k] = 0.0",
        "@noinline\ndef f(work, i):\n    row, n = work.spots[i], 0\n    return row[6]",
        "@kernel\ndef f(work, i, k):\n    return work.boxes[i][3 + k]",
        "values[:, 6]",
        "values[..., 1:4]",
        "class A(NamedTuple):\n    pairs: Ints  # (n, 2) tip and body",
        "class A(NamedTuple):\n    motion: Floats  # (n, 5) speeds and jerks",
    ],
)
def test_a_numbered_column_is_refused(source: str) -> None:
    module = ast.parse(source)
    wide = [width for _, width in widths(source) if width not in ROWS]
    assert [*numbered_in_kernels(module), *numbered_columns(module), *wide]


@pytest.mark.parametrize(
    "source",
    [
        "@kernel\ndef f(poses, b):\n    return (poses[b, 3], poses[b, 6])",
        "@kernel\ndef f(scene, i):\n    r = rotation_of(scene, i)\n    return r[8]",
        "@kernel\ndef f(h, first, k):\n    h[first + 3 + k, first] = 0.0",
        "poses[:, 3:] @ matrix[:3, 3] + planes[:, 3] + twists[:, 3:6]",
        "class A(NamedTuple):\n    poses: Floats  # (B, 7)\n    unit: Floats  # (3,)\n    sums: Floats  # (N, S + 1)",
    ],
)
def test_vectors_poses_and_matrices_are_not(source: str) -> None:
    module = ast.parse(source)
    wide = [width for _, width in widths(source) if width not in ROWS]
    assert not [*numbered_in_kernels(module), *numbered_columns(module), *wide]
