"""Exports a result as tables, for pandas, polars, DuckDB and spreadsheets: poses, joints, contacts, metrics; Parquet or CSV.

Rows are sorted by frame. Lengths are m, angles rad, quaternions x y z w in the world frame; what an output does not have is
null. Rows are written as they are read, so memory does not grow with the length of a recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.joint_angles import RecordedJoints
from geomphys.errors import ConfigError, LogError, OutputError
from geomphys.output.decoders import METRICS
from geomphys.output.output_log import OutputFrame, OutputLog, open_output
from geomphys.output.output_world import world_of_output
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile, check_targets
from geomphys.storage.remote_files import AnyPath, as_path

if TYPE_CHECKING:
    import pyarrow as pa

FORMATS = ("parquet", "csv")

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
COLUMNS: dict[str, tuple[tuple[str, str], ...]] = {
    "poses": (
        ("time_ns", "int64"), ("frame", "int64"), ("body", "string"), *((name, "float64") for name in POSE),
        *((f"recorded_{name}", "float64") for name in POSE), ("contact_body", "string"),
    ),
    "joints": (
        ("time_ns", "int64"), ("frame", "int64"), ("avatar", "string"), ("joint", "string"), ("position", "float64"),
        ("recorded", "float64"),
    ),
    "contacts": (
        ("time_ns", "int64"), ("frame", "int64"), ("body_a", "string"), ("body_b", "string"), ("x", "float64"),
        ("y", "float64"), ("z", "float64"), ("nx", "float64"), ("ny", "float64"), ("nz", "float64"), ("depth", "float64"),
        ("normal_impulse", "float64"), ("tangential_impulse", "float64"),
    ),
    "metrics": (("time_ns", "int64"), *((name, "int64" if name in ("frame", "flags") else "float64") for name in METRICS)),
}  # fmt: skip
"""Table -> its columns and their types. `body` is the frame id in ``/tf``, `contact_body` the same body's name in `contacts`."""

_BATCH_FRAMES = 500


