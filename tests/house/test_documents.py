"""README, ARCHITECTURE and CHANGELOG say what is there."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from geomphys.output.summary import FLAG_NAMES
from geomphys.scene.scene_file import parse_scene
from geomphys.version import __version__
from tests.house import inputs, output_reference
from tests.house.listing import DOCUMENT, LIST, listing
from tests.house.reference import REFERENCE, reference
from tests.house.sources import ROOT, files, modules, tree
from tests.house.test_help import parses
from tests.house.test_layout import LAYERS

DOCS = ROOT / "assets" / "docs"
TEXTS = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.glob("*.md"))]


def code_lines(text: str) -> list[str]:
    """Lines of the shell blocks of a document, continued lines joined."""
    blocks = re.findall(r"```(?:sh|bash|console|shell)\n(.*?)```", text, flags=re.DOTALL)
    return [line.strip().removeprefix("$ ") for block in blocks for line in block.replace("\\\n", " ").splitlines()]


def quoted_paths(text: str) -> set[str]:
    """What stands in backquotes and looks like a path of the checkout."""
    quoted = re.findall(r"`([^`\s]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    tops = {path.name for path in ROOT.iterdir()}
    return {q.split(":")[0] for q in quoted if q.split("/")[0] in tops and not q.startswith("out/")}


def quoted_definitions(text: str) -> set[tuple[str, str]]:
    """Path and name of what stands in backquotes as ``path.py:name``."""
    return set(re.findall(r"`([\w/.]+\.py):([\w.]+)`", text))


def definitions(path: Path) -> set[str]:
    """Functions, classes, ``Class.member``s and constants of a module."""
    found: set[str] = set()
    waiting: list[tuple[str, ast.AST]] = [("", node) for node in tree(path).body]
    while waiting:
        owner, node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(owner + node.name)
            waiting += [(f"{owner}{node.name}.", inner) for inner in node.body if isinstance(node, ast.ClassDef)]
        for target in node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]:
            if isinstance(target, ast.Name):
                found.add(owner + target.id)
    return found


def homes(name: str) -> list[str]:
    """Modules that define a name."""
    found = [path for package in ("geomphys", "cli") for path in modules(package).values() if name in definitions(path)]
    return [path.relative_to(ROOT).as_posix() for path in found]


def test_the_page_of_modules_lists_every_one_as_it_describes_itself() -> None:
    found = LIST.search(DOCUMENT.read_text())
    assert found is not None
    assert found.group() == listing(), "run: python tests/house/listing.py"


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_paths_and_links_of_the_documents_exist(path) -> None:
    text = path.read_text()
    links = [link for link in re.findall(r"\]\(([^)#\s]+)\)", text) if not link.startswith(("http://", "https://"))]
    missing = [link for link in links if not (path.parent / link).exists()]
    missing += [quoted for quoted in quoted_paths(text) if not any(ROOT.glob(quoted.rstrip("/")))]
    assert not missing


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_functions_named_in_the_documents_are_there(path) -> None:
    missing = [
        f"{where}:{name} - {'now in ' + ', '.join(found) if (found := homes(name)) else 'nowhere'}"
        for where, name in sorted(quoted_definitions(path.read_text()))
        if not (ROOT / where).is_file() or name not in definitions(ROOT / where)
    ]
    assert not missing, "\n".join(missing)


def test_the_story_names_functions_and_a_missing_one_would_be_noticed() -> None:
    assert len(quoted_definitions((ROOT / "ARCHITECTURE.md").read_text())) > 50
    assert "separation" in definitions(ROOT / "geomphys/collision/penetration.py")
    assert "Config.gap" in definitions(ROOT / "geomphys/config.py")
    assert not {"separations", "gap"} & definitions(ROOT / "geomphys/config.py")


@pytest.mark.parametrize("equation", range(1, 11))
def test_an_equation_of_the_paper_is_found_where_the_table_says(equation: int) -> None:
    """The first row of the table that names it names a module in which it is written out or quoted by its number."""
    table = (ROOT / "ARCHITECTURE.md").read_text().split("## Where is", 1)[1].split("\n## ", 1)[0]
    rows = [cells for line in table.splitlines() if len(cells := line.split("|")) > 2 and f"({equation})" in cells[1]]
    (path, *_) = re.findall(r"`(geomphys/[\w/]+\.py)", rows[0][2])
    text = (ROOT / path).read_text()
    ranges = [range(int(a), int(b) + 1) for a, b in re.findall(r"\((\d+)\)–\((\d+)\)", text)]
    assert f"({equation})" in text or any(equation in numbers for numbers in ranges)


def test_the_layers_of_the_document_are_those_of_the_code() -> None:
    (diagram,) = re.findall(r"## Layers\n.*?```text\n(.*?)```", (ROOT / "ARCHITECTURE.md").read_text(), flags=re.DOTALL)
    assert [" ".join(line.split("|")[0].split()) for line in diagram.splitlines()] == list(LAYERS)


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_commands_of_the_documents_are_valid(path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    for line in code_lines(path.read_text()):
        words = shlex.split(line, comments=True)
        stop = next((i for i, word in enumerate(words) if word in {">", ">>", "|", "&&", "&", ";"}), len(words))
        if words and words[0].split("/")[-1] == "geomphys":
            parses(words[1:stop])
        elif words and words[0] == "make":
            assert {word for word in words[1:stop] if "=" not in word} <= targets, line


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_paths_in_commands_of_the_documents_exist(path) -> None:
    tops = ("recordings/", "assets/")
    named = {word for line in code_lines(path.read_text()) for word in shlex.split(line, comments=True)}
    inside = [word for word in named if word.startswith(tops) and len(word) > len("recordings/")]
    assert not [word for word in inside if not any(ROOT.glob(word))]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.name)
def test_scenes_in_the_documents_are_valid(path) -> None:
    for text in re.findall(r"```toml\n(.*?)```", path.read_text(), flags=re.DOTALL):
        if "[[" in text:
            parse_scene(text, path)


def test_the_table_of_inputs_is_that_of_the_code() -> None:
    text = inputs.DOCUMENT.read_text()
    assert inputs.TABLE.search(text) is not None
    assert inputs.with_table(text) == text, "run: python tests/house/inputs.py"


def test_the_reference_of_outputs_is_fresh() -> None:
    assert output_reference.PAGE.read_text() == output_reference.page(), "run: python tests/house/output_reference.py"


def test_every_flag_has_a_meaning_in_the_reference() -> None:
    meanings = re.findall(r"^\| (\d+) \| `\w+` \| (.*) \|$", output_reference.flags(), flags=re.MULTILINE)
    assert [int(bit) for bit, meaning in meanings if meaning] == sorted(FLAG_NAMES)


def test_the_reference_of_the_command_line_is_fresh() -> None:
    assert REFERENCE.read_text() == reference(), "run: python tests/house/reference.py"


def test_every_page_is_linked_from_the_readme_and_every_picture_is_shown() -> None:
    readme = (ROOT / "README.md").read_text()
    assert not [page.name for page in DOCS.glob("*.md") if f"(assets/docs/{page.name})" not in readme]
    shown = "".join(path.read_text() for path in TEXTS)
    assert not [p.name for p in (DOCS / "pictures").iterdir() if f"pictures/{p.name})" not in shown]


def test_every_picture_is_drawn_by_make_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "assets"))
    experiments = import_module("figure_scenes").EXPERIMENTS
    drawn = {f"{e.name}_{shot.frame}.png" for e in experiments for shot in e.shots}
    drawn |= {f"{e.name}_times.png" for e in experiments} | {"hand_mug.gif"}
    drawn |= {f"{grip.name}_held.png" for grip in import_module("grip_figures").GRIP_FIGURES}
    assert {path.name for path in (DOCS / "pictures").iterdir()} == drawn


def test_pictures_are_small() -> None:
    sizes = {path.name: path.stat().st_size for path in (DOCS / "pictures").iterdir()}
    assert max(size for name, size in sizes.items() if not name.endswith(".gif")) < 150_000
    assert sum(sizes.values()) < 1_500_000


def test_readme_shows_commands() -> None:
    lines = code_lines((ROOT / "README.md").read_text())
    assert any(line.startswith("make demo") for line in lines)
    assert any("geomphys replay" in line for line in lines)


def test_changelog_has_the_version() -> None:
    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_packages_are_all_installed() -> None:
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    demo = {name for name in listed if name.partition(".")[0] == "geomphys_demo"}  # data only
    present = (
        {"geomphys_cli"}
        | demo
        | {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "geomphys").rglob("__init__.py")}
    )
    assert listed == present


def test_no_file_names_the_machine_it_was_made_on() -> None:
    machine = re.compile(rb"/(work|root|home/[a-z]+|Users/[A-Za-z]+)/")
    named = {
        path.relative_to(ROOT).as_posix(): found.group().decode()
        for path in files()
        if path.stat().st_size < 50_000_000 and (found := machine.search(path.read_bytes()))
    }
    assert not named
