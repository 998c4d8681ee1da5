"""Copies a log's channels into the output, message by message, beside the frames they led to."""

from __future__ import annotations

import struct
from collections.abc import Generator
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader

from geomphys.errors import DamagedLogError, LogError
from geomphys.sinks.mcap_file import McapFile

PREFIX = "/input"
_DAMAGE = (McapError, struct.error, zstandard.ZstdError, ValueError, EOFError, RuntimeError)

_Item = tuple[Schema | None, Channel, Message]


class InputCopy:
    """Feeds the messages of a log to an output, with their own times, under topics prefixed ``/input``.

    Messages are taken in the order of the file, one at a time: memory does not grow with the log.

    Parameters
    ----------
    path : Path
        An MCAP file, or a bag directory of them.
    recover : bool
        Whether a damaged log is copied as far as it can be read; without it DamagedLogError is raised there.
    """

    def __init__(self, path: Path, recover: bool) -> None:
        self._recover = recover
        self._items = _messages(path, recover)
        self._next = next(self._items, None)
        self._channels: dict[tuple[str, str, str, bytes, str], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def copy_until(self, time: int, file: McapFile) -> None:
        """Copy the messages logged up to `time` [ns]."""
        while self._next is not None and self._next[2].log_time <= time:
            self._copy(*self._next, file)
            self._next = next(self._items, None)

    def close(self, file: McapFile, rest: bool) -> None:
        """Stop; with `rest` the remaining messages are copied first."""
        while rest and self._next is not None:
            self._copy(*self._next, file)
            self._next = next(self._items, None)
        self._items.close()

    def _copy(self, schema: Schema | None, channel: Channel, message: Message, file: McapFile) -> None:
        name, encoding, data = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
        key = (channel.topic, channel.message_encoding, name, data, encoding)
        target = self._channels.get(key)
        if target is None:
            schema_id = 0
            if schema is not None:
                schema_id = self._schemas.get((name, encoding, data), 0) or file.add_schema(name, encoding, data)
                self._schemas[name, encoding, data] = schema_id
            target = file.add_channel(PREFIX + channel.topic, channel.message_encoding, schema_id, channel.metadata)
            self._channels[key] = target
        file.add_message(target, message.log_time, message.data, message.sequence, message.publish_time)


def _messages(path: Path, recover: bool) -> Generator[_Item, None, None]:
    """Schema, channel and message in the order of the file; of a bag directory file after file."""
    for part in sorted(path.rglob("*.mcap")) if path.is_dir() else [path]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        try:
            with part.open("rb") as stream:
                for record in StreamReader(stream).records:
                    if isinstance(record, Message):
                        channel = channels[record.channel_id]
                        yield schemas.get(channel.schema_id), channel, record
                    elif isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = record
                    elif isinstance(record, DataEnd):
                        break
        except OSError as problem:
            raise LogError(f"{part}: cannot be read for copying ({problem.strerror})") from problem
        except (*_DAMAGE, KeyError) as problem:
            if not recover:
                raise DamagedLogError(f"{part}: is damaged and cannot be copied whole; use --recover") from problem
