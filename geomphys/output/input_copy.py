"""Copies the channels of the input log into the output, interleaved with the frames by time."""

from __future__ import annotations

from mcap.writer import Writer

from geomphys.recording.reader import RawMessage, open_log
from geomphys.storage.remote_files import AnyPath

PREFIX = "/input"


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
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}

    def copy_until(self, time: int, file: Writer) -> None:
        """Copy the messages logged up to `time` [ns]."""
        while self._next is not None and self._next.log_time <= time:
            self._copy(self._next, file)
            self._next = next(self._items, None)

    def close(self, file: Writer, copy_remaining: bool) -> None:
        """Close the log, after copying the remaining messages if `copy_remaining`."""
        while copy_remaining and self._next is not None:
            self._copy(self._next, file)
            self._next = next(self._items, None)
        self._reader.close()

    def _copy(self, message: RawMessage, file: Writer) -> None:
        channel = self._reader.channels[message.key]
        schema = (channel.schema_name, channel.schema_encoding, channel.schema_data)
        key = (channel.topic, channel.encoding, *schema)
        target = self._channels.get(key)
        if target is None:
            number = 0
            if channel.schema_name:
                number = self._schemas.get(schema, 0) or file.register_schema(*schema)
                self._schemas[schema] = number
            target = file.register_channel(PREFIX + channel.topic, channel.encoding, number, dict(channel.metadata))
            self._channels[key] = target
        file.add_message(target, message.log_time, message.data, message.publish_time, message.sequence)
