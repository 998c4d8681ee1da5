"""The page of promises names tests that are there."""

from __future__ import annotations

import re
from pathlib import Path

from tests.house.sources import tree

PAGE = Path(__file__).parents[2] / "assets" / "docs" / "promise.md"
LINK = re.compile(r"\[(test_\w+)\]\(([\w./]+)\)")


def test_each_promise_names_a_test_that_is_there() -> None:
    promised, _, _ = PAGE.read_text().partition("## What is not promised")
    for item in re.split(r"\n- ", promised)[1:]:
        links = LINK.findall(item)
        assert links, f"no test holds: {item}"
        for name, path in links:
            names = {getattr(node, "name", "") for node in tree((PAGE.parent / path).resolve()).body}
            assert name in names, f"{path} has no {name}"


def test_the_page_is_found_from_the_readme() -> None:
    assert "assets/docs/promise.md" in (PAGE.parents[2] / "README.md").read_text()
