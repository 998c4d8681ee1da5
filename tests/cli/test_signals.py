"""SIGINT and SIGTERM are never lost: at every import, in every frame, and where someone catches every exception."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from geomphys_cli.main import COMMANDS, run

import geomphys
from geomphys.authoring.demo_files import DemoFiles
from geomphys.output.output_log import OutputLog
from geomphys.recording.log_pass import LogPass
from geomphys.recording.reader import LogReader
from tests.cli.batch_here import FRAME, SIGNAL, preload_and_stop_parent, run_here
from tests.cli.every_command import every_command
from tests.cli.press import FRAMES, Case, command_line
from tests.cli.test_outputs_never_replace_inputs import furnished
from tests.made import Results

__all__ = ["furnished"]

CODES = {"SIGINT": 130, "SIGTERM": 143}
SAID = {"SIGINT": "interrupted", "SIGTERM": "terminated"}


QUICK = ("replay", "plot", "init")
"""Commands of which every 41st import is tried in the quick tests; in the slow ones it is every import of all commands."""


@pytest.mark.parametrize("name", CODES)
@pytest.mark.parametrize(
    ("command", "stride"),
    [
        *((name, 41) for name in QUICK),
        *(pytest.param(name, 1, marks=pytest.mark.slow) for name in (*COMMANDS, "ros2", "lerobot", "foxglove")),
    ],
)
def test_a_signal_at_any_import_ends_the_command(
    furnished: Case,
    pressed: Results,
    landed: Results,
    root: Path,
    tmp_path: Path,
    name: str,
    stride: int,
    command: str,
) -> None:
    (tmp_path / "outputs").mkdir()
    call = every_command(furnished, pressed, landed, root, tmp_path / "outputs")[command]
    words, codes = call.words, call.codes
    if command == "replay":
        words += ["--seed", str(time.time_ns() % 2**31)]  # so that meshes are loaded, and no scene from the cache
    elif command == "view":
        words.remove("--web")  # says that there is no screen
        codes = (1,)
    said = tmp_path / "said"
    said.mkdir()
    script = Path(__file__).with_name("stopped_imports.py")
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}

    def stopped(which: object) -> subprocess.CompletedProcess[str]:
        begin = [str(word) for word in (sys.executable, script, which, name, said, *words)]
        return subprocess.run(begin, capture_output=True, text=True, errors="replace", timeout=600, env=environment)

    done = stopped(stride)
    assert done.returncode in codes, done.stderr
    found = [json.loads(line) for line in done.stdout.split("\n") if line.startswith(('{"module"', '{"later"'))]
    ends = [line for line in found if "module" in line]
    assert len(ends) >= (8 if stride > 1 or command == "completion" else 300)
    for end in ends:
        assert end["code"] == CODES[name], end
        assert "Traceback" not in end["said"], end
        assert "Exception ignored" not in end["said"], end
    left = {str(path.relative_to(tmp_path / "outputs")) for path in (tmp_path / "outputs").rglob("*") if path.is_file()}
    assert left >= ({call.writes} if call.writes else set()), "the forks ended nothing"
    assert not [name for name in left if ".partial." in name or name.endswith(".tmp")]
    later = max((line["later"] for line in found if "later" in line), default=0)
    assert later > 0 or command != "batch"
    for number in range(1, later + 1, stride):
        done = stopped(f"@{number}")
        assert done.returncode == CODES[name], (number, done.stderr)
        assert done.stderr.splitlines()[-1] == f"geomphys: error: {SAID[name]}", (number, done.stderr)
        assert "Traceback" not in done.stderr, number


@pytest.mark.parametrize("name", CODES)
def test_a_signal_that_an_optional_import_swallows_is_raised_again(tmp_path: Path, name: str) -> None:
    """As trimesh does: whatever an optional import raises is kept for later."""
    greedy = "\n".join(
        [
            "import os, signal, time",
            "for _ in range(3):",
            "    try:",
            f"        os.kill(os.getpid(), signal.{name})",
            "        time.sleep(0.01)",
            "    except BaseException as problem:",
            "        kept = problem",
        ]
    )
    (tmp_path / "greedy.py").write_text(greedy)
    code = (
        f"import sys, time; sys.path.insert(0, {str(tmp_path)!r}); import geomphys_cli.cmd_schema as command\n"
        "def show(ctx):\n import greedy; time.sleep(30)\n"
        "command.schema.invoke = show"
    )
    done = command_line("schema", code=code)
    assert done.returncode == CODES[name], done.stderr
    assert done.stderr.splitlines() == [f"geomphys: error: {SAID[name]}"]


@pytest.mark.parametrize("name", CODES)
def test_a_signal_that_comes_out_as_another_error_still_has_its_code(name: str) -> None:
    code = (
        "import os, signal, geomphys_cli.cmd_schema as command\n"
        "def show(ctx):\n"
        f" try: os.kill(os.getpid(), signal.{name})\n"
        " except BaseException: pass\n"
        " raise TypeError('half an import')\n"
        "command.schema.invoke = show"
    )
    done = command_line("schema", code=code)
    assert done.returncode == CODES[name]
    assert "Traceback" not in done.stderr


def test_a_signal_in_a_finalizer_is_not_lost() -> None:
    code = (
        "import os, signal, time, geomphys_cli.cmd_schema as command\n"
        "class Kept:\n def __del__(self): os.kill(os.getpid(), signal.SIGTERM); time.sleep(0.001)\n"
        "def show(ctx):\n kept = Kept(); del kept; time.sleep(30)\n"
        "command.schema.invoke = show"
    )
    done = command_line("schema", code=code)
    assert done.returncode == 143
    assert done.stderr.splitlines() == ["geomphys: error: terminated"]


def test_nothing_is_raised_in_the_hook_for_what_a_finalizer_dropped() -> None:
    """Python would print it, and that it was ignored."""
    code = (
        "import os, signal, sys, time, geomphys_cli.cmd_schema as command, geomphys_cli.signals as signals\n"
        "class Dropped:\n"
        " @property\n"
        " def exc_value(self): os.kill(os.getpid(), signal.SIGTERM); return signals.Stopped(15)\n"
        "def show(ctx):\n sys.unraisablehook(Dropped()); print('after it', flush=True); time.sleep(30)\n"
        "command.schema.invoke = show"
    )
    done = command_line("schema", code=code)
    assert (done.returncode, done.stdout) == (143, "after it\n")
    assert done.stderr.splitlines() == ["geomphys: error: terminated"]


AT_FRAME = """
import os, signal
import geomphys_cli.signals as command
stop, frames = command.StopAtFrame.at_frame, 0
def at_frame(self):
    global frames
    frames += 1
    if frames == {frame}:
        os.kill(os.getpid(), signal.{name})
    stop(self)
