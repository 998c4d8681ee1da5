"""Takes a picture of one frame of a result, without a screen.

An output log is drawn in software, which needs no graphics driver and gives the same picture on every machine. A rerun
recording, and the whole window, are drawn by the rerun viewer without a window, which needs a Vulkan driver.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from io import BytesIO
from typing import TYPE_CHECKING, Any

from geomphys.errors import ConfigError, InputError, ViewerError
from geomphys.output.output_log import open_output
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.storage.child_process import ending_with_this_process
from geomphys.storage.output_file import check_target, write_file
from geomphys.storage.remote_files import AnyPath
from geomphys.viewer.frame_picture import FramePainter, viewpoint_of
from geomphys.viewer.view import ADDRESS, as_recording, failure_reason, offline_environment, viewer_command

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

EQUAL_PICTURES = 3
"""Number of consecutive equal pictures after which rendering counts as complete."""
POLL_S = 0.2
"""s; interval between pictures."""
TIMEOUT_S = 60.0
"""s; time limit for the scene to be rendered completely."""
WINDOW_TIMEOUT_S = 15.0
"""s; time limit for the rest of the window to stop changing."""


def take_snapshot(
    result: AnyPath,
    out: AnyPath,
    *,
    frame: int = 0,
    size: tuple[int, int] = (1280, 960),
    focus: str | None = None,
    whole_window: bool = False,
) -> None:
    """Write a picture of a frame as PNG.

    Parameters
    ----------
    result : Path
        An output log (``.mcap``) or a rerun recording (``.rrd``).
    out : Path
        The picture; replaced if it is there.
    frame : int
        The frame's number.
    size : (int, int)
        Width and height of the picture, or of the viewer's window in points.
    focus : str, optional
        Body, avatar or object of an output log to look at; None: what is in contact or was corrected.
    whole_window : bool
        Whether the picture shows the viewer's whole window with its plots; otherwise only the scene.

    Raises
    ------
    InputError
        The file is no result, or has no such frame.
    ConfigError
        There is no body of the name in focus.
    ViewerError
        The viewer is needed and there is no Vulkan driver, or it does not draw the frame.
    OutputError
        The picture cannot be written.
    """
    check_target(out, force=True, inputs=(result,))
    if result.suffix == ".mcap" and not whole_window:
        picture = _drawn(result, frame, size, focus)
    elif focus is not None:
        raise ConfigError("focus: only pictures of the scene of an output log (.mcap) can be focused")
    else:
        picture = _seen_in_viewer(result, frame, size, whole_window)
    write_file(out, picture, force=True, inputs=(result,))


def _drawn(path: AnyPath, frame: int, size: tuple[int, int], focus: str | None) -> bytes:
    """PNG of a frame of an output log, drawn in software."""
    from PIL import Image

    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a .rrd or .mcap that geomphys replay wrote")
    output = open_output(path)
    output.time_of(frame)  # raises if there is no such frame
    world = world_of_output(output)
    result = next(results_of_output(output, world, first=frame, last=frame))
    pixels = FramePainter(world).picture(result, viewpoint_of(world, [result], focus, size), size)
    data = BytesIO()
    Image.fromarray(pixels).save(data, "PNG", optimize=False)
    return data.getvalue()


def _seen_in_viewer(path: AnyPath, frame: int, size: tuple[int, int], whole_window: bool) -> bytes:
    """PNG of a frame as the rerun viewer draws it."""
    with as_recording(path) as recording, _headless_viewer(recording, size) as client:
        _wait_for_load(client, path)
        _check_frame(client, path, frame)
        client.set_time("frame", sequence=frame, play_state="paused")
        return _settled_picture(client, path, whole_window)


@contextlib.contextmanager
def _headless_viewer(recording: AnyPath, size: tuple[int, int]) -> Iterator[ViewerClient]:
    """Start a viewer without a window; yields a client connected to it."""
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        port = probe.getsockname()[1]
    options = ["--headless", "--hide-welcome-screen", "--bind", ADDRESS, "--port", str(port)]
    command = [*viewer_command(), *options, "--window-size", f"{size[0]}x{size[1]}", str(recording)]
    with tempfile.TemporaryFile() as messages:
        environment = {**offline_environment(), "RUST_LOG": "error"}  # log lines would be drawn over the scene
        guarded = ending_with_this_process(command)
        process = subprocess.Popen(guarded, env=environment, stdout=messages, stderr=messages, start_new_session=True)
        try:
            yield _connect(ViewerClient, f"rerun+http://{ADDRESS}:{port}/proxy", process, messages)
        except ConnectionError as problem:
            raise ViewerError(_failure(process, messages)) from problem
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(timeout=5)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _connect(client: Any, address: str, process: subprocess.Popen[bytes], messages: Any) -> ViewerClient:
    end = time.monotonic() + TIMEOUT_S
    while True:
        try:
            connected: ViewerClient = client.connect(address)
            connected.get_state()
        except ConnectionError as problem:
            if process.poll() is not None or time.monotonic() > end:
                raise ViewerError(_failure(process, messages)) from problem
            time.sleep(0.1)
        else:
            return connected


def _failure(process: subprocess.Popen[bytes], messages: Any) -> str:
    """Reason why the viewer does not answer."""
    with contextlib.suppress(subprocess.TimeoutExpired):  # it closes its port before it ends
        process.wait(timeout=2.0)
    messages.seek(0)
    return failure_reason(process.poll(), messages.read().decode(errors="replace"))


def _wait_for_load(client: ViewerClient, result: AnyPath) -> None:
    end = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end:
        state = client.get_state()
        if not state.loading and state.recordings and state.recordings[0].timelines and state.views:
            return
        time.sleep(0.05)
    raise ViewerError(f"{result}: the rerun viewer did not load it in {TIMEOUT_S:.0f} s")


def _check_frame(client: ViewerClient, result: AnyPath, frame: int) -> None:
    for timeline in client.get_state().recordings[0].timelines:
        if timeline.name == "frame" and timeline.start is not None and timeline.end is not None:
            if timeline.start <= frame <= timeline.end:
                return
            raise InputError(f"{result}: has no frame {frame}; it has {timeline.start} to {timeline.end}")
    raise InputError(f"{result}: has no timeline 'frame': it is no recording that geomphys replay wrote")


def _settled_picture(client: ViewerClient, result: AnyPath, whole_window: bool) -> bytes:
    """The picture once the scene is rendered; raises ViewerError if it is not, or only in part.

    The rest of the window may go on changing for minutes with a long recording.
    """
    scenes = [view for view in client.get_state().views if view.view_class == "3D"]
    if not scenes:
        raise ViewerError(f"{result}: the rerun viewer shows no scene of it")
    picture, settled = _settled(client, scenes[0].view_id, TIMEOUT_S)
    if not settled:
        raise ViewerError(f"{result}: the rerun viewer's picture did not settle in {TIMEOUT_S:.0f} s")
    shown = [view for view in client.get_state().views if view.view_class == "3D"]
    errors = [report.summary for view in shown[:1] for report in view.reports if report.severity == "error"]
    if errors:
        raise ViewerError(f"{result}: the rerun viewer cannot draw all of the scene: {errors[0]}")
    return _settled(client, None, WINDOW_TIMEOUT_S)[0] if whole_window else picture


def _settled(client: ViewerClient, view: Any, timeout_s: float) -> tuple[bytes, bool]:
    """The last picture of a view (None: the window), and whether it was the last of `EQUAL_PICTURES` equal ones in a row."""
    end = time.monotonic() + timeout_s
    last, equal = b"", 0
    while equal < EQUAL_PICTURES:
        if time.monotonic() > end:
            return last, False
        picture = client.take_screenshot(view, max_size=None)
        equal = equal + 1 if picture == last else 1
        last = picture
        time.sleep(POLL_S)
    return last, True
