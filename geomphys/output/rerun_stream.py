"""Wraps the rerun SDK's recording stream: writes columns to a file, in strict mode."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

Ints = NDArray[np.int64]

APPLICATION = "geomphys"
UNIX_TIME_START = 946_684_800_000_000_000
"""ns; times from here on (the year 2000) are shown as dates, earlier ones as durations of another clock."""

_FOOTER = b"RRF2FOOT"
_INCOMPLETE = "the recording could not be written to its end"


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
        self._every = np.arange(len(frames))
        self._of_every: list[Any] | None = None

    def at(self, rows: Ints) -> list[Any]:
        """The time columns of some rows."""
        if not np.array_equal(rows, self._every):
            return self._columns(rows)
        if self._of_every is None:
            self._of_every = self._columns(rows)
        return self._of_every

    def _columns(self, rows: Ints) -> list[Any]:
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
        The file, which is there already; what it holds is replaced.
    identity : str
        The recording's id: the viewer takes recordings of one id for the same.
    name : str
        Name shown in the viewer.

    Raises
    ------
    OSError
        From all methods: the file cannot be written.
    """

    def __init__(self, path: Path, identity: str, name: str) -> None:
        import rerun as rr

        self._path = path
        with _strict(path):
            self._stream = rr.RecordingStream(APPLICATION, recording_id=identity, send_properties=False)
            self._stream.save(path)
            self._stream.send_recording_name(name)

    def log_static(self, path: Sequence[str], archetype: Any) -> None:
        """Log static (timeless) data."""
        with _strict(self._path):
            self._stream.log(_entity(path), archetype, static=True)

    def send(self, path: Sequence[str], times: Times, rows: Ints, columns: Any) -> None:
        """Send columns at some rows of a batch; without rows nothing is sent."""
        if len(rows):
            with _strict(self._path):
                self._stream.send_columns(_entity(path), times.at(rows), columns)

    def finish(self, properties: Mapping[str, str], view: Blueprint) -> None:
        """Write properties (under ``geomphys``) and blueprint, and end the file.

        OSError too if the file is incomplete: the SDK's own thread writes and does not report every error.
        """
        import rerun as rr

        with _strict(self._path):
            self._stream.send_property(APPLICATION, rr.AnyValues(True, **properties))
            self._stream.send_blueprint(view)
            self._stream.flush()
            self._stream.disconnect()
        with self._path.open("rb") as file:
            file.seek(max(0, self._path.stat().st_size - 256))
            if _FOOTER not in file.read():
                raise OSError(errno.EIO, _INCOMPLETE, str(self._path))


def _entity(path: Sequence[str]) -> str:
    import rerun as rr

    return rr.new_entity_path(list(path))


@contextmanager
def _strict(path: Path) -> Iterator[None]:
    """Turn on the SDK's strict mode in the block and restore the caller's setting; its errors become OSErrors."""
    import rerun as rr

    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    except RuntimeError as problem:
        raise OSError(errno.EIO, _INCOMPLETE, str(path)) from problem
    finally:
        rr.set_strict_mode(before)
