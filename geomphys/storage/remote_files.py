"""Paths that may be URLs (``s3://``, ``https://``, any protocol of fsspec): range reads with a block cache.

`AnyPath` is a local `Path` or a `RemotePath`, which has the methods of `Path` that the package uses. Only URLs given by
the user are opened: `as_path` converts command line and call arguments. Names inside a file are relative paths in or
below the folder of the file that the user named; they are never taken as URLs. fsspec is in the extra ``remote`` and is
imported for the first URL; its errors and those of its libraries become OSErrors here.

Why no `universal_pathlib`: of the 30 members of `RemotePath`, a `ProxyUPath` (the supported way to extend it) would
provide eight (names and comparison). The others must differ: joins there accept ``..`` and whole URLs, `exists` reports a
refusal as a missing file, `HTTPPath.resolve` asks the server, and errors of the libraries pass through.
"""

from __future__ import annotations

import errno
import os
import posixpath
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TypeAlias, cast

from geomphys.errors import InputError
from geomphys.storage.remote_stream import NO_RANGES, RangeStream, as_os_errors, without_credentials

if TYPE_CHECKING:
    from typing_extensions import TypeIs

BLOCK_BYTES = 2**20
"""Bytes per range request."""
MAX_CACHED_BLOCKS = 64
"""Blocks of an open file in its cache."""
SEQUENTIAL_BYTES = 8 * 2**20
"""Bytes per request of a sequential read."""

SILENCE_S = 30.0
"""s without a byte after which a server is given up."""

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z][A-Za-z0-9+.-]*)*://")
_INVALID_CHARACTERS = re.compile(r"[\x00-\x1f\x7f%?#\\]|://")
_WEB_PROTOCOLS = ("http", "https")


class Status(NamedTuple):
    """Size and kind of a file, as `os.stat` names them."""

    st_size: int
    st_mode: int
    st_ino: int = -1  # differ from those of every local file
    st_dev: int = -1
    st_mtime_ns: int = 0


def as_path(name: AnyPath | str) -> AnyPath:
    """Convert a user's path or URL.

    Parameters
    ----------
    name : str or path
        A path; ``file://`` and a path; or a URL of a kind that fsspec knows.

    Returns
    -------
    Path or RemotePath
        A `RemotePath` for a URL other than ``file://``.

    Raises
    ------
    InputError
        The extra ``remote`` is not installed, or what serves that kind of URL.
    """
    if is_remote(name):
        return name
    text = os.fspath(name)
    if not is_url(text):
        return Path(text)
    if text.lower().startswith("file://"):
        from urllib.parse import unquote

        return Path(unquote(text[7:]))
    return RemotePath(text)


def relative_path(path: AnyPath, folder: AnyPath) -> Path:
    """The path from a folder to a file in or below it; raises ValueError if it is not."""
    if is_remote(path):
        if not is_remote(folder) or not lies_within(path, folder):
            raise ValueError(f"{path} is not below {folder}")
        return Path(path.url.removeprefix(f"{folder.url}/"))
    if is_remote(folder):
        raise ValueError(f"{path} is not below {folder}")
    return path.relative_to(folder)


def lies_within(path: AnyPath, folder: AnyPath) -> bool:
    """Whether a path is a folder or lies below it, compared by name."""
    if is_remote(path) or is_remote(folder):
        return is_remote(path) and is_remote(folder) and f"{path.url}/".startswith(f"{folder.url}/")
    return path.is_relative_to(folder)


def is_url(text: str) -> bool:
    """Whether a text is a URL rather than a path: letters, a colon and two slashes at its beginning."""
    return _SCHEME.match(text) is not None


def is_remote(path: object) -> TypeIs[RemotePath]:
    """Whether a path is a URL."""
    return isinstance(path, RemotePath)


def open_sequential(path: AnyPath) -> BinaryIO:
    """Open a file to read it from start to end; raises OSError."""
    if is_remote(path):
        return path.open("rb", sequential=True)
    return path.open("rb")


