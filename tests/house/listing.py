"""The list of modules in assets/docs/modules.md: run this file to bring it up to date."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.house.sources import modules, tree  # noqa: E402

DOCUMENT = ROOT / "assets/docs/modules.md"
LIST = re.compile(r"(?<=<!-- modules -->\n).*?(?=<!-- end of modules -->)", re.DOTALL)


def listing() -> str:
    """Every module that has a docstring with that docstring's first line, folder by folder."""
    lines = []
    for package in ("geomphys", "cli"):
        folders: dict[Path, list[str]] = {}
        for path in modules(package).values():
            about = ast.get_docstring(tree(path))
            if about and path.name not in {"__init__.py", "__main__.py"}:
                line = f"- `{path.relative_to(ROOT).as_posix()}`: {about.splitlines()[0].rstrip('.')}"
                folders.setdefault(path.parent, []).append(line)
        for folder, entries in sorted(folders.items()):
            lines += [f"\n## {folder.relative_to(ROOT).as_posix()}/\n", *entries]
    return "\n".join(lines) + "\n\n"


if __name__ == "__main__":
    DOCUMENT.write_text(LIST.sub(lambda _: listing(), DOCUMENT.read_text()))
