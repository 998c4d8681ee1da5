"""Data flows one way: who may import whom, how long a module may be, what has a docstring."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.house.sources import imports, modules, tree

LAYERS = (
    "errors version",
    "config results",
    "storage",
    "jit",
    "numerics",
    "scene",
    "collision",
    "keypoints",
    "recording",
    "load",
    "driven simulated",
    "engine",
    "output",
    "replays",
    "analysis authoring batch bench viewer",
)
"""Top to bottom: a module imports from layers above its own and from its own folder, never from below or beside."""


def layer(module: str) -> int:
    """Rank of a module's layer. Raises KeyError where none is named: every module belongs to one."""
    ranks = {name: rank for rank, names in enumerate(LAYERS) for name in names.split()}
    return ranks[module.split(".")[0]]


def internal_imports(module: str, path: Path) -> Iterator[str]:
    """Modules of geomphys that a module imports, for types alone too; "" is the package's public face."""
    known = modules("geomphys")
    for name in imports(path, only_types=True):
        inside = name.removeprefix("geomphys").removeprefix(".")
        if name.split(".")[0] == "geomphys" and inside in known and inside != module:
            yield inside


@pytest.mark.parametrize("module", [name for name in modules("geomphys") if name])
def test_imports_only_from_above(module: str) -> None:
    for imported in internal_imports(module, modules("geomphys")[module]):
        assert imported or module == "__main__", f"geomphys/{module} imports the public face, which is made of it"
        same_folder = imported.split(".")[0] == module.split(".")[0]
        assert same_folder or layer(imported) < layer(module), (
            f"geomphys/{module} imports {imported}, which does not stand above it"
        )


def test_no_module_imports_itself_by_way_of_others() -> None:
    graph = {name: set(internal_imports(name, path)) for name, path in modules("geomphys").items() if name}
    TopologicalSorter(graph).prepare()  # raises CycleError


@pytest.mark.parametrize(("one", "other"), [("driven", "simulated"), ("simulated", "driven")])
def test_the_two_loops_do_not_know_each_other(one: str, other: str) -> None:
    for name, path in modules("geomphys").items():
        if name.split(".")[0] == one:
            bad = {imported for imported in imports(path, only_types=True) if imported.startswith(f"geomphys.{other}")}
            assert not bad, f"geomphys/{name} imports {bad}"


@pytest.mark.parametrize(
    ("package", "foreign"),
    [("geomphys", {"click", "rich", "geomphys_cli", "cli"}), ("cli", {"numpy", "numba", "rerun", "trimesh"})],
)
def test_the_library_knows_no_terminal_and_the_command_line_no_arrays(package: str, foreign: set[str]) -> None:
    for path in modules(package).values():
        bad = {name for name in imports(path, only_types=True) if name.split(".")[0] in foreign}
        assert not bad, f"{path} imports {bad}"


def test_the_library_prints_nothing() -> None:
    for name, path in modules("geomphys").items():
        calls = [node for node in ast.walk(tree(path)) if isinstance(node, ast.Call)]
        printing = [node.lineno for node in calls if isinstance(node.func, ast.Name) and node.func.id == "print"]
        script = any(isinstance(node, ast.If) and "__main__" in ast.unparse(node.test) for node in tree(path).body)
        assert not printing or script, f"geomphys/{name} prints in lines {printing}"


@pytest.mark.parametrize("package", ["geomphys", "cli"])
def test_modules_are_short(package: str) -> None:
    long = {str(path): n for path in modules(package).values() if (n := len(path.read_text().splitlines())) > 400}
    assert not long


@pytest.mark.parametrize("package", ["geomphys", "cli"])
def test_what_is_public_is_documented(package: str) -> None:
    bare = [
        f"{path}:{node.lineno} {node.name}"
        for path in modules(package).values()
        for node in public_definitions(tree(path))
        if ast.get_docstring(node) is None
    ]
    undocumented = [str(path) for path in modules(package).values() if not is_documented(tree(path))]
    assert not bare
    assert not undocumented


def is_documented(module: ast.Module) -> bool:
    """Whether a module says what it is; an empty one need not."""
    return not module.body or ast.get_docstring(module) is not None


def public_definitions(
    node: ast.Module | ast.ClassDef,
) -> Iterator[ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef]:
    """Public functions and classes of a module, and the public methods of these classes."""
    for child in node.body:
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not child.name.startswith("_"):
            yield child
            if isinstance(child, ast.ClassDef):
                yield from public_definitions(child)


@pytest.mark.parametrize("package", ["geomphys", "cli"])
def test_no_error_is_swallowed(package: str) -> None:
    for path in modules(package).values():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ExceptHandler):
                caught = "" if node.type is None else ast.unparse(node.type)
                broad = caught in {"", "Exception", "BaseException"}
                passed_on = any(isinstance(inner, ast.Raise) for inner in ast.walk(node))
                assert not broad or passed_on, f"{path}:{node.lineno} catches everything and goes on"
