"""Copies the channels of the input log into the output, interleaved with the frames by time."""

from __future__ import annotations

from collections.abc import Mapping

from geomphys.output.mcap_writer import McapWriter
from geomphys.recording.raw_messages import RawMessage
from geomphys.recording.reader import LogChannel, open_log
from geomphys.storage.remote_files import AnyPath

PREFIX = "/input"


class MessageCopy:
    """Writes messages of a log to one file as they are; channels and schemas are made there when they are needed.

    Parameters
    ----------
    channels : mapping
        Of the log, by their keys.
    prefix : str
        Of their topics in the file.
    """

    def __init__(self, channels: Mapping[int, LogChannel], prefix: str = "") -> None:
        self._log_channels, self._prefix = channels, prefix
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def add(self, message: RawMessage, file: McapWriter) -> None:
        """Write a message, with its original times; `file` is the same in every call."""
        channel = self._log_channels[message.key]
        schema = (channel.schema_name, channel.schema_encoding, channel.schema_data)
        key = (channel.topic, channel.encoding, *schema)
        target = self._channels.get(key)
        if target is None:
            number = 0
            if channel.schema_name:
                number = self._schemas.get(schema, 0) or file.register_schema(*schema)
                self._schemas[schema] = number
            target = file.register_channel(
                self._prefix + channel.topic, channel.encoding, number, dict(channel.metadata)
            )
            self._channels[key] = target
        file.add_message(target, message.log_time, message.data, message.publish_time, message.sequence)


class InputCopy:
    """Copies the messages of a log with their original times, under topics prefixed ``/input``.

    Messages are read in file order, chunk by chunk: memory does not grow with the log.

    Parameters
    ----------
    path : Path
        An MCAP file, a bag directory of them, or the URL of one.
    recover : bool
        Whether to copy the readable part of a damaged log; without it DamagedLogError is raised here.
    """

    def __init__(self, path: AnyPath, recover: bool) -> None:
        self._reader = open_log(path, recover=recover)
        self._items = self._reader.read(file_order=True)
        self._next = next(self._items, None)
        self._messages = MessageCopy(self._reader.channels, prefix=PREFIX)

    def copy_until(self, time: int, file: McapWriter) -> None:
        """Copy the messages logged up to `time` [ns]."""
        while self._next is not None and self._next.log_time <= time:
            self._messages.add(self._next, file)
            self._next = next(self._items, None)

    def close(self, file: McapWriter, copy_remaining: bool) -> None:
        """Close the log, after copying the remaining messages if `copy_remaining`."""
        while copy_remaining and self._next is not None:
            self._messages.add(self._next, file)
            self._next = next(self._items, None)
        self._reader.close()
