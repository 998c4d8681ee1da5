"""Reads an output log: metadata, frames as a stream, and columns of metrics and stage times."""

from __future__ import annotations

import errno
import math
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from numpy.typing import NDArray

from geomphys.errors import DamagedLogError, LogError
from geomphys.output.decoders import (
    METRICS,
    ContactRow,
    JointStateDecoder,
    JointValues,
    LogRow,
    PenetrationRow,
    Poses,
    StageRow,
    decode_contacts,
    decode_log,
    decode_metrics,
    decode_penetrations,
    decode_string,
    decode_timing,
    decode_transforms,
)
from geomphys.output.provenance import METADATA_RECORD, NON_PARAMETER_KEYS
from geomphys.recording.mcap_records import (
    CHUNK_LIMIT,
    HEAD,
    MESSAGE,
    BadRecordError,
    read_chunk_header,
    unpack_chunk,
    walk,
)
from geomphys.storage.remote_files import AnyPath, as_path

CHANNELS = ("/tf", "/recorded/tf", "joint_states", "/contacts", "/penetration", "/metrics", "/timing", "/log")
"""What `OutputLog.frames` can read; ``joint_states`` stands for those of every avatar."""

RECORD_LIMIT = 256 * 2**20
"""Bytes; longer records, such as large attachments, are refused."""

