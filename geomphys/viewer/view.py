"""Shows a result in the rerun viewer, in a window or in the browser."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Thread
from typing import IO

from geomphys.config import Config
from geomphys.errors import InputError, ViewerError
from geomphys.output.file_sinks import FILE_SINKS, FileSinkOptions
from geomphys.output.output_log import open_output
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.output.provenance import recorded_provenance
from geomphys.storage.child_process import ending_with_this_process
from geomphys.storage.remote_files import AnyPath
from geomphys.storage.temporary_folders import TemporaryFolder

ADDRESS = "127.0.0.1"
"""Where the viewer listens: to this machine only."""
NOWHERE = f"http://{ADDRESS}:9"
"""The discard port of this machine."""
_PAGE = re.compile(rf"http://{re.escape(ADDRESS)}:\d+\?url=[\w%.:/+-]+")
_LAST_LINES, _LINE_LIMIT = 200, 4096
"""Lines, and characters of a line, of what the viewer says; what it says of a failure is shorter."""
_LAST_WORDS_S = 1.0
"""Seconds that the viewer's last words are waited for once it has ended."""


def view_result(path: AnyPath, *, web: bool = False, serving: Callable[[str], None] | None = None) -> None:
    """Open a result in the viewer and wait until it is closed.

    Parameters
    ----------
    path : Path
        A rerun recording (``.rrd``) or an output log (``.mcap``).
    web : bool
        Whether to show it in the browser, served on 127.0.0.1 until interrupted.
    serving : callable, optional
        Called with the address of the page, once it is served.

    Raises
    ------
    InputError
        The file is none of the two, or no result.
    ViewerError
        There is no screen, or the viewer failed.
    """
    _check_result(path)
    if not web and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ViewerError("there is no screen here; use --web, or geomphys snapshot for a picture of a frame")
    with as_recording(path) as recording:
        options = ["--port", "auto", "--bind", ADDRESS, "--server-memory-limit", "75%"]
        if web:
            options += ["--web-viewer"]
        command = ending_with_this_process([*viewer_command(), *options, str(recording)])
        environment = {**offline_environment(web=web), "RUST_LOG": "error,re_sdk::web_viewer=info"}
        code, said = _run(command, environment, serving)
    if code != 0:
        raise ViewerError(f"{path}: {failure_reason(code, said)}")


def _run(command: list[str], environment: dict[str, str], serving: Callable[[str], None] | None) -> tuple[int, str]:
    """Run the viewer to its end; its exit code and the last of what it said."""
    lines: deque[str] = deque(maxlen=_LAST_LINES)

    def listen(messages: IO[str]) -> None:
        with messages:
            for line in iter(partial(messages.readline, _LINE_LIMIT), ""):
                lines.append(line)
                if serving is not None and (found := _PAGE.search(line)):
                    serving(found[0])

    process = subprocess.Popen(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    listener = Thread(target=listen, args=(process.stdout,), daemon=True)
    try:
        listener.start()
        process.wait()
    finally:
        process.kill()
        process.wait()
    listener.join(_LAST_WORDS_S)  # a browser that the viewer opened may hold its end of the pipe
    return process.returncode, "".join(lines)


def failure_reason(code: int | None, text: str) -> str:
    """Reason why the viewer does not answer or has ended, in a line, from its exit code and what it said."""
    if any(word in text.lower() for word in ("adapter", "vulkan", "render context")):
        return (
            "the rerun viewer found no graphics adapter; a snapshot of the output log (.mcap) needs none, "
            "or install a Vulkan driver (a software one will do: mesa-vulkan-drivers on Debian and Ubuntu)"
        )
    lines = [line for line in text.splitlines() if line.strip()]
    telling = [line for line in lines if line.startswith(("Error", "thread "))] or lines or ["it said nothing"]
    said = "".join(c for c in telling[-1].strip() if c.isprintable())[:200]
    end = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
    return f"the rerun viewer failed ({end}): {said}"


def viewer_command() -> list[str]:
    """The viewer's program; raises ViewerError if it is not installed."""
    try:
        import rerun_cli
    except ImportError as problem:
        raise ViewerError("the rerun viewer is not installed; install rerun-sdk") from problem
    program = Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not program.is_file():
        raise ViewerError(f"the rerun viewer is not installed: {program} is missing; install rerun-sdk again")
    return [str(program)]


def offline_environment(*, web: bool = False) -> dict[str, str]:
    """Environment variables of the viewer with which nothing leaves this machine.

    It sends no usage statistics if ``CI`` is set. Its window asks a server for a newer version and has no switch for that, but
    goes by the proxy it is given: one on this machine where nothing answers, so that not even a name is looked up. Its
    server for the browser (`web`) does not ask, and the browser that it opens keeps the user's proxy.
    """
    proxies = (
        {} if web else dict.fromkeys(("HTTPS_PROXY", "https_proxy", "HTTP_PROXY", "http_proxy", "ALL_PROXY"), NOWHERE)
    )
    return {**os.environ, "CI": "1", **proxies}


@contextmanager
def as_recording(path: AnyPath) -> Iterator[AnyPath]:
    """Yield the rerun recording of a result; an output log is converted to a temporary one.

    Raises InputError if the file is no result, or its scene cannot be rebuilt from its attachments.
    """
    _check_result(path)
    if path.suffix == ".rrd":
        yield path
        return
    output = open_output(path)
    world = world_of_output(output)
    with TemporaryFolder() as folder:
        sink = FILE_SINKS[".rrd"](folder / "result.rrd", FileSinkOptions(timing="/timing" in output.topics))
        sink.open(world, Config(), recorded_provenance(output.metadata))
        complete = False
        try:
            for result in results_of_output(output, world):
                sink.write(result)
            complete = output.complete
        finally:
            sink.close(complete)
        yield folder / ("result.rrd" if output.complete else "result.partial.rrd")


def _check_result(path: AnyPath) -> None:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a .rrd or .mcap that geomphys replay wrote")
    if path.suffix == ".mcap":
        open_output(path)
    elif path.suffix != ".rrd":
        raise InputError(f"{path}: is neither a rerun recording (.rrd) nor an output log (.mcap)")
