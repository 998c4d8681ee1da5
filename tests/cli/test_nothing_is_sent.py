"""No command looks up a name or sends a packet: each is watched in a network namespace of its own."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from geomphys_cli.main import COMMANDS

import geomphys
from tests.cli.press import Case
from tests.cli.test_outputs_never_replace_inputs import furnished
from tests.made import Results

__all__ = ["furnished"]

COMMAND = [sys.executable, "-P", "-m", "geomphys_cli"]
UNWATCHED = {"completion", "schema", "bench"}
"""Two print a text; the benchmark runs replays."""


def watched(commands: list[list[object]], folder: Path) -> list[dict[str, object]]:
    """What each command did; skipped where there are no namespaces or TUN devices."""
    script = Path(__file__).with_name("watched_network.py")
    (folder / "commands.json").write_text(json.dumps([[str(word) for word in words] for words in commands]))
    if shutil.which("unshare") is None:
        pytest.skip("unshare is not here")
    for enter in (["unshare", "-n"], ["unshare", "-r", "-n"]):
        if subprocess.run([*enter, "true"], capture_output=True).returncode == 0:
            break
    else:
        pytest.skip("no network namespace can be made here")
    done = subprocess.run(
        [*enter, sys.executable, script, folder / "commands.json"],
        capture_output=True,
        text=True,
        timeout=900,
        cwd=folder,
    )
    if "/dev/net/tun" in done.stderr:
        pytest.skip("no TUN device can be made here")
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_the_watch_sees_a_lookup_and_a_connection(tmp_path: Path) -> None:
    lookup = "import socket\ntry: socket.getaddrinfo('example.org', 443)\nexcept OSError: pass"
    connect = "import socket\ntry: socket.create_connection(('203.0.113.7', 443), 0.2)\nexcept OSError: pass"
    local = "import socket\ntry: socket.create_connection(('127.0.0.1', 443), 0.2)\nexcept OSError: pass"
    first, second, third = watched([[sys.executable, "-c", code] for code in (lookup, connect, local)], tmp_path)
    assert "example org" in str(first["packets"])
    assert "to 203.0.113.7:443" in str(second["packets"])
    assert third["packets"] == []


def test_no_command_sends_anything(furnished: Case, pressed: Results, root: Path, tmp_path: Path) -> None:
    recording, points = tmp_path / "made.rrd", root / "recordings/webxr_hand.mcap"
    geomphys.run(pressed.log, pressed.scene, rrd=recording)
    words: dict[str, list[object]] = {
        "init": [furnished.log, "--urdf", furnished.folder / "cup.urdf", "-o", "-"],
        "replay": [furnished.log, "-s", furnished.scene, "-o", tmp_path / "a.mcap", "--rrd", tmp_path / "a.rrd"],
        "batch": [furnished.log, "-s", furnished.scene, "-O", tmp_path / "batch", "--rrd"],
        "diff": [pressed.out, pressed.raised, "--html", tmp_path / "a.html", "--rrd", tmp_path / "diff.rrd"],
        "stats": [pressed.out],
        "plot": [pressed.out, "-o", tmp_path / "a.png"],
        "audit": [pressed.out],
        "check": [furnished.log, "-s", furnished.scene],
        "info": [furnished.log],
        "snapshot": [recording, "-o", tmp_path / "b.png"],
        "video": [pressed.out, "-o", tmp_path / "a.gif", "--to", "0.1", "--size", "64", "64"],
        "export": [pressed.out, "-o", tmp_path / "tables"],
        "calibrate": [points, "-s", root / "assets/scenes/webxr_hand.toml", "--flat", "1:2", "--on", "table"],
        "demo": [],
        "decompose": [furnished.folder / "cube.obj", "-o", tmp_path / "a.glb"],
    }
    browser = [*COMMAND, "view", recording, "--web"]
    assert set(COMMANDS) - UNWATCHED - {"view"} <= words.keys(), "a command is not watched"
    done = watched([*([*COMMAND, name, *more] for name, more in words.items()), ["timeout", "5", *browser]], tmp_path)
    for one in done:
        assert one["packets"] == [], one
        assert "Traceback" not in str(one["said"]), one
    failed = {str(one["words"][4]): one for one in done[:-1] if one["code"] != 0}  # type: ignore[index]
    assert failed.keys() <= {"diff", "snapshot"}, failed  # they differ; no graphics driver
