"""Writes the output log: an MCAP file with all channels of a replay, which Foxglove and the rerun viewer can open."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError, OutputError
from geomphys.output import frame_columns
from geomphys.output.attached_files import scene_files
from geomphys.output.byte_strings import ByteStrings
from geomphys.output.contact_arrows import frame_durations
from geomphys.output.encoders import (
    JOINT_STATE_DEFINITION,
    STRING_DEFINITION,
    ContactArrowsEncoder,
    ContactPointsEncoder,
    FrameEncoder,
    JointStateEncoder,
    TransformsEncoder,
    encode_string,
)
from geomphys.output.finite_check import first_non_finite
from geomphys.output.input_copy import InputCopy
from geomphys.output.mcap_writer import McapWriter, Messages
from geomphys.output.proto.geomphys_pb2 import Contacts, FrameMetrics, PenetrationDepths, Timing
from geomphys.output.provenance import METADATA_RECORD, Provenance
from geomphys.output.result_buffer import ResultBuffer
from geomphys.output.sink import ContextManaged
from geomphys.output.surface_encoder import encode_ghosts, encode_surfaces
from geomphys.output.urdf_description import descriptions
from geomphys.output.worst_moments import log_text
from geomphys.recording.stamps import WRITABLE_TIMES
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.arrays import DRIVEN, FIXED
from geomphys.scene.world import World
from geomphys.storage.output_file import OutputFile
from geomphys.storage.remote_files import AnyPath
from geomphys.version import __version__

_SHOWN_CONTACTS = ("/contacts/points", "/contacts/scene")
_PROTOBUF_CHANNELS: dict[str, type[Message]] = {
    "/meshes": SceneUpdate,
    "/recorded/meshes": SceneUpdate,
    "/tf": FrameTransforms,
    "/recorded/tf": FrameTransforms,
    "/contacts": Contacts,
    "/contacts/points": PointCloud,
    "/contacts/scene": SceneUpdate,
    "/penetration": PenetrationDepths,
    "/metrics": FrameMetrics,
    "/timing": Timing,
    "/log": Log,
}

BATCH_FRAMES = 512
"""Frames that are buffered and encoded together."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@cache
def _schema_of(topic: str) -> bytes:
    """The schema of a channel's messages: their file of descriptors, after those it depends on."""
    schema = FileDescriptorSet()
    for file in _with_dependencies(_PROTOBUF_CHANNELS[topic].DESCRIPTOR.file).values():
        file.CopyToProto(schema.file.add())
    data: bytes = schema.SerializeToString(deterministic=True)
    return data


def _with_dependencies(file: Any) -> dict[str, Any]:
    """A file of descriptors after those it depends on, by name."""
    found: dict[str, Any] = {}
    for needed in file.dependencies:
        found |= _with_dependencies(needed)
    return found | {file.name: file}


class Column(NamedTuple):
    """Messages of a topic, one in each of k rows of a batch."""

    topic: str
    rows: Ints  # (k,)
    data: ByteStrings


