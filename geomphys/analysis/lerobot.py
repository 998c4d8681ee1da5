"""Exports a result as a LeRobot data set (format v3.0) of one episode, without images.

``observation.state`` and ``action`` hold the corrected joint values and root poses of all avatars, ``observation.recorded`` the
recorded ones, each with its names in ``meta/info.json``.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.joint_angles import RecordedJoints
from geomphys.analysis.tables import POSE
from geomphys.errors import LogError, OutputError
from geomphys.output.output_log import OutputFrame, OutputLog, open_output
from geomphys.output.output_world import world_of_output
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile, write_file
from geomphys.storage.remote_files import AnyPath, as_path, is_remote

VERSION = "v3.0"
UNEVEN = 0.25
"""Share of the frame interval by which a frame may be off the regular clock that the format asks for."""

_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_VECTORS = ("observation.state", "action", "observation.recorded")
_PLAIN = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def export_lerobot(
    output: AnyPath | str, folder: AnyPath | str, *, progress: Callable[[int, int | None], None] | None = None
) -> int:
    """Write the data set into a new folder; returns the number of frames.

    Raises
    ------
    LogError
        The file is no output, has no avatar, or its frames are not at a constant rate (replay with ``rate`` then).
    OutputError
        The folder is there already, or cannot be written.
    """
    log, target = open_output(output), as_path(folder)
    if target.exists():
        raise OutputError(f"{target}: exists already; name a new folder")
    world = world_of_output(log)
    if world.avatar_count == 0:
        raise LogError(f"{log.path}: has no avatar, whose state an episode could hold")
    corrected, recorded, times_ns = _states(log, world, progress)
    fps = _rate(log, times_ns)
    count = len(times_ns)
    columns: dict[str, NDArray[Any]] = {
        "observation.state": corrected,
        "action": corrected,
        "observation.recorded": recorded,
        "timestamp": (np.arange(count) / fps).astype(np.float32),
        "frame_index": np.arange(count),
        "episode_index": np.zeros(count, np.int64),
        "index": np.arange(count),
        "task_index": np.zeros(count, np.int64),
    }
    stats = {name: _statistics(values) for name, values in columns.items()}
    task = world.facts.name
    with _new_folder(target) as draft:
        for name in ("data/chunk-000", "meta/episodes/chunk-000"):
            (draft / name).mkdir(parents=True)
        _write_parquet(draft / _DATA.format(chunk_index=0, file_index=0), columns)
        _write_parquet(
            draft / "meta/tasks.parquet", {"task_index": np.zeros(1, np.int64), "task": np.array([task])}, index="task"
        )
        episode: dict[str, Any] = {
            "episode_index": 0, "tasks": [task], "length": count, "data/chunk_index": 0, "data/file_index": 0,
            "dataset_from_index": 0, "dataset_to_index": count, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        episode |= {f"stats/{name}/{key}": value for name, found in stats.items() for key, value in found.items()}
        _write_parquet(
            draft / "meta/episodes/chunk-000/file-000.parquet", {key: [value] for key, value in episode.items()}
        )
        write_file(draft / "meta/stats.json", _json(stats))
        write_file(draft / "meta/info.json", _json(_info(fps, count, _names(world))))
    return count


@contextmanager
def _new_folder(target: AnyPath) -> Iterator[AnyPath]:
    """A folder under a hidden name that gets its own at the end; nothing is left of it if an exception ends the block.

    Behind a URL, where there are no folders to be renamed, it is the target itself. A fork of this process ends nothing.
    """
    maker = os.getpid()
    draft = target if is_remote(target) else target.with_name(f".{target.name}.{secrets.token_hex(4)}.tmp")
    try:
        yield draft
        if isinstance(draft, Path):
            os.replace(draft, str(target))
    except OSError as problem:
        raise OutputError(f"{target}: cannot be made ({problem.strerror})") from problem
    finally:
        if isinstance(draft, Path) and os.getpid() == maker:
            shutil.rmtree(draft, ignore_errors=True)


def _states(
    log: OutputLog, world: World, progress: Callable[[int, int | None], None] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Corrected and recorded states (n, k), and times [ns]."""
    joints = RecordedJoints(log)
    rows: list[tuple[list[float], list[float]]] = []
    times: list[int] = []
    for frame in log.frames(["/tf", "/recorded/tf", "joint_states"]):
        rows.append(_state(frame, world, joints))
        times.append(frame.time_ns)
        if progress is not None:
            progress(len(times), log.frame_count)
    if not rows:
        raise LogError(f"{log.path}: holds no frame")
    corrected, recorded = (np.array([row[side] for row in rows], np.float32) for side in (0, 1))
    return corrected, recorded, np.array(times, np.int64)