_DAMAGE = (
    BadRecordError, McapError, DecodeError, struct.error, ValueError, EOFError, KeyError, IndexError, RuntimeError,
    OverflowError, MemoryError,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class OutputFrame:
    """A frame of an output. Channels that were not requested or are not in the file are empty."""

    index: int
    """The frame's number in the replay."""
    time_ns: int
    tf: Poses
    """Corrected poses; the first frame has those of the fixed objects too."""
    recorded: Poses
    """As recorded; names carry the prefix ``recorded/``."""
    joints: dict[str, JointValues] = field(default_factory=dict)
    """Topic -> corrected joint values."""
    contacts: tuple[ContactRow, ...] = ()
    penetrations: tuple[PenetrationRow, ...] = ()
    metrics: dict[str, float] = field(default_factory=dict)
    timing: tuple[StageRow, ...] = ()
    log: tuple[LogRow, ...] = ()


class OutputMessage(NamedTuple):
    """A message of an output."""

    sequence: int
    log_time: int  # ns
    data: bytes


@dataclass(frozen=True)
class StageSeries:
    """A stage's times over a recording."""

    frames: NDArray[np.int64]  # (n,) row of the frame in `OutputLog.metrics`' columns
    ns: NDArray[np.int64]  # (n,)
    counts: NDArray[np.int64]  # (n,)


class OutputLog:
    """An output log on disk. Frames are streamed: memory does not grow with the file.

    Attributes
    ----------
    path : Path
    metadata : dict
        The record ``geomphys``; strings.
    topics : tuple of str
        Of all channels, in the order of the file.
    counts : dict
        Topic -> messages.
    start_ns, end_ns : int
        Log times of the first and last message of ``/tf`` and its like.
    """

    def __init__(self, path: AnyPath) -> None:
        self.path = path
        with self._reading() as (_, reader):
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                raise DamagedLogError(f"{path}: has no summary, so it was not closed; replay the log again")
            if reader.get_header().profile == "ros2":
                raise LogError(
                    f"{path}: is a bag for ROS 2 tools (--ros2), which has no metrics; replay without --ros2 for this command"
                )
            records = [dict(record.metadata) for record in reader.iter_metadata() if record.name == METADATA_RECORD]
        statistics = summary.statistics
        if not records:
            raise LogError(
                f"{path}: is no output of geomphys: it has no metadata record {METADATA_RECORD!r}; replay a log first, "
                "or audit it with --scene"
            )
        self.metadata: dict[str, str] = records[0]
        channels = sorted(summary.channels.items())
        self.topics: tuple[str, ...] = tuple(dict.fromkeys(channel.topic for _, channel in channels))
        self.counts: dict[str, int] = dict.fromkeys(self.topics, 0)
        for number, channel in channels:
            self.counts[channel.topic] += statistics.channel_message_counts.get(number, 0)
        self.start_ns: int = statistics.message_start_time
        self.end_ns: int = statistics.message_end_time
        self.joint_topics: tuple[str, ...] = tuple(
            t for t in self.topics if t.endswith("/joint_states") and not t.startswith("/input/")
        )

    @property
    def complete(self) -> bool:
        """Whether the replay that wrote it ran to its end."""
        return self.metadata.get("complete") == "true"

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return self.counts.get("/tf", 0)

    @property
    def parameters(self) -> dict[str, str]:
        """The parameters of the replay, `seed` among them, as the metadata has them."""
        return {key: value for key, value in self.metadata.items() if key not in NON_PARAMETER_KEYS}

    @property
    def intersection_volume_m3(self) -> float | None:
        """Volume common to the two bodies of the deepest recorded overlap; None if it is not known."""
        try:
            volume = float(self.metadata["intersection_volume_m3"])
        except KeyError:
            return None
        except ValueError:
            volume = math.nan
        if not (math.isfinite(volume) and volume >= 0.0):
            raise DamagedLogError(f"{self.path}: its metadata has no valid volume; replay the log again")
        return volume

    def attachments(self) -> dict[str, bytes]:
        """Name -> bytes of the attached files: the scene, the URDFs and the meshes."""
        with self._reading() as (_, reader):
            return {attachment.name: attachment.data for attachment in reader.iter_attachments()}

    def descriptions(self) -> dict[str, str]:
        """Topic -> URDF text of every robot description."""
        topics = [topic for topic in self.topics if topic.endswith("/robot_description")]
        with self._reading() as (stream, reader):
            return {topic: decode_string(m.data) for topic, m in self._messages(stream, reader, topics)}

    def frames(self, channels: Collection[str] = CHANNELS) -> Iterator[OutputFrame]:
        """The frames in order.

        Parameters
        ----------
        channels : collection of str
            Which of `CHANNELS` to decode; fewer are faster.

        Raises
        ------
        ValueError
            A channel is none of `CHANNELS`.
        DamagedLogError
            The file is damaged there.
        """
        unknown = set(channels) - set(CHANNELS)
        if unknown:
            raise ValueError(f"no such channel: {sorted(unknown)}; there are {CHANNELS}")
        requested = {topic for topic in channels if topic.startswith("/")} | {"/tf", "/metrics"}
        if "joint_states" in channels:
            requested.update(self.joint_topics)
        decoder = _FrameDecoder(frozenset(channels))
        pending: list[tuple[str, OutputMessage]] = []
        with self._reading() as (stream, reader):
            for topic, message in self._messages(stream, reader, requested):
                if topic == "/tf" and pending:  # every frame begins with /tf
                    yield decoder.decode(pending)
                    pending = []
                pending.append((topic, message))
            if pending:
                yield decoder.decode(pending)

    def sample(self, count: int) -> Iterator[Poses]:
        """Corrected poses of up to `count` frames, spread evenly over the time of the recording."""
        with self._reading() as (stream, reader):
            for time in np.linspace(self.start_ns, self.end_ns, count).astype(np.int64).tolist():
                for _, message in self._messages(stream, reader, ["/tf"], starting_at=time):
                    yield decode_transforms(message.data)
                    break

    def time_of(self, frame: int) -> int:
        """Time [ns] of the frame of that number; raises LogError if there is none."""
        last = None
        with self._reading() as (stream, reader):
            for _, message in self._messages(stream, reader, ["/metrics"]):
                last = int(decode_metrics(message.data)["frame"])
                if last == frame:
                    return message.log_time
        raise LogError(f"{self.path}: has no frame {frame}; its last one is {last}")

    def metrics(self) -> dict[str, NDArray[np.float64]]:
        """Columns (n,) of all metrics by name, and ``time_ns`` (int64): one row a frame."""
        rows: list[dict[str, float]] = []
        times: list[int] = []
        with self._reading() as (stream, reader):
            for _, message in self._messages(stream, reader, ["/metrics"]):
                rows.append(decode_metrics(message.data))
                times.append(message.log_time)
        columns = {name: np.array([row[name] for row in rows], np.float64) for name in METRICS}
        return {"time_ns": np.array(times, np.int64), **columns}

    def timing(self) -> dict[str, StageSeries]:
        """Stage name -> times, in the order in which stages first appear; empty if the file has none."""
        found: dict[str, tuple[list[int], list[int], list[int]]] = {}
        if "/timing" in self.topics:
            with self._reading() as (stream, reader):
                for row, (_, message) in enumerate(self._messages(stream, reader, ["/timing"])):
                    for name, ns, count in decode_timing(message.data):
                        rows, times, counts = found.setdefault(name, ([], [], []))
                        rows.append(row)
                        times.append(ns)
                        counts.append(count)
        return {
            name: StageSeries(*(np.array(column, np.int64) for column in columns)) for name, columns in found.items()
        }

    @staticmethod
    def _messages(
        stream: BinaryIO, reader: SeekingReader, topics: Collection[str], starting_at: int = 0
    ) -> Iterator[tuple[str, OutputMessage]]:
        """Topic and message, in the order of the file, of the chunks that hold any of the topics."""
        summary = reader.get_summary()
        if summary is None:
            raise BadRecordError("it has no summary")
        requested = {number: channel.topic for number, channel in summary.channels.items() if channel.topic in topics}
        for chunk in sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset):
            if chunk.message_end_time < starting_at or requested.keys().isdisjoint(chunk.message_index_offsets):
                continue
            stream.seek(chunk.chunk_start_offset)
            _, length = HEAD.unpack(stream.read(HEAD.size))
            if length > CHUNK_LIMIT:
                raise BadRecordError(f"a chunk of {length} bytes is longer than the limit of {CHUNK_LIMIT}")
            body = stream.read(length)
            head = read_chunk_header(body, length)
            data, damage = unpack_chunk(head, body[head.header_length : head.header_length + head.data_length])
            if damage:
                raise BadRecordError(f"the chunk at byte {chunk.chunk_start_offset} {damage}")
            for opcode, begin, end in walk(data):
                if opcode == Opcode.MESSAGE:
                    number, sequence, time, _ = MESSAGE.unpack_from(data, begin)
                    if number in requested and time >= starting_at:
                        yield requested[number], OutputMessage(sequence, time, data[begin + MESSAGE.size : end])

    @contextmanager
    def _reading(self) -> Iterator[tuple[BinaryIO, SeekingReader]]:
        """Open the file and a reader; errors in the block are raised as LogError."""
        try:
            with _opened(self.path) as stream:
                yield stream, SeekingReader(stream, record_size_limit=RECORD_LIMIT)
        except OSError as problem:
            raise LogError(f"{self.path}: cannot be read ({problem.strerror})") from problem
        except _DAMAGE as problem:
            raise DamagedLogError(
                f"{self.path}: is no MCAP file or a damaged one ({problem}); replay the log again"
            ) from problem