class RemotePath:
    """A file or folder behind a URL.

    Parameters
    ----------
    url : str
    top : str, optional
        URL of the folder that confines all paths derived from this one; default: the file's own folder.
    """

    __slots__ = ("_fs", "_path_in_system", "top", "url")

    def __init__(self, url: str, top: str | None = None) -> None:
        self.url = url if url.endswith("://") else url.rstrip("/")
        self.top = top if top is not None else self.url.rpartition("/")[0]
        self._fs: Any = None
        self._path_in_system = ""

    def __reduce__(self) -> tuple[type[RemotePath], tuple[str, str]]:
        return RemotePath, (self.url, self.top)

    def __str__(self) -> str:
        """The URL without credentials, for messages and files."""
        return without_credentials(self.url)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RemotePath) and self.url == other.url

    def __lt__(self, other: RemotePath) -> bool:
        return self.url < other.url

    def __hash__(self) -> int:
        return hash(self.url)

    @property
    def name(self) -> str:
        """Last part of the URL."""
        return self.url.rpartition("/")[2]

    @property
    def stem(self) -> str:
        """The name without its ending."""
        return Path(self.name).stem

    @property
    def suffix(self) -> str:
        """Ending of the name, with its dot."""
        return Path(self.name).suffix

    @property
    def parent(self) -> RemotePath:
        """The folder; a server or bucket is its own parent."""
        above = self.url.rpartition("/")[0]
        return self if above.endswith(("/", ":")) else RemotePath(above, self.top)

    @property
    def parents(self) -> tuple[RemotePath, ...]:
        """The folders above, up to `top`."""
        found: list[RemotePath] = []
        folder = self.parent
        while folder.url.startswith(self.top) and folder not in found:
            found.append(folder)
            folder = folder.parent
        return tuple(found)

    def with_name(self, name: str) -> RemotePath:
        """The path with another name in the same folder."""
        return RemotePath(f"{self.parent.url}/{name}", self.top)

    def __truediv__(self, name: str | os.PathLike[str]) -> RemotePath:
        """A file below, by a relative path that stays within `top`; raises InputError otherwise."""
        text = os.fspath(name)
        scheme, sign, rest = self.url.partition("://")
        joined = posixpath.normpath(posixpath.join(rest, text))
        below = f"{scheme}{sign}{joined}"
        if (
            not text
            or text.startswith("/")
            or _INVALID_CHARACTERS.search(text)
            or not f"{below}/".startswith(f"{self.top}/")
        ):
            shown = "".join(c if c.isprintable() else "?" for c in text[:200])
            raise InputError(
                f"{self}: names the file {shown!r}; a file behind a URL may only name others in or below "
                f"{without_credentials(self.top)}, "
                "by a relative path"
            )
        return RemotePath(below, self.top)

    def resolve(self) -> RemotePath:
        """The path itself: URLs have no symbolic links."""
        return self

    def absolute(self) -> RemotePath:
        """The path itself: URLs are absolute."""
        return self

    def as_uri(self) -> str:
        """The URL without credentials: it goes into outputs."""
        return str(self)

    @property
    def lists(self) -> bool:
        """Whether folders can be listed: not on web servers."""
        return not self.url.lower().startswith(_WEB_PROTOCOLS)

    def stat(self) -> Status:
        """Size and kind; raises OSError."""
        with as_os_errors(self.url):
            found = self._system().info(self._path_in_system)
        kind = stat.S_IFDIR if found.get("type") == "directory" else stat.S_IFREG
        return Status(int(found.get("size") or 0), kind)

    def exists(self) -> bool:
        """Whether the path exists; raises OSError if the server does not say."""
        try:
            self.stat()
        except FileNotFoundError:
            return False
        return True

    def is_file(self) -> bool:
        """Whether it is a file."""
        try:
            return stat.S_ISREG(self.stat().st_mode)
        except FileNotFoundError:
            return False

    def is_dir(self) -> bool:
        """Whether it is a folder; False on web servers."""
        try:
            return self.lists and stat.S_ISDIR(self.stat().st_mode)
        except FileNotFoundError:
            return False

    def files(self) -> list[RemotePath]:
        """All files in and below a folder, sorted; raises OSError."""
        with as_os_errors(self.url):
            found = self._system().find(self._path_in_system)
        within = self._path_in_system.rstrip("/") + "/"
        return sorted(RemotePath(f"{self.url}/{name.removeprefix(within)}", self.top) for name in found)

    def rglob(self, pattern: str) -> Iterator[RemotePath]:
        """The files in and below a folder whose names fit the pattern."""
        return (file for file in self.files() if Path(file.name).match(pattern))

    def glob(self, pattern: str) -> Iterator[RemotePath]:
        """The files in a folder whose names fit the pattern."""
        return (file for file in self.rglob(pattern) if file.parent == self)

    def open(self, mode: str = "rb", *, sequential: bool = False) -> BinaryIO:
        """Open for reading, by range; `sequential`: it will be read from its beginning to its end. Raises OSError."""
        if mode != "rb":
            raise OSError(errno.EROFS, "can only be written as a whole", str(self))
        options: dict[str, Any] = {"block_size": SEQUENTIAL_BYTES, "cache_type": "readahead"}
        if not sequential:
            options = {
                "block_size": BLOCK_BYTES,
                "cache_type": "blockcache",
                "cache_options": {"maxblocks": MAX_CACHED_BLOCKS},
            }
        with as_os_errors(self.url):
            file = self._system().open(self._path_in_system, "rb", **options)
            if not sequential and not file.seekable():
                file.close()
                raise OSError(errno.ESPIPE, NO_RANGES, str(self))
        return cast(BinaryIO, RangeStream(file, self.url))

    def ranges(self, parts: Sequence[tuple[int, int]]) -> list[bytes]:
        """Read byte ranges [start, end) in one request batch; raises OSError."""
        starts, ends = [start for start, _ in parts], [end for _, end in parts]
        with as_os_errors(self.url):
            found = self._system().cat_ranges([self._path_in_system] * len(parts), starts, ends)
        for (start, end), data in zip(parts, found, strict=True):
            if len(data) != end - start:
                raise OSError(errno.ESPIPE, NO_RANGES, str(self))
        return list(found)

    def read_bytes(self) -> bytes:
        """The whole content; raises OSError."""
        with self.open(sequential=True) as stream:
            return stream.read()

    def read_text(self, encoding: str = "utf-8") -> str:
        """The whole content as text; raises OSError."""
        return self.read_bytes().decode(encoding)

    def put(self, source: Path) -> None:
        """Upload a local file, atomically; raises OSError."""
        with as_os_errors(self.url):
            self._system().put_file(os.fspath(source), self._path_in_system)

    def write_bytes(self, data: bytes) -> None:
        """Write the content, atomically; raises OSError."""
        with as_os_errors(self.url):
            self._system().pipe_file(self._path_in_system, data)

    def create(self, data: bytes) -> None:
        """Write a new file; FileExistsError if it exists, other OSErrors.

        Of two concurrent writers one gets the error, if the store has conditional writes (S3 does).
        """
        with as_os_errors(self.url):
            self._system().pipe_file(self._path_in_system, data, mode="create")

    def touch(self) -> None:
        """Write an empty file; raises OSError."""
        self.write_bytes(b"")

    def unlink(self, missing_ok: bool = False) -> None:
        """Remove the file; raises OSError."""
        try:
            with as_os_errors(self.url):
                self._system().rm_file(self._path_in_system)
        except FileNotFoundError:
            if not missing_ok:
                raise

    def mkdir(self, mode: int = 0o777, parents: bool = False, exist_ok: bool = False) -> None:
        """Does nothing: a folder behind a URL exists as soon as it contains a file."""

    def _system(self) -> Any:
        """The fsspec file system of the URL."""
        if self._fs is None:
            try:
                import fsspec.core
            except ImportError:
                raise InputError(f"{self}: is a URL; install geomphys[remote] to use URLs") from None
            try:
                self._fs, self._path_in_system = fsspec.core.url_to_fs(
                    self.url, use_listings_cache=False, **_time_limits(self.url)
                )
            except (ImportError, ValueError, TypeError) as problem:
                reason = without_credentials(" ".join(str(problem).split()))
                raise InputError(f"{self}: such a URL cannot be opened here ({reason})") from None
        return self._fs


def _time_limits(url: str) -> dict[str, Any]:
    """Options of a file system after which a server that says nothing is given up."""
    if url.lower().startswith(_WEB_PROTOCOLS):
        from aiohttp import ClientTimeout

        return {"client_kwargs": {"timeout": ClientTimeout(total=None, sock_connect=SILENCE_S, sock_read=SILENCE_S)}}
    if url.lower().startswith("s3://"):
        return {"config_kwargs": {"connect_timeout": SILENCE_S, "read_timeout": SILENCE_S}}
    return {}


AnyPath: TypeAlias = Path | RemotePath
"""A local path, or a file or folder behind a URL."""
