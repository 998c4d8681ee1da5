"""The project's files as the tests of the house see them: sources parsed, never imported."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

NOT_OURS = {".git", ".venv", "out", "build", "dist", "__pycache__", ".pytest_cache", ".mypy_cache", ".ruff_cache"}


def files() -> Iterator[Path]:
    """Every file of the checkout that is neither made nor installed."""
    for path in sorted(ROOT.iterdir()):
        if path.name in NOT_OURS or path.name.endswith(".egg-info") or path.name.startswith(".hypothesis"):
            continue
        if path.is_file():
            yield path
        else:
            yield from (p for p in sorted(path.rglob("*")) if p.is_file() and "__pycache__" not in p.parts)


@functools.cache
def modules(package: str) -> dict[str, Path]:
    """Dotted name inside the package -> file; generated modules are left out, `__init__` stands for its package."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        if path.stem.endswith("_pb2"):
            continue
        parts = path.relative_to(ROOT / package).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def tree(path: Path) -> ast.Module:
    """The syntax tree of a source file."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def imports(path: Path, *, only_types: bool = False) -> set[str]:
    """Absolute names a file imports, wherever in it; those for type checkers alone count only with `only_types`."""
    names: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) and not only_types:
            return
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            assert node.module is not None
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(tree(path))
    return names