class McapSink(ContextManaged):
    """Writes the output log.

    The time of a frame is the log time, publish time and stamp of its messages; their sequence number is the frame's.
    ``/contacts``, ``/penetration`` and ``/metrics`` have a message every frame, ``/contacts/points`` and
    ``/contacts/scene`` one in frames with contacts, and an empty one after the last of them.

    Parameters
    ----------
    path : Path
        The file; it appears when complete, as ``STEM.partial.mcap`` if closed before.
    timing : bool
        Whether to write ``/timing``, the only channel that differs between two runs.
    force : bool
        Whether a file that is there may be replaced.
    copy_input : Path, optional
        A log whose channels are copied too, under topics prefixed ``/input``.

    Raises
    ------
    OutputError
        From `open`: the file exists, its folder does not. From `write`: a number is not finite, a time cannot be
        written (before 0 or after 2038), the disk is full.
    """

    profile = ""
    """Profile of the file, as MCAP calls it."""

    def __init__(
        self, path: AnyPath, *, timing: bool = True, force: bool = False, copy_input: AnyPath | None = None
    ) -> None:
        self._path = path
        self._timing = timing
        self._force = force
        self._input_path = copy_input
        self._output: OutputFile | None = None

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Begin the file; see `Sink.open`."""
        output = OutputFile(self._path, force=self._force, inputs=provenance.files, partial=True)
        self._world, self._provenance = world, provenance
        self._descriptions = descriptions(world)
        self._files = scene_files(world)
        self._input = InputCopy(self._input_path, config.recover) if self._input_path else None
        self._output = output
        self._file = McapWriter(output.stream)
        self._file.start(profile=self.profile, library=f"geomphys {__version__}")
        self._declare_channels()
        self._prepare_messages()
        self._buffer = ResultBuffer(BATCH_FRAMES)
        self._started = self._has_transforms = False
        self._volume: float | None = None  # m³, see `Provenance.record`
        self._time_before: int | None = None  # ns
        self._had_contacts = True  # so that a first frame without contacts writes empty messages

    def write(self, result: FrameResult) -> None:
        """Add a frame; see `Sink.write`."""
        self.write_columns(ResultColumns.of(result))

    def write_columns(self, columns: ResultColumns) -> None:
        """Add frames; see `ColumnSink.write_columns`."""
        if self._output is None:
            raise OutputError(f"{self._path}: a frame was written before the output was opened")
        good, error = self._first_error(columns)
        columns = columns.rows(0, good)
        for moment in (moment for moments in columns.moments.values() for moment in moments):
            self._volume = moment.volume_m3 if moment.kind == "recorded_penetration" else self._volume
        try:
            for batch in self._buffer.add(columns):
                self._write_batch(batch)
        except OSError as problem:
            raise self._output.error(problem) from problem
        if error is not None:
            raise error

    def _first_error(self, columns: ResultColumns) -> tuple[int, OutputError | None]:
        """Row of the first frame that cannot be written, and why; without one the number of frames, and None."""
        good, error = first_non_finite(columns, self._world.body_names) or (len(columns), None)
        for row, time in enumerate(columns.times_ns[:good].tolist()):
            if time not in WRITABLE_TIMES:
                return row, OutputError(
                    f"{self._path}: frame {columns.frames[row].index}: the time {time / 1e9} s cannot be written, it must "
                    "lie between 0 (1970) and 2**31 s (2038); shift the log's clock"
                )
        return good, error

    def close(self, complete: bool) -> None:
        """Finish the file and give it its name; see `Sink.close`."""
        if self._output is None:
            return
        output, self._output = self._output, None
        if not output.is_of_this_process:  # whose position in the copied log is shared too
            output.publish(complete)
            return
        log_error: LogError | None = None
        try:
            try:
                for batch in self._buffer.rest():
                    self._write_batch(batch)
            except LogError as problem:
                log_error, complete = problem, False
            if not self._started:
                self._write_static_messages(0)
            if self._input is not None:
                try:
                    self._input.close(self._file, copy_remaining=complete)
                except LogError as problem:
                    log_error, complete = problem, False
            record = self._provenance.record(complete=complete, intersection_volume_m3=self._volume)
            self._file.add_metadata(METADATA_RECORD, record)
            self._file.finish()
        except OSError as problem:
            output.discard()
            raise output.error(problem) from problem
        output.publish(complete)
        if log_error is not None:
            raise log_error

    def _write_batch(self, results: ResultColumns) -> None:
        """Write frames; all of them also where the input log cannot be copied, which is raised at the end."""
        times = results.times_ns
        if not self._started:
            self._write_static_messages(int(times[0]))
        columns = [*self._columns(results)]
        rows = np.concatenate([column.rows for column in columns])
        channels = np.repeat([self._channels[c.topic] for c in columns], [len(c.rows) for c in columns])
        data = [column.data for column in columns]
        numbers, stamps = results.indices[rows], times[rows]
        lines = list(self._lines(results))
        if lines:
            row, index, time, line = zip(*lines, strict=True)
            rows, channels = np.append(rows, row), np.append(channels, [self._channels["/log"]] * len(lines))
            numbers, stamps = np.append(numbers, index), np.append(stamps, time)
            data.append(ByteStrings.of(line))
        order = np.argsort(rows, kind="stable")
        rows, stamps = rows[order], stamps[order]
        in_order = Messages(channels[order], numbers[order], stamps, stamps, ByteStrings.joined(data)[order])
        if self._input is None:
            self._file.add_messages(in_order)
        else:
            self._write_with_input(self._input, times, rows, in_order)

    def _write_with_input(self, copied: InputCopy, times: Ints, rows: Ints, messages: Messages) -> None:
        """Write the messages of frames at times (n,), those of `rows` (k,), after what the input log has up to each."""
        log_error: LogError | None = None
        ends = np.searchsorted(rows, np.arange(len(times) + 1)).tolist()
        for time, (start, end) in zip(times.tolist(), pairwise(ends), strict=True):
            if log_error is None:
                try:
                    copied.copy_until(time, self._file)
                except LogError as problem:
                    log_error = problem
            self._file.add_messages(Messages._make(column[start:end] for column in messages))
        if log_error is not None:
            raise log_error

    def _columns(self, results: ResultColumns) -> Iterator[Column]:
        """Encode frames; the messages of a frame are in the order of the columns."""
        encoder, frames, times = self._frame_encoder, results.indices, results.times_ns
        contacts, pairs = frame_columns.all_contacts(results), frame_columns.all_penetrations(results)
        every = np.arange(len(results))
        touching = contacts.counts > 0
        shown = np.flatnonzero(touching | np.concatenate([[self._had_contacts], touching[:-1]]))
        self._had_contacts = bool(touching[-1])
        yield Column("/tf", every, self._encode_transforms(results.corrected, times))
        yield Column("/recorded/tf", every, self._recorded.encode(results.recorded[:, self._driven], times))
        yield from self._encode_joints(results)
        yield Column("/contacts", every, encoder.contacts(contacts, frames, times))
        for topic, data in (
            ("/contacts/points", self._points.encode(contacts, times)),
            ("/contacts/scene", self._arrows.encode(contacts, times, self._durations(times))),
        ):
            yield Column(topic, shown, data[shown])
        yield Column("/penetration", every, encoder.penetrations(pairs, frames, times))
        yield Column("/metrics", every, encoder.metrics(results.metrics, frames, times))
        if self._timing:
            stages = results.stages, results.stage_ns, results.stage_counts
            yield Column("/timing", every, encoder.timing(*stages, frames, times))

    def _lines(self, results: ResultColumns) -> Iterator[tuple[int, int, int, bytes]]:
        """Row, number of the frame, time [ns] and message of the log lines that follow the messages of the rows."""
        encoder = self._frame_encoder
        for row in sorted(results.messages.keys() | results.moments.keys()):
            frame = results.frames[row]
            for line in results.messages.get(row, ()):
                yield row, frame.index, frame.time_ns, encoder.log(*line, frame.time_ns)
            for m in results.moments.get(row, ()):
                yield row, m.frame, m.time_ns, encoder.log("info", log_text(m), m.time_ns)

    def _durations(self, times: Ints) -> Floats:
        """Durations (n,) [s] of the next frames."""
        durations = frame_durations(times, self._time_before)
        self._time_before = int(times[-1])
        return durations

    def _encode_transforms(self, corrected: Floats, times: Ints) -> ByteStrings:
        """/tf of frames (n, B, 7): in the first of all every body, then those that move."""
        whole = slice(0 if self._has_transforms else 1)
        first = self._first_transforms.encode(corrected[whole], times[whole])
        self._has_transforms = True
        rest = slice(len(first), None)
        return ByteStrings.joined([first, self._transforms.encode(corrected[rest, self._moving], times[rest])])

    def _encode_joints(self, results: ResultColumns) -> Iterator[Column]:
        """The joints of each avatar."""
        every = np.arange(len(results))
        for topic, encoder, start, end in self._joints:
            yield Column(topic, every, encoder.encode(results.angles[:, start:end], results.times_ns))

    def _write_message(self, topic: str, data: bytes, time: int) -> None:
        self._file.add_message(self._channels[topic], time, data, time)

    def _declare_channels(self) -> None:
        file, schemas = self._file, dict[str, int]()
        self._channels: dict[str, int] = {}
        string = file.register_schema("std_msgs/msg/String", "ros2msg", STRING_DEFINITION)
        for topic in self._descriptions:
            self._channels[topic] = file.register_channel(topic, "cdr", string)
        for topic, kind in _PROTOBUF_CHANNELS.items():
            if topic == "/timing" and not self._timing:
                continue
            name = kind.DESCRIPTOR.full_name
            if name not in schemas:
                schemas[name] = file.register_schema(name, "protobuf", _schema_of(topic))
            self._channels[topic] = file.register_channel(topic, "protobuf", schemas[name])
        joint_state = file.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE_DEFINITION)
        self._joints = self._joint_encoders()
        for topic, *_ in self._joints:
            self._channels[topic] = file.register_channel(topic, "cdr", joint_state)

    def _joint_encoders(self) -> list[tuple[str, JointStateEncoder, int, int]]:
        """Topic of each avatar's joints, its encoder, first column of its values and the column after the last."""
        world, found = self._world, []
        for tree in range(world.avatar_count):
            topic = "/joint_states" if world.avatar_count == 1 else f"/{world.tree_names[tree]}/joint_states"
            start, end = (int(column) for column in world.scene.trees.dof_start[tree : tree + 2])
            found.append((topic, JointStateEncoder(world.dof_names[start:end]), start, end))
        return found

    def _moving_bodies(self) -> NDArray[np.int64]:
        """Bodies whose pose is written every frame."""
        bodies, trees = self._world.scene.bodies, self._world.scene.trees
        return np.flatnonzero((bodies.role != FIXED) | (trees.moving[bodies.tree] != 0))

    def _prepare_messages(self) -> None:
        world = self._world
        self._moving = self._moving_bodies()
        self._driven: NDArray[np.int64] = np.flatnonzero(world.scene.bodies.role == DRIVEN)
        names = world.frame_names
        self._first_transforms = TransformsEncoder(names)
        self._transforms = TransformsEncoder([names[b] for b in self._moving])
        self._recorded = TransformsEncoder([f"recorded/{names[b]}" for b in self._driven])
        self._points = ContactPointsEncoder()
        self._arrows = ContactArrowsEncoder()
        self._frame_encoder = FrameEncoder(world.body_names)

    def _write_static_messages(self, time: int) -> None:
        """Write the robot descriptions, the display meshes and the attachments at the time of the first frame."""
        self._started = True
        for topic, text in self._descriptions.items():
            self._write_message(topic, encode_string(text), time)
        self._write_surfaces(time)
        for file in self._files:
            # the time of creation, 0, is not recorded
            self._file.add_attachment(0, time, file.name, file.media_type, file.data)

    def _write_surfaces(self, time: int) -> None:
        self._write_message("/meshes", encode_surfaces(self._world, time), time)
        self._write_message("/recorded/meshes", encode_ghosts(self._world, time), time)
