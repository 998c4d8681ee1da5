"""Wraps the rerun SDK's recording stream: writes columns to a file, in strict mode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import OutputError

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

Ints = NDArray[np.int64]

APPLICATION = "geomphys"
UNIX_TIME_START = 946_684_800_000_000_000
"""ns; times from here on (the year 2000) are shown as dates, earlier ones as durations of another clock."""

_FOOTER = b"RRF2FOOT"


class Times:
    """The timelines ``frame`` and ``time`` of a batch.

    Parameters
    ----------
    frames, times_ns : (n,) int64
    unix : bool
        Whether times count from 1970.
    """

    def __init__(self, frames: Ints, times_ns: Ints, unix: bool) -> None:
        self._frames = frames
        self._times = times_ns
        self._unix = unix

    def at(self, rows: Ints) -> list[Any]:
        """The time columns of some rows."""
        import rerun as rr

        times = self._times[rows]
        if self._unix:
            time = rr.TimeColumn("time", timestamp=times.astype("datetime64[ns]"))
        else:
            time = rr.TimeColumn("time", duration=times.astype("timedelta64[ns]"))
        return [rr.TimeColumn("frame", sequence=self._frames[rows]), time]


class RerunStream:
    """A rerun recording that goes to a file.

    The SDK by default reports misuse as warnings; here it raises.

    Parameters
    ----------
    path : Path
        The file; replaced if it is there.
    identity : str
        The recording's id: the viewer takes recordings of one id for the same.
    name : str
        Name shown in the viewer.

    Raises
    ------
    OutputError
        The file cannot be made.
    """

    def __init__(self, path: Path, identity: str, name: str) -> None:
        import rerun as rr

        self._path = path
        try:
            path.write_bytes(b"")
            with _strict():
                self._stream = rr.RecordingStream(APPLICATION, recording_id=identity, send_properties=False)
                self._stream.save(path)
                self._stream.send_recording_name(name)
        except (OSError, RuntimeError) as problem:
            raise OutputError(f"{path}: cannot be written ({problem})") from problem

    def log_static(self, path: Sequence[str], archetype: Any) -> None:
        """Log static (timeless) data."""
        with _strict():
            self._stream.log(_entity(path), archetype, static=True)

    def send(self, path: Sequence[str], times: Times, rows: Ints, columns: Any) -> None:
        """Send columns at some rows of a batch; without rows nothing is sent."""
        if len(rows):
            with _strict():
                self._stream.send_columns(_entity(path), times.at(rows), columns)

    def send_output_log(self, path: Path, unix: bool) -> None:
        """Send an output log as the viewer's own importer reads it; `unix` says whether its times count from 1970."""
        import rerun as rr

        with _strict():
            reader = rr.chunk.McapReader(path, timeline_type="timestamp_ns" if unix else "duration_ns")
            self._stream.send_chunks(reader.stream())

    def finish(self, properties: Mapping[str, str], view: Blueprint) -> None:
        """Write properties (under ``geomphys``) and blueprint, and end the file.

        Raises OutputError if the file is incomplete, for example because the disk is full.
        """
        import rerun as rr

        with _strict():
            self._stream.send_property(APPLICATION, rr.AnyValues(True, **properties))
            self._stream.send_blueprint(view)
            self._stream.flush()
            self._stream.disconnect()
        with self._path.open("rb") as file:
            file.seek(max(0, self._path.stat().st_size - 256))
            if _FOOTER not in file.read():
                raise OutputError(f"{self._path}: the recording could not be written to its end; is the disk full?")


def _entity(path: Sequence[str]) -> str:
    import rerun as rr

    return rr.new_entity_path(list(path))


@contextmanager
def _strict() -> Iterator[None]:
    """Turn on the SDK's strict mode in the block and restore the caller's setting."""
    import rerun as rr

    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
