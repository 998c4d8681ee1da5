"""What the documents print is what the commands print: the README, the guide of grasping and the worked example."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from geomphys_cli.main import run

ROOT = Path(__file__).resolve().parent.parent
SHOWN = ("README.md", "assets/docs/grasping.md", "assets/docs/your_recording.md")
EXIT_CODES = {"info": 0, "init": 0, "check": 0, "replay": 0, "diff": 1}
"""Command that is run here -> its exit code; the results that are compared differ."""

VOLATILE = (
    (re.compile(r"[\d.,]+ (ns|µs|ms) a frame"), "T a frame"),
    (re.compile(r"[\d.,]+ (ns|µs|ms) at the"), "T at the"),
    (re.compile(r"[\d.,]+ frames/s"), "N frames/s"),
    (re.compile(r"[\d.,]+ times real time"), "N times real time"),
    (re.compile(r"\(\d[\d.,]* MB\)"), "(N MB)"),
)


def demo() -> list[str]:
    """The commands of ``make demo``, as its Makefile has them."""
    text = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    (targets,) = re.findall(r"^demo: (.*)$", text, flags=re.MULTILINE)
    recipes = dict(re.findall(r"^(\S+):.*\n((?:\t.*\n)+)", text, flags=re.MULTILINE))
    lines = [line.strip() for target in targets.split() for line in recipes.get(target, "").splitlines()]
    return [line.replace("$(BIN)/", "") for line in lines if line.startswith("$(BIN)/geomphys ")]


def stories(text: str) -> list[tuple[list[str], str]]:
    """Each ``text`` block of a document, and the commands that stand before it since the last one."""
    found, commands = [], list[str]()
    for kind, block in re.findall(r"```(sh|text)\n(.*?)```", text, flags=re.DOTALL):
        if kind == "text":
            found.append((commands, block))
            commands = []
        else:
            commands = commands + block.replace("\\\n", " ").splitlines()
    return found


def is_run(line: str) -> bool:
    """Whether a command can be run here: one on recordings of the checkout, or on what was made of them."""
    words = shlex.split(line, comments=True)
    there = all((ROOT / word).exists() for word in words if word.startswith("recordings/"))
    return words[:1] == ["geomphys"] and words[1] in EXIT_CODES and there


def settled(text: str) -> list[str]:
    """Lines without what differs from run to run."""
    for pattern, instead in VOLATILE:
        text = pattern.sub(instead, text)
    return [line.rstrip() for line in text.splitlines()]


STORIES = [
    pytest.param(commands, block, id=f"{Path(name).stem}-{number}")
    for name in SHOWN
    for number, (commands, block) in enumerate(stories((ROOT / name).read_text()))
]


def test_there_is_a_demo_an_example_and_a_worked_one() -> None:
    assert len(demo()) == 1
    assert len(STORIES) == 5


@pytest.mark.parametrize(("commands", "block"), STORIES)
def test_documents_show_what_is_printed(
    commands: list[str], block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("assets", "recordings"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    lines = [line for command in commands for line in (demo() if command == "make demo" else [command])]
    for line in lines:
        words = shlex.split(line, comments=True)
        if is_run(line) and Path(words[2]).exists():
            assert run(words[1:]) == EXIT_CODES[words[1]], line
    printed = settled(capsys.readouterr().out)
    for paragraph in block.split("\n\n"):
        shown = settled(paragraph.strip("\n"))
        at = [k for k in range(len(printed)) if printed[k : k + len(shown)] == shown]
        assert at, f"no command prints:\n{paragraph}\nbut:\n" + "\n".join(printed)