def export_tables(
    output: AnyPath | str,
    folder: AnyPath | str,
    *,
    file_format: str = "parquet",
    force: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> dict[str, int]:
    """Write the tables of `COLUMNS` as ``FOLDER/TABLE.parquet`` or ``.csv``; returns table -> rows.

    Parameters
    ----------
    output : Path or str
        The output log.
    folder : Path or str
        Is made if it is not there.
    file_format : {"parquet", "csv"}
    force : bool
        Whether tables that are there may be replaced.
    progress : callable, optional
        Called with the frames read and their number.

    Raises
    ------
    LogError, SceneError
        The file is no output, or its scene cannot be rebuilt.
    ConfigError
        `file_format` is neither.
    OutputError
        A table cannot be written.
    """
    if file_format not in FORMATS:
        raise ConfigError(f"file_format = {file_format!r}: expected {' or '.join(FORMATS)}")
    log, target = open_output(output), as_path(folder)
    world = world_of_output(log)
    paths = {table: target / f"{table}.{file_format}" for table in COLUMNS}
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{target}: cannot be made ({problem.strerror})") from problem
    check_targets(list(paths.values()), force=force, inputs=(log.path,))
    counts = dict.fromkeys(COLUMNS, 0)
    recorded = RecordedJoints(log)
    with ExitStack() as stack:
        files = {table: stack.enter_context(OutputFile(path, force=force)) for table, path in paths.items()}
        writers = {table: stack.enter_context(_writer(table, file, file_format)) for table, file in files.items()}
        for batch in _batches(log, progress):
            for table, rows in _rows(batch, log, world, recorded).items():
                counts[table] += len(rows["frame"])
                writers[table].write_table(_table(table, rows))
    return counts


def _writer(table: str, file: OutputFile, file_format: str) -> Any:
    """A writer of batches: a context manager with `write_table`."""
    schema = _schema(table)
    if file_format == "csv":
        from pyarrow import csv

        return csv.CSVWriter(file.stream, schema)
    from pyarrow import parquet

    return parquet.ParquetWriter(file.stream, schema, compression="zstd")


def _schema(table: str) -> pa.Schema:
    import pyarrow as pa

    return pa.schema([(name, pa.type_for_alias(kind)) for name, kind in COLUMNS[table]])


def _table(table: str, rows: dict[str, Any]) -> pa.Table:
    import pyarrow as pa

    schema = _schema(table)
    arrays = [pa.array(rows[field.name], field.type, from_pandas=True) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def _batches(log: OutputLog, progress: Callable[[int, int | None], None] | None) -> Iterator[list[OutputFrame]]:
    batch: list[OutputFrame] = []
    done = 0
    for frame in log.frames(["/tf", "/recorded/tf", "joint_states", "/contacts", "/metrics"]):
        batch.append(frame)
        done += 1
        if progress is not None:
            progress(done, log.frame_count)
        if len(batch) == _BATCH_FRAMES:
            yield batch
            batch = []
    if batch or not done:
        yield batch


def _rows(
    batch: Sequence[OutputFrame], log: OutputLog, world: World, recorded: RecordedJoints
) -> dict[str, dict[str, Any]]:
    """Table -> its columns for these frames."""
    return {
        "poses": _pose_rows(batch, log, world),
        "joints": _joint_rows(batch, world, recorded),
        "contacts": _contact_rows(batch),
        "metrics": {"time_ns": [f.time_ns for f in batch]} | {n: [f.metrics[n] for f in batch] for n in METRICS},
    }


def _times(batch: Sequence[OutputFrame], counts: Sequence[int]) -> dict[str, NDArray[np.int64]]:
    """Columns of time and frame, each repeated as often as the frame has rows."""
    return {
        "time_ns": np.repeat(np.array([f.time_ns for f in batch], np.int64), counts),
        "frame": np.repeat(np.array([f.index for f in batch], np.int64), counts),
    }


def _pose_rows(batch: Sequence[OutputFrame], log: OutputLog, world: World) -> dict[str, Any]:
    names = dict(zip(world.frame_names, world.body_names, strict=True))
    poses, recorded, bodies = [np.zeros((0, 7))], [np.zeros((0, 7))], list[str]()
    for frame in batch:
        poses.append(frame.tf.values)
        bodies += frame.tf.names
        known = {name.removeprefix("recorded/"): row for row, name in enumerate(frame.recorded.names)}
        rows = np.array([known.get(name, -1) for name in frame.tf.names], np.int64)
        values = np.concatenate([frame.recorded.values, np.full((1, 7), np.nan)])
        recorded.append(values[rows])
    if unknown := set(bodies) - set(names):
        raise LogError(f"{log.path}: {min(unknown)!r} in /tf is no body of its scene")
    corrected_values, recorded_values = np.concatenate(poses), np.concatenate(recorded)
    return {
        **_times(batch, [len(f.tf.names) for f in batch]),
        "body": bodies,
        **{name: corrected_values[:, column] for column, name in enumerate(POSE)},
        **{f"recorded_{name}": recorded_values[:, column] for column, name in enumerate(POSE)},
        "contact_body": [names[body] for body in bodies],
    }


def _joint_rows(batch: Sequence[OutputFrame], world: World, recorded: RecordedJoints) -> dict[str, Any]:
    avatars, joints, positions, values, counts = list[str](), list[str](), [np.zeros(0)], [np.zeros(0)], list[int]()
    for frame in batch:
        count = 0
        for topic, (names, corrected) in frame.joints.items():
            avatar = topic.strip("/").rpartition("/")[0] or world.tree_names[0]
            avatars += [avatar] * len(names)
            joints += names
            positions.append(corrected)
            values.append(recorded.values(frame.recorded, avatar, names, corrected))
            count += len(names)
        counts.append(count)
    return {
        **_times(batch, counts),
        "avatar": avatars,
        "joint": joints,
        "position": np.concatenate(positions),
        "recorded": np.concatenate(values),
    }


def _contact_rows(batch: Sequence[OutputFrame]) -> dict[str, Any]:
    rows = [row for frame in batch for row in frame.contacts]
    points, normals = (np.array([getattr(r, key) for r in rows], float).reshape(-1, 3) for key in ("point", "normal"))
    plain = ("body_a", "body_b", "depth", "normal_impulse", "tangential_impulse")
    return {
        **_times(batch, [len(frame.contacts) for frame in batch]),
        **{key: [getattr(row, key) for row in rows] for key in plain},
        **{name: points[:, column] for column, name in enumerate("xyz")},
        **{f"n{name}": normals[:, column] for column, name in enumerate("xyz")},
    }
