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
from tests.cli.every_command import Call, every_command
from tests.cli.press import Case
from tests.cli.test_outputs_never_replace_inputs import furnished
from tests.made import Results

__all__ = ["furnished"]

COMMAND = [sys.executable, "-P", "-m", "geomphys_cli"]


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
    recording, folder = tmp_path / "made.rrd", tmp_path / "outputs"
    folder.mkdir()
    geomphys.run(pressed.log, pressed.scene, rrd=recording)
    calls = every_command(furnished, pressed, pressed, root, folder)
    calls = {name: call for name, call in calls.items() if name in COMMANDS and name != "view"}
    calls["the viewer's picture"] = Call(["snapshot", str(recording), "-o", str(tmp_path / "c.png")], codes=(0, 1))
    browser = ["timeout", "5", *COMMAND, "view", recording, "--web"]
    done = watched([*([*COMMAND, *call.words] for call in calls.values()), browser], tmp_path)
    for one in done:
        assert one["packets"] == [], one
        assert "Traceback" not in str(one["said"]), one
    for call, one in zip(calls.values(), done, strict=False):
        assert one["code"] in call.codes, one
