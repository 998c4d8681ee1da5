"""What pyproject.toml declares is imported, and what is imported is declared."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from importlib.metadata import distribution, packages_distributions

import pytest
from packaging.requirements import Requirement

from tests.house.sources import ROOT, imports, modules, tree

BROUGHT_BY_OTHERS = {
    "aiohttp": "errors of fsspec[http]",
    "botocore": "errors of s3fs",
    "llvmlite": "numba names the one version it works with",
    "pydantic-core": "pydantic names the one version it works with",
    "typing-extensions": "pydantic requires it, and before Python 3.12 takes only its TypedDict",
}
"""Distributions that are imported and not declared, and why."""

NOT_IMPORTED = {
    "networkx": "trimesh.repair needs it and does not require it",
    "s3fs": "fsspec imports it for s3:// URLs",
}
"""Distributions that are declared for users and not imported, and why."""

TOOLS = {"pytest-xdist", "mypy", "pytest", "ruff", "moto", "flask", "flask-cors"}
"""Distributions of the extra `test` that run as programs."""


def normalised(requirement: str) -> str:
    """Name of the distribution in a requirement, as PyPI spells it."""
    return re.sub(r"[-_.]+", "-", re.split(r"[^\w.-]", requirement, maxsplit=1)[0]).lower()


def declared() -> dict[str, set[str]]:
    """Distributions of the dependencies (under "") and of each extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    return {extra: {normalised(entry) for entry in entries} for extra, entries in groups.items()}


def imported(*folders: str) -> dict[str, set[str]]:
    """Third-party top-level modules that the sources in these folders import -> distributions that have them."""
    names = {
        name.split(".")[0]
        for folder in folders
        for path in modules(folder).values()
        for name in imports(path, only_types=True)
    }
    foreign = names - sys.stdlib_module_names - {"geomphys", "geomphys_cli", "tests"}
    installed = packages_distributions()
    return {name: {normalised(found) for found in installed.get(name, [name])} for name in foreign}


def test_what_is_imported_is_declared() -> None:
    known = set().union(*declared().values()) | set(BROUGHT_BY_OTHERS)
    missing = {name: found for name, found in imported("geomphys", "cli").items() if not found & known}
    assert not missing


@pytest.mark.parametrize("extra", sorted(declared()))
def test_what_is_declared_is_imported(extra: str) -> None:
    if extra == "test":
        used, exempt = imported("geomphys", "cli", "tests"), TOOLS | set(NOT_IMPORTED)
    elif extra == "fuzz":
        used, exempt = imported("tests"), set()
    else:
        used, exempt = imported("geomphys", "cli"), set(NOT_IMPORTED)
    unused = declared()[extra] - set().union(*used.values()) - exempt
    assert not unused


def test_exceptions_are_needed() -> None:
    everything, used = set().union(*declared().values()), set().union(*imported("geomphys", "cli").values())
    assert set(NOT_IMPORTED) <= everything - used
    assert set(BROUGHT_BY_OTHERS) <= used - everything


def test_the_tested_set_has_hashes_and_what_the_package_asks_for() -> None:
    lines = (ROOT / ".ci" / "tested-py311-linux-x86_64.txt").read_text().splitlines()
    rows = [
        re.fullmatch(r"([a-z0-9-]+)==(\S+) --hash=sha256:[0-9a-f]{64}", line)
        for line in lines
        if not line.startswith("#")
    ]
    assert all(rows)
    tested = {row[1]: row[2] for row in rows if row}
    for text in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]:
        wanted = Requirement(text)
        assert wanted.specifier.contains(tested[re.sub(r"[-_.]+", "-", wanted.name).lower()]), text


PUBLIC_OF_NUMBA = {"numba", "numba.extending", "numba.types"}
"""Modules of numba whose names are public."""

OTHERWISE_UNNAMED = {("geomphys.jit.pack_type", "numba.core.typing.templates")}
"""Module of ours, module of numba's inside: `infer_getattr` accepts a subclass of its `AttributeTemplate` alone."""


def test_of_numba_the_public_modules_are_used() -> None:
    used = {
        (f"geomphys.{name}", node.module if isinstance(node, ast.ImportFrom) else alias.name)
        for name, path in modules("geomphys").items()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
        if (node.module or "" if isinstance(node, ast.ImportFrom) else alias.name).split(".")[0] == "numba"
    }
    assert {pair for pair in used if pair[1] not in PUBLIC_OF_NUMBA} == OTHERWISE_UNNAMED
    assert {name.split(".")[1] for name, _ in used} == {"jit"}


def needed(extra: str) -> set[str]:
    """Distributions that an extra of ours brings with it here, with those that these need in turn."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    waiting = [Requirement(entry) for entry in (*project["dependencies"], *project["optional-dependencies"][extra])]
    seen: set[tuple[str, str]] = set()
    while waiting:
        requirement = waiting.pop()
        name = normalised(requirement.name)
        for wanted in ("", *requirement.extras):
            if (name, wanted) not in seen:
                seen.add((name, wanted))
                further = map(Requirement, distribution(name).requires or ())
                waiting += [f for f in further if f.marker is None or f.marker.evaluate({"extra": wanted})]
    return {name for name, _ in seen}


@pytest.mark.skipif(
    sys.version_info[:2] != (3, 11) or sys.platform != "linux", reason="the lock file is of Python 3.11 on Linux"
)
def test_the_lock_file_has_all_that_the_tests_need_and_nothing_else() -> None:
    lines = (ROOT / ".ci" / "tested-py311-linux-x86_64.txt").read_text().splitlines()
    rows = [line for line in lines if not line.startswith("#")]
    assert {row.partition("==")[0] for row in rows} == needed("test")
