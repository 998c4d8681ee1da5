"""Shows a result in the rerun viewer, in a window or in the browser."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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


def view_result(path: AnyPath, *, web: bool = False) -> None:
    """Open a result in the viewer and wait until it is closed.

    Parameters
    ----------
    path : Path
        A rerun recording (``.rrd``) or an output log (``.mcap``).
    web : bool
        Whether to show it in the browser, served on 127.0.0.1 until interrupted.

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
        command = [*viewer_command(), *options, str(recording)]
        code = subprocess.run(
            ending_with_this_process(command), env=offline_environment(web=web), check=False
        ).returncode
    if code > 0:
        raise ViewerError(f"{path}: the viewer ended with exit code {code}; its messages are above")


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