def _opened(path: AnyPath) -> BinaryIO:
    """Open a file to read it at any place; raises OSError, at once for a pipe that nobody writes to."""
    if isinstance(path, Path) and path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.ESPIPE, "it is no regular file", str(path))
    return path.open("rb")


def open_output(path: AnyPath | str) -> OutputLog:
    """Open an output log; raises LogError if it is none, DamagedLogError if it is damaged."""
    return OutputLog(as_path(path))


def is_output(path: AnyPath | str) -> bool:
    """Whether a file is MCAP with the metadata of an output; False for what cannot be read."""
    path = as_path(path)
    try:
        with _opened(path) as stream:
            reader = SeekingReader(stream, record_size_limit=RECORD_LIMIT)
            return any(record.name == METADATA_RECORD for record in reader.iter_metadata())
    except (OSError, *_DAMAGE):
        return False


class _FrameDecoder:
    """Assembles a frame from the messages between one /tf and the next."""

    def __init__(self, channels: frozenset[str]) -> None:
        self._channels = channels
        self._joints: dict[str, JointStateDecoder] = {}
        self._names: tuple[tuple[str, ...], ...] = ()  # names in the frame checked last

    def decode(self, messages: list[tuple[str, OutputMessage]]) -> OutputFrame:
        poses = {"/tf": _NO_POSES, "/recorded/tf": _NO_POSES}
        joints: dict[str, JointValues] = {}
        contacts: tuple[ContactRow, ...] = ()
        penetrations: tuple[PenetrationRow, ...] = ()
        metrics: dict[str, float] = {}
        timing: tuple[StageRow, ...] = ()
        log: list[LogRow] = []
        for topic, message in messages:
            data = message.data
            if topic in poses:
                if topic in self._channels:
                    poses[topic] = decode_transforms(data)
            elif topic == "/metrics":
                metrics = decode_metrics(data)
            elif topic == "/contacts":
                contacts = decode_contacts(data)
            elif topic == "/penetration":
                penetrations = decode_penetrations(data)
            elif topic == "/timing":
                timing = decode_timing(data)
            elif topic == "/log":
                log.append(decode_log(data))
            else:
                joints[topic] = self._joints.setdefault(topic, JointStateDecoder()).decode(data)
        first = messages[0][1]
        if not metrics:
            raise BadRecordError(f"the frame at {first.log_time} ns has no /metrics")
        names = (poses["/tf"].names, poses["/recorded/tf"].names)
        if self._names != names and all(topic in self._channels for topic in poses):
            unknown = {name.removeprefix("recorded/") for name in names[1]} - set(names[0])
            if unknown:
                raise BadRecordError(
                    f"the frame at {first.log_time} ns has recorded poses of bodies that have none in /tf"
                )
            self._names = names
        return OutputFrame(
            index=int(metrics.get("frame", first.sequence)),
            time_ns=first.log_time,
            tf=poses["/tf"],
            recorded=poses["/recorded/tf"],
            joints=joints,
            contacts=contacts,
            penetrations=penetrations,
            metrics=metrics if "/metrics" in self._channels else {},
            timing=timing,
            log=tuple(log),
        )


_NO_POSES = Poses((), np.zeros((0, 7)))
