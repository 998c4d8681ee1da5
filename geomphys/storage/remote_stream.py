"""Streams of files behind URLs; errors of fsspec and the libraries below it become OSErrors of one line."""

from __future__ import annotations

import errno
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from geomphys.errors import InputError

NO_RANGES = "the server gives no parts of files; fetch the file first"
"""Error text for a server that ignores range requests."""


_SILENT = "the server does not answer in time; try again"

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*://)([^\s/?#@'\"<>]*@)?([^\s?'\"<>)]*)(\?[^\s'\"<>)]*)?")


def without_credentials(text: str) -> str:
    """A text whose URLs show neither user and password nor a query, which may hold a key: ``https://…@host/file?…``."""
    return _URL.sub(lambda m: f"{m[1]}{'…@' if m[2] else ''}{m[3]}{'?…' if m[4] else ''}", text)


def _one_line(problem: BaseException) -> str:
    """The text of an error of a library, which may name the whole URL."""
    return without_credentials(" ".join(str(problem).split()))


class RangeStream(io.BufferedIOBase):
    """A binary stream over a file of fsspec; its errors are OSErrors."""

    def __init__(self, file: Any, url: str) -> None:
        self._file, self._url = file, url

    def readable(self) -> bool:
        """True."""
        return True

    def seekable(self) -> bool:
        """Whether range requests work."""
        return bool(self._file.seekable())

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to an offset; raises OSError."""
        with as_os_errors(self._url):
            return int(self._file.seek(offset, whence))

    def tell(self) -> int:
        """Current offset."""
        return int(self._file.tell())

    def read(self, size: int | None = -1) -> bytes:
        """Read from the current offset; raises OSError."""
        with as_os_errors(self._url):
            return bytes(self._file.read(-1 if size is None else size))

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer; raises OSError."""
        data = self.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        """Close the file."""
        if not self.closed:
            self._file.close()
        super().close()


@contextmanager
def as_os_errors(url: str) -> Iterator[None]:
    """Convert errors within the block to OSErrors of one line with the URL, without credentials, as file name."""
    url = without_credentials(url)
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError as problem:
        cause = problem.__cause__
        if _status(cause) not in (None, 404, 410):  # fsspec reports every refusal as a missing file
            raise _refused(cause, url) from problem
        if isinstance(cause, TimeoutError):
            raise TimeoutError(errno.ETIMEDOUT, _SILENT, url) from problem
        if isinstance(cause, OSError) and not isinstance(
            cause, FileNotFoundError
        ):  # fsspec reports it as a missing file
            raise OSError(cause.errno or errno.EIO, _one_line(cause), url) from problem
        raise FileNotFoundError(errno.ENOENT, "there is no such file", url) from None
    except PermissionError:
        raise PermissionError(errno.EACCES, "access is refused; are the credentials set?", url) from None
    except FileExistsError:
        raise FileExistsError(errno.EEXIST, "is there already", url) from None
    except TimeoutError as problem:
        raise TimeoutError(errno.ETIMEDOUT, _SILENT, url) from problem
    except OSError as problem:
        text = without_credentials(problem.strerror or "") or _one_line(problem) or type(problem).__name__
        raise OSError(problem.errno or errno.EIO, text, url) from problem
    except _foreign_errors() as problem:
        if _status(problem) is not None:
            raise _refused(problem, url) from problem
        if "range requests" in str(problem):
            raise OSError(errno.ESPIPE, NO_RANGES, url) from problem
        text = _one_line(problem) or type(problem).__name__
        raise OSError(errno.EIO, text, url) from problem


def _status(problem: BaseException | None) -> int | None:
    """HTTP status of an error response; None for other errors."""
    status = getattr(problem, "status", None)
    return status if isinstance(status, int) and status >= 400 else None


def _refused(problem: BaseException | None, url: str) -> OSError:
    """OSError for an HTTP error response."""
    status = _status(problem)
    if status in (401, 403, 407):
        return PermissionError(errno.EACCES, f"access is refused (HTTP {status}); are the credentials set?", url)
    if status in (404, 410):
        return FileNotFoundError(errno.ENOENT, "there is no such file", url)
    if status == 429 or (status is not None and status >= 500):
        return OSError(errno.EIO, f"the server has trouble (HTTP {status}); try again later", url)
    return OSError(errno.EIO, f"the server refuses (HTTP {status})", url)


def _foreign_errors() -> tuple[type[Exception], ...]:
    """Exceptions of fsspec and the libraries below it besides OSError; imported only after an error."""
    found: list[type[Exception]] = [ValueError, NotImplementedError, RuntimeError, TypeError]
    try:
        from aiohttp import ClientError

        found.append(ClientError)
    except ImportError:
        pass
    try:
        from botocore.exceptions import BotoCoreError
        from botocore.exceptions import ClientError as BotoClientError

        found += [BotoCoreError, BotoClientError]
    except ImportError:
        pass
    return tuple(found)
