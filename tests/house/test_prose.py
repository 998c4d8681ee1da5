"""Docstrings and comments are in the words of the field too: words that mean nothing to a newcomer are refused."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator

import pytest

from tests.house.sources import modules
from tests.house.test_names import FOLDERS, folder_of

REFUSED = {
    r"halt(s|ed|ing)?": "stop, impact",
    r"dear(er|est)?": "of higher weight",
    r"bent|bends?": "flexed, curved, joint offset",
    r"lets? go|letting go": "release, give up",
    r"hangs? (on|to)|hanging on": "depends on, is below",
    r"hangs?": "is below, depends on",
    r"told|telling": "reported, known, distinguished",
    r"squeez(es|ed|ing)": "presses from two sides",
    r"troubles?": "problem",
    r"wedged?": "infeasible",
    r"rub(s|bed|bing)?": "tangential impulse",
    r"shov(e|es|ed)": "position correction",
    r"push(es|ed|ing)": "normal impulse, moved, displaced",
    r"rooms?": "workspace, margin, capacity, space",
    r"looked (at|for)": "measured, checked, searched",
    r"(stand|stands|stick|sticks|standing|sticking) out": "protrudes",
    r"changed? course|changes course": "its motion has changed",
    r"in vain": "without effect",
    r"(takes?|took|taken) (it|them|that|this) back": "undo",
    r"turns? of both": "rotations",
    r"(a|the|no) way (out|there|from|to go)": "path, displacement",
    r"wants? (to|of)|wanted": "is to, target",
    r"whoever": "the caller, the author of the scene file",
    r"knobs?": "parameter",
    r"crew": "worker pool",
    r"goes? (straight|round)": "moves on a straight line, rotates",
    r"shape yields|trees that yield": "may change, trees being solved",
}
"""Pattern of a word or phrase -> what to say instead. Names in backticks are code, not prose."""

PATTERN = re.compile(r"\b(" + "|".join(f"(?:{word})" for word in REFUSED) + r")\b", re.IGNORECASE)
CODE = re.compile(r"`[^`]*`")


def prose(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of the docstrings, of strings below what they describe, and of the comments of a module."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, " ".join(node.value.value.split())
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def refused_in(text: str) -> list[str]:
    """The refused words of a text."""
    return [match.group(1) for match in PATTERN.finditer(CODE.sub("", text))]


@pytest.mark.parametrize("folder", FOLDERS)
def test_prose_is_in_the_words_of_the_field(folder: str) -> None:
    bad = [
        f"{package}/{path.name}:{line}: {word!r} in {text[:80]!r}"
        for package in ("geomphys", "cli")
        for name, path in modules(package).items()
        if folder_of(package, name) == folder
        for line, text in prose(path.read_text())
        for word in refused_in(text)
    ]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize("text", ["no body is pushed", "# how often it halted", "It is looked for.", "a dearer joint"])
def test_a_private_word_in_prose_is_found(text: str) -> None:
    assert refused_in(text)


@pytest.mark.parametrize("text", ["`squeezed` is a field", "a push button", "the bedroom", "asphalt", "displaced"])
def test_other_words_are_not(text: str) -> None:
    assert not refused_in(text)
