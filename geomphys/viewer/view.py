"""Shows a result in the rerun viewer, in a window or in the browser."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from defusedxml import ElementTree

from geomphys.errors import InputError, ViewerError
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output.camera import choose_viewpoint
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputLog, open_output
from geomphys.output.output_world import world_of_output
from geomphys.output.rerun_blueprint import mcap_blueprint
from geomphys.output.rerun_stream import UNIX_TIME_START, RerunStream
from geomphys.scene.arrays import FIXED
from geomphys.storage.child_process import ending_with_this_process
from geomphys.storage.remote_files import AnyPath, RemotePath, is_remote
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

    Raises InputError if the file is no result.
    """
    _check_result(path)
    if path.suffix == ".rrd":
        yield path
    else:
        with TemporaryFolder() as folder:
            recording = folder / f"{path.stem}.rrd"
            _write_recording(_local_copy(path, folder) if is_remote(path) else path, recording)
            yield recording


def _local_copy(path: RemotePath, folder: Path) -> Path:
    """Download a result for the viewer's importer, which reads local files only. Raises InputError."""
    copy = folder / path.name
    try:
        copy.write_bytes(path.read_bytes())
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from problem
    return copy


def _check_result(path: AnyPath) -> None:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; name a .rrd or .mcap that geomphys replay wrote")
    if path.suffix == ".mcap":
        open_output(path)
    elif path.suffix != ".rrd":
        raise InputError(f"{path}: is neither a rerun recording (.rrd) nor an output log (.mcap)")


def uses_unix_time(output: OutputLog) -> bool:
    """Whether an output's times count from 1970 (dates in the viewer); otherwise they are durations."""
    return output.start_ns >= UNIX_TIME_START


def _write_recording(path: Path, recording: Path) -> None:
    """Write an output log as a rerun recording, with a layout made for it."""
    output = open_output(path)
    free_objects = _frames_of_objects(output.descriptions())
    positions: list[np.ndarray] = []
    static_triangles = np.zeros((0, 3, 3))
    for number, poses in enumerate(output.sample(64)):
        if number == 0:
            static_triangles = _static_triangles(output, poses)
        follows_tf = [name not in free_objects for name in poses.names]
        if number > 0:  # the first frame has the fixed objects too
            positions.append(poses.values[follows_tf if any(follows_tf) else slice(None), :3])
    points = np.concatenate(positions) if positions else np.zeros((0, 3))
    if len(points):  # shapes extend beyond the origins of their links
        margin = 0.04 + 0.1 * float(np.linalg.norm(np.ptp(points, axis=0)))
        points = np.concatenate([points - margin, points + margin])
    stream = RerunStream(recording, path.stem, path.stem)
    stream.send_output_log(path, uses_unix_time(output))
    stream.finish(output.metadata, mcap_blueprint(choose_viewpoint(points, static_triangles), output.joint_topics))


def _static_triangles(output: OutputLog, first: Poses) -> np.ndarray:
    """Triangles (n, 3, 3) of static bodies, which may occlude the motion; none if the scene's files are missing."""
    found = [np.zeros((0, 3, 3))]
    try:
        world = world_of_output(output)
    except InputError:
        return found[0]
    bodies, moving = world.scene.bodies, world.scene.trees.moving
    for body in np.flatnonzero((bodies.role == FIXED) & (moving[bodies.tree] == 0)):
        if world.frame_names[body] in first.names:
            vertices, faces = world.collision_triangles[body]
            pose = first.values[first.names.index(world.frame_names[body])]
            found.append((vertices @ rotation_from_quaternion(pose[3:]).T + pose[:3])[faces])
    return np.concatenate(found)


def _frames_of_objects(descriptions: dict[str, str]) -> set[str]:
    """Frame ids of the objects without a URDF; these may move far away."""
    texts = [text for topic, text in descriptions.items() if topic.strip("/").startswith("objects")]
    return {link.get("name", "") for text in texts for link in ElementTree.fromstring(text).iter("link")}