command.StopAtFrame.at_frame = at_frame
"""


@pytest.mark.parametrize(
    "frame", [1, FRAMES, *(pytest.param(frame, marks=pytest.mark.slow) for frame in range(2, FRAMES, 3))]
)
@pytest.mark.parametrize("name", CODES)
def test_a_signal_in_any_frame_leaves_the_part_up_to_it(case: Case, tmp_path: Path, frame: int, name: str) -> None:
    words = ("replay", case.log, "-s", case.scene, "-o", tmp_path / "out.mcap")
    done = command_line(*words, code=AT_FRAME.format(frame=frame, name=name))
    assert done.returncode == CODES[name], done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["out.partial.mcap"]
    assert sum(1 for _ in geomphys.open_output(tmp_path / "out.partial.mcap").frames()) == frame


def test_a_signal_that_a_fork_gets_ends_nothing_of_the_replay(case: Case, tmp_path: Path) -> None:
    words = ("replay", case.log, "-s", case.scene, "--no-timing", "--copy-input", "-q", "-o")
    assert run([str(word) for word in (*words, tmp_path / "whole.mcap")]) == 0
    forking = AT_FRAME.replace("os.kill(", "os.fork() or os.kill(").format(frame=7, name="SIGTERM")
    done = command_line(*words, tmp_path / "out.mcap", "--rrd", tmp_path / "out.rrd", code=forking)
    assert done.returncode == 0, done.stderr
    assert done.stderr == "geomphys: error: terminated\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.mcap", "out.rrd", "whole.mcap"]
    assert (tmp_path / "out.mcap").read_bytes() == (tmp_path / "whole.mcap").read_bytes()


def test_a_fork_that_ends_in_the_middle_of_a_replay_reads_and_writes_nothing(case: Case, tmp_path: Path) -> None:
    """By the library: it ends as it would, and moves no position in a file that it shares."""
    code = (
        "import os, sys; from pathlib import Path; import geomphys; from geomphys.output.input_copy import InputCopy\n"
        "def progress(done, expected):\n"
        "    if done == 7 and os.fork() == 0:\n"
        "        InputCopy.close = InputCopy.copy_until = lambda *given, **more: os._exit(9)\n"
        "        sys.exit(7)\n"
        "log, scene, out = map(Path, sys.argv[1:])\n"
        "geomphys.run(log, scene, out=out, rrd=out.with_suffix('.rrd'), options=geomphys.OutputOptions(copy_input=True),"
        " callbacks=geomphys.Callbacks(progress=progress))\n"
        "assert os.waitstatus_to_exitcode(os.wait()[1]) == 7"
    )
    words = [sys.executable, "-c", code, *(str(path) for path in (case.log, case.scene, tmp_path / "out.mcap"))]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.mcap", "out.rrd"]


class StopsAt:
    """Sends this process a signal when the n-th frame, or message of a log, is read."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, signum: int) -> None:
        self.signum, self.left = signum, 0
        for kind, method in ((OutputLog, "frames"), (LogPass, "frames"), (LogReader, "read")):
            monkeypatch.setattr(kind, method, self.counted(getattr(kind, method)))

    def counted(self, read: Callable[..., Iterator[object]]) -> Callable[..., Iterator[object]]:
        """What reads frames, and counts them."""

        def frames(*given: Any, **more: Any) -> Iterator[object]:
            for frame in read(*given, **more):
                self.left -= 1
                if self.left == 0:
                    os.kill(os.getpid(), self.signum)
                yield frame

        return frames


