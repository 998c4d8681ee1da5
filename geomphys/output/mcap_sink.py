"""Writes the output log: an MCAP file with all channels of a replay, which Foxglove and the rerun viewer can open."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError, OutputError
from geomphys.output import frame_columns
from geomphys.output.attached_files import scene_files
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


class FrameMessage(NamedTuple):
    """A message of the output that is not in the file yet."""

    topic: str
    frame: int
    time_ns: int
    data: bytes


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
        self._file = Writer(output.stream)
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
            self._file.finish()  # type: ignore[no-untyped-call]
        except OSError as problem:
            output.discard()
            raise output.error(problem) from problem
        output.publish(complete)
        if log_error is not None:
            raise log_error

    def _write_batch(self, results: ResultColumns) -> None:
        """Write frames; all of them also where the input log cannot be copied, which is raised at the end."""
        log_error: LogError | None = None
        times = results.times_ns.tolist()
        if not self._started:
            self._write_static_messages(times[0])
        for of_frame, time in zip(self._messages(results), times, strict=True):
            if self._input is not None and log_error is None:
                try:
                    self._input.copy_until(time, self._file)
                except LogError as problem:
                    log_error = problem
            for message in of_frame:
                self._add(message)
        if log_error is not None:
            raise log_error

    def _messages(self, results: ResultColumns) -> Iterator[list[FrameMessage]]:
        """Encode frames; yields the messages of each."""
        encoder, frames, times = self._frame_encoder, results.indices, results.times_ns
        contacts, pairs = frame_columns.all_contacts(results), frame_columns.all_penetrations(results)
        columns = [
            ("/tf", self._encode_transforms(results.corrected, times)),
            ("/recorded/tf", self._recorded.encode(results.recorded[:, self._driven], times)),
            *self._encode_joints(results, times),
            ("/contacts", encoder.contacts(contacts, frames, times)),
            ("/contacts/points", self._points.encode(contacts, times)),
            ("/contacts/scene", self._arrows.encode(contacts, times, self._durations(times))),
            ("/penetration", encoder.penetrations(pairs, frames, times)),
            ("/metrics", encoder.metrics(results.metrics, frames, times)),
        ]
        if self._timing:
            stages = results.stages, results.stage_ns, results.stage_counts
            columns.append(("/timing", encoder.timing(*stages, frames, times)))
        rows = zip(frames.tolist(), times.tolist(), contacts.counts.tolist(), strict=True)
        for row, (index, time, touching) in enumerate(rows):
            is_shown = touching or self._had_contacts
            self._had_contacts = touching > 0
            found = [
                FrameMessage(topic, index, time, data[row])
                for topic, data in columns
                if is_shown or topic not in _SHOWN_CONTACTS
            ]
            lines = results.messages.get(row, ())
            found += [FrameMessage("/log", index, time, encoder.log(*line, time)) for line in lines]
            found += [
                FrameMessage("/log", m.frame, m.time_ns, encoder.log("info", log_text(m), m.time_ns))
                for m in results.moments.get(row, ())
            ]
            yield found

    def _durations(self, times: Ints) -> Floats:
        """Durations (n,) [s] of the next frames."""
        durations = frame_durations(times, self._time_before)
        self._time_before = int(times[-1])
        return durations

    def _encode_transforms(self, corrected: Floats, times: Ints) -> list[bytes]:
        """/tf of frames (n, B, 7): in the first of all every body, then those that move."""
        first = [] if self._has_transforms else self._first_transforms.encode(corrected[:1], times[:1])
        self._has_transforms = True
        rest = slice(len(first), None)
        return first + self._transforms.encode(corrected[rest, self._moving], times[rest])

    def _encode_joints(self, results: ResultColumns, times: Ints) -> Iterator[tuple[str, list[bytes]]]:
        """Topic and messages of the joints of each avatar."""
        for topic, encoder, start, end in self._joints:
            yield topic, encoder.encode(results.angles[:, start:end], times)

    def _add(self, message: FrameMessage) -> None:
        channel, time = self._channels[message.topic], message.time_ns
        self._file.add_message(channel, time, message.data, time, message.frame & 0xFFFFFFFF)

    def _write_message(self, topic: str, data: bytes, time: int) -> None:
        self._add(FrameMessage(topic, 0, time, data))

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
                data = build_file_descriptor_set(kind).SerializeToString(deterministic=True)
                schemas[name] = file.register_schema(name, "protobuf", data)
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