def _state(frame: OutputFrame, world: World, joints: RecordedJoints) -> tuple[list[float], list[float]]:
    corrected: list[float] = []
    recorded: list[float] = []
    for tree in range(world.avatar_count):
        avatar = world.tree_names[tree]
        topic = "/joint_states" if world.avatar_count == 1 else f"/{avatar}/joint_states"
        names, values = frame.joints[topic]
        root = world.frame_names[world.scene.trees.body_start[tree]]
        corrected += [*values.tolist(), *frame.tf.values[frame.tf.names.index(root)].tolist()]
        recorded += joints.values(frame.recorded, avatar, names, values).tolist()
        recorded += frame.recorded.values[frame.recorded.names.index(f"recorded/{root}")].tolist()
    return corrected, recorded


def _names(world: World) -> list[str]:
    """Names of the numbers of a state: joints, then the pose of the root; prefixed by the avatar if there are several."""
    found: list[str] = []
    for tree in range(world.avatar_count):
        prefix = "" if world.avatar_count == 1 else f"{world.tree_names[tree]}/"
        start, end = world.scene.trees.dof_start[tree : tree + 2]
        found += [f"{prefix}{name}" for name in (*world.dof_names[start:end], *(f"root.{key}" for key in POSE))]
    return found


def _rate(log: OutputLog, times_ns: NDArray[np.int64]) -> float:
    """Frames a second; raises LogError if they are not at a constant rate."""
    if len(times_ns) < 2:
        return 30.0
    seconds = (times_ns - times_ns[0]) / 1e9
    interval = float(seconds[-1]) / (len(seconds) - 1)
    off = np.abs(seconds - interval * np.arange(len(seconds)))
    if off.max() > UNEVEN * interval:
        raise LogError(
            f"{log.path}: frame {int(off.argmax())} is {1e3 * off.max():.1f} ms off a constant rate, which a LeRobot episode "
            f"needs; replay with --rate {1.0 / interval:.0f}"
        )
    return round(1.0 / interval, 3)


def _statistics(values: NDArray[Any]) -> dict[str, list[float]]:
    table = np.asarray(values, np.float64).reshape(len(values), -1)
    found = {"min": table.min(axis=0), "max": table.max(axis=0), "mean": table.mean(axis=0), "std": table.std(axis=0)}
    return {key: value.tolist() for key, value in found.items()} | {"count": [len(table)]}


def _info(fps: float, frames: int, names: list[str]) -> dict[str, Any]:
    vectors = {name: {"dtype": "float32", "shape": [len(names)], "names": names} for name in _VECTORS}
    plain = {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in _PLAIN.items()}
    return {
        "codebase_version": VERSION, "robot_type": "geomphys", "total_episodes": 1, "total_frames": frames, "total_tasks": 1,
        "chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 500,
        "fps": int(fps) if fps == int(fps) else fps, "splits": {"train": "0:1"}, "data_path": _DATA, "video_path": None,
        "features": vectors | plain,
    }  # fmt: skip


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=2) + "\n").encode()


def _write_parquet(path: AnyPath, columns: dict[str, Any], index: str | None = None) -> None:
    """Write columns; rows of 2-D arrays become lists. `index` is the column that pandas takes for the index."""
    import pyarrow as pa
    from pyarrow import parquet

    arrays = {key: pa.array(list(v) if isinstance(v, np.ndarray) and v.ndim == 2 else v) for key, v in columns.items()}
    table = pa.table(arrays)
    if index is not None:
        columns_of_pandas = [
            {"name": key, "field_name": key, "pandas_type": "unicode" if key == index else "int64", "metadata": None,
             "numpy_type": "object" if key == index else "int64"}
            for key in columns
        ]  # fmt: skip
        described = {
            "index_columns": [index],
            "column_indexes": [],
            "columns": columns_of_pandas,
            "pandas_version": "2.2.0",
        }
        table = table.replace_schema_metadata({"pandas": json.dumps(described)})
    with OutputFile(path) as file:
        parquet.write_table(table, file.stream, compression="snappy")