READS_NO_FRAME = {"completion", "schema", "decompose"}
"""Two print a text, one reads meshes."""
REPLAYS = {"replay", "demo", "batch"}
"""These leave the part up to the signal."""


@pytest.mark.parametrize("name", CODES)
@pytest.mark.parametrize("stride", [57, pytest.param(7, marks=pytest.mark.slow)])
@pytest.mark.parametrize("command", [*(name for name in COMMANDS if name not in READS_NO_FRAME), "lerobot"])
def test_a_signal_while_any_frame_is_read_leaves_what_was_there(
    command: str,
    stride: int,
    name: str,
    furnished: Case,
    pressed: Results,
    landed: Results,
    root: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A batch runs its jobs in this process; `view` has a viewer that ends at once, the demonstration a small log."""
    folder = tmp_path / "outputs"
    folder.mkdir()
    words = every_command(furnished, pressed, landed, root, folder)[command].words
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    files = DemoFiles(furnished.log, furnished.scene)
    monkeypatch.setattr("geomphys.authoring.demo_files.demo_files", lambda: files)
    monkeypatch.setattr("geomphys.viewer.view.viewer_command", lambda: ["/bin/true"])
    monkeypatch.setattr("geomphys.batch.run.run_in_processes", run_here)
    stops, frame = StopsAt(monkeypatch, getattr(signal, name)), 1
    while frame < 250:
        stops.left = frame
        code = run(words)
        if stops.left > 0:
            break
        lines = capsys.readouterr().err.splitlines()
        assert (code, lines[-1].partition(";")[0]) == (CODES[name], f"geomphys: error: {SAID[name]}"), frame
        left = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        parts = [name for name in left if ".partial." in name]
        assert not parts or command in REPLAYS
        if command == "batch":
            left.pop("manifest.json")
        whole = [name for name in left if name == "a.html" and left[name].endswith(b"</html>\n")]
        assert not whole or command == "diff", "it writes two files"
        assert {name: data for name, data in left.items() if name not in parts + whole} == before
        frame += stride
    assert frame > 1, "it reads no frame"


@pytest.mark.parametrize("name", CODES)
@pytest.mark.parametrize(
    "frame", [FRAMES // 2, *(pytest.param(frame, marks=pytest.mark.slow) for frame in range(1, FRAMES, 6))]
)
def test_a_signal_in_any_frame_of_a_job_leaves_the_part_up_to_it_and_is_resumed(
    case: Case,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    frame: int,
    name: str,
) -> None:
    """The batch gets it while a process of its own is in that frame."""
    words = ["batch", str(case.log), "-s", str(case.scene), "-O", str(tmp_path), "--no-timing", "-q", "--resume"]
    monkeypatch.setenv(FRAME, str(frame))
    monkeypatch.setenv(SIGNAL, str(getattr(signal, name).value))
    with monkeypatch.context() as stopping:
        stopping.setattr("geomphys.batch.executors.preload_world", preload_and_stop_parent)
        assert run(words) == CODES[name]
    assert capfd.readouterr().err == f"geomphys: error: {SAID[name]}\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["manifest.json", "press.partial.mcap"]
    assert sum(1 for _ in geomphys.open_output(tmp_path / "press.partial.mcap").frames()) == frame
    assert json.loads((tmp_path / "manifest.json").read_text())["logs"][0]["status"] in ("pending", "interrupted")
    assert run(words) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["manifest.json", "press.mcap"]


def test_a_signal_after_the_last_frame_is_told(case: Case, tmp_path: Path) -> None:
    code = (
        "import os, signal, geomphys.output.mcap_sink as m\n"
        "close = m.McapSink.close\n"
        "m.McapSink.close = lambda self, complete: (os.kill(os.getpid(), signal.SIGTERM), close(self, complete))"
    )
    done = command_line("replay", case.log, "-s", case.scene, "-o", tmp_path / "out.mcap", code=code)
    assert done.returncode == 143
    assert geomphys.open_output(tmp_path / "out.mcap").complete


@pytest.mark.parametrize("module", ["child_process", "coacd_process"])
def test_a_child_ends_with_its_parent_after_sigkill(tmp_path: Path, module: str) -> None:
    if module == "child_process":
        start = (
            "from geomphys.storage.child_process import ending_with_this_process as guard\n"
            "import subprocess; child = subprocess.Popen(guard(['/bin/sleep', '600']))\n"
        )
    else:
        start = (
            "import threading, numpy as np, subprocess, geomphys.scene.coacd_process as c\n"
            "real = subprocess.Popen\n"
            "def popen(command, **more):\n"
            "    global child\n"
            "    child = real([*command[:2], '-c', 'import sys, time; from geomphys.storage.child_process import *;'"
            " 'end_with_parent(int(sys.argv[-1])); time.sleep(600)', *command[4:]], **more)\n"
            "    return child\n"
            "subprocess.Popen, child = popen, None\n"
            "mesh = 'm', np.zeros((3, 3)), np.zeros((1, 3), int), c.CutOptions(0.1, 0)\n"
            "threading.Thread(target=c.convex_parts, args=mesh).start()\n"
            "while child is None: pass\n"
        )
    code = start + "import time; time.sleep(1.0); print(child.pid, flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        os.kill(child, 0)
        parent.send_signal(signal.SIGKILL)
    deadline = time.monotonic() + 20
    while _runs(child) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _runs(child)


def _runs(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
