"""What may reach a terminal, and in which form."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys

import numpy as np
import pytest
from geomphys_cli.terminal import Terminal, json_value, printable, size_text
from hypothesis import given
from hypothesis import strategies as st


@given(st.text(st.characters(codec=None)))
def test_no_text_steers_the_terminal(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert shown.encode().decode() == shown


@given(st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"])))
def test_ordinary_text_is_shown_as_it_is(text: str) -> None:
    assert printable(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a\nb", r"a\nb"), ("\x1b[31mred", r"\x1b[31mred"), ("\u202egnp", r"\u202egnp"), ("\udc80", r"\udc80")],
)
def test_control_characters_are_escaped(text: str, shown: str) -> None:
    assert printable(text) == shown


@pytest.mark.parametrize(
    ("count", "shown"), [(0, "0.0 kB"), (36_300, "36.3 kB"), (100_000, "0.1 MB"), (12_500_000_000, "12,500.0 MB")]
)
def test_no_file_with_content_is_shown_as_empty(count: int, shown: str) -> None:
    assert size_text(count) == shown


def test_json_holds_no_nan(capsys: pytest.CaptureFixture[str]) -> None:
    value = {"a": np.float64(1.5), "b": [float("nan"), np.inf], "c": np.arange(3), "d": (np.int64(4), None, True)}
    Terminal().json(value)
    assert json.loads(capsys.readouterr().out) == {"a": 1.5, "b": [None, None], "c": [0, 1, 2], "d": [4, None, True]}
    assert json_value(value)["a"] == 1.5


def test_quiet_keeps_errors_only(capsys: pytest.CaptureFixture[str]) -> None:
    terminal = Terminal(quiet=True)
    terminal.note("note")
    terminal.warning("warning")
    terminal.detail("detail")
    terminal.error("error\nof two lines")
    output = capsys.readouterr()
    assert output.err == "geomphys: error: error\\nof two lines\n"
    assert output.out == ""


def on_a_terminal(*words: str, **environment: str) -> str:
    """What a terminal is sent by a command."""
    primary, secondary = pty.openpty()
    inherited = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    with subprocess.Popen(
        [sys.executable, "-m", "geomphys_cli", *words],
        stdout=secondary,
        stderr=secondary,
        env=inherited | {"TERM": "xterm-256color"} | environment,
    ):
        os.close(secondary)
        sent = b""
        try:
            while block := os.read(primary, 65536):
                sent += block
        except OSError:  # Linux ends a terminal that nobody writes to any more with an error
            pass
    os.close(primary)
    return sent.decode()


def test_colours_only_where_they_are_wanted() -> None:
    assert "\x1b[1;31m" in on_a_terminal("replay", "nowhere.mcap")
    assert "\x1b" not in on_a_terminal("replay", "nowhere.mcap", NO_COLOR="1")
    assert "\x1b" not in on_a_terminal("--no-color", "replay", "nowhere.mcap")


@pytest.mark.parametrize("width", [40, 60, 200])
def test_a_table_never_cuts_a_figure_and_says_what_it_leaves_out(width: int) -> None:
    from geomphys_cli.terminal import table_in
    from rich.console import Console

    rows = [["a_rather_long_name_of_a_thing", "12,345", "0.123", "9,876"], ["b", "1", "2", "3"]]
    console = Console(width=width, color_system=None)
    with console.capture() as captured:
        console.print(table_in(width, ["thing", "frames", "median", "largest"], rows, droppable=("frames", "median")))
    text = captured.get()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert "9,876" in text
    assert ("12,345" in text) == (width != 40)
    assert ("too narrow for frames" in text) == (width == 40)
