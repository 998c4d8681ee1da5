"""Files behind URLs (``s3://``, ``https://``, whatever fsspec knows), read by range, with the part of `Path` used here.

Only what the user names is opened: `as_path` makes a place of a URL on the command line or in a call, and a name that
stands in a file is taken as a path below the folder of the file that the user named, never as a URL. fsspec is in the
extra ``remote``; it is imported where the first URL is met, and what it and its libraries raise becomes OSError here.
"""

from __future__ import annotations

import errno
import os
import posixpath
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeGuard, cast

from geomphys.errors import InputError
from geomphys.storage.remote_stream import NO_RANGES, RangeStream, as_os_errors

BLOCK = 2**20
"""Bytes that are asked for at once."""
BLOCKS = 64
"""Blocks of an open file that are kept, so that what is read again soon is not asked for again."""
STREAMED = 8 * 2**20
"""Bytes that are asked for at once of a file that is read from its beginning to its end."""

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z][A-Za-z0-9+.-]*)*://")
_UNUSABLE = re.compile(r"[\x00-\x1f\x7f%?#\\]|://")
_WEB = ("http", "https")


class Status(NamedTuple):
    """What is known of a file before it is read."""

    st_size: int
    st_mode: int
    st_ino: int = -1  # no local file has these two
    st_dev: int = -1
    st_mtime_ns: int = 0


def as_path(name: str | os.PathLike[str]) -> Path:
    """The place a user named: a local path, or a file or folder behind a URL.

    Parameters
    ----------
    name : str or path
        A path; ``file://`` and a path; or a URL of a kind that fsspec knows.

    Returns
    -------
    Path
        For a URL a `RemotePath`, which does what is asked of a path here.

    Raises
    ------
    InputError
        The extra ``remote`` is not installed, or what serves that kind of URL.
    """
    if is_remote(name):
        return cast(Path, name)
    text = os.fspath(name)
    if not is_url(text):
        return Path(text)
    if text.lower().startswith("file://"):
        from urllib.parse import unquote

        return Path(unquote(text[7:]))
    return cast(Path, RemotePath(text))


def is_url(text: str) -> bool:
    """Whether a text is a URL rather than a path: letters, a colon and two slashes at its beginning."""
    return _SCHEME.match(text) is not None


def is_remote(path: object) -> TypeGuard[RemotePath]:
    """Whether a place lies behind a URL."""
    return isinstance(path, RemotePath)


def open_sequential(path: Path) -> BinaryIO:
    """Open a place to read it from its beginning to its end; raises OSError."""
    if is_remote(path):
        return path.open("rb", sequential=True)
    return path.open("rb")


def move(source: Path, target: Path) -> None:
    """Give a finished local file its name, at once, or send it behind a URL and remove it; raises OSError."""
    if is_remote(target):
        target.put(source)
        source.unlink()
    else:
        os.replace(source, target)


class RemotePath:
    """A file or folder behind a URL.

    Parameters
    ----------
    url : str
    top : str, optional
        Folder in which all that is reached from here lies; by default that of the file itself.
    """

    __slots__ = ("_fs", "_inside", "top", "url")

    def __init__(self, url: str, top: str | None = None) -> None:
        self.url = url if url.endswith("://") else url.rstrip("/")
        self.top = top if top is not None else self.url.rpartition("/")[0]
        self._fs: Any = None
        self._inside = ""

    def __reduce__(self) -> tuple[type[RemotePath], tuple[str, str]]:
        return RemotePath, (self.url, self.top)

    def __str__(self) -> str:
        return self.url

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
        """The folder; that of a server or bucket is itself."""
        above = self.url.rpartition("/")[0]
        return self if above.endswith(("/", ":")) else RemotePath(above, self.top)

    @property
    def parents(self) -> tuple[RemotePath, ...]:
        """The folders above, up to the top."""
        found: list[RemotePath] = []
        folder = self.parent
        while folder.url.startswith(self.top) and folder not in found:
            found.append(folder)
            folder = folder.parent
        return tuple(found)

    def with_name(self, name: str) -> RemotePath:
        """Another name in the same folder."""
        return RemotePath(f"{self.parent.url}/{name}", self.top)

    def __truediv__(self, name: str | os.PathLike[str]) -> RemotePath:
        """A file below, by a relative path that stays within `top`; raises InputError otherwise."""
        text = os.fspath(name)
        scheme, sign, rest = self.url.partition("://")
        joined = posixpath.normpath(posixpath.join(rest, text))
        below = f"{scheme}{sign}{joined}"
        if not text or text.startswith("/") or _UNUSABLE.search(text) or not f"{below}/".startswith(f"{self.top}/"):
            shown = "".join(c if c.isprintable() else "?" for c in text[:200])
            raise InputError(
                f"{self.url}: names the file {shown!r}; a file behind a URL may only name others in or below {self.top}, "
                "by a relative path"
            )
        return RemotePath(below, self.top)

    def resolve(self) -> RemotePath:
        """Itself: a URL has no links."""
        return self

    def absolute(self) -> RemotePath:
        """Itself: a URL is absolute."""
        return self

    def is_relative_to(self, other: Path | RemotePath) -> bool:
        """Whether it is `other` or lies below it."""
        return isinstance(other, RemotePath) and f"{self.url}/".startswith(f"{other.url}/")

    def relative_to(self, other: RemotePath) -> Path:
        """The path from `other` to it."""
        return Path(self.url.removeprefix(f"{other.url}/"))

    def as_uri(self) -> str:
        """The URL."""
        return self.url

    def samefile(self, other: Path | RemotePath) -> bool:
        """Whether the other is the same URL."""
        return self == other

    @property
    def lists(self) -> bool:
        """Whether folders can be listed there; a web server's cannot."""
        return not self.url.lower().startswith(_WEB)

    def stat(self) -> Status:
        """Size and kind; raises OSError."""
        with as_os_errors(self.url):
            found = self._system().info(self._inside)
        kind = stat.S_IFDIR if found.get("type") == "directory" else stat.S_IFREG
        return Status(int(found.get("size") or 0), kind)

    def exists(self) -> bool:
        """Whether there is something; raises OSError if that cannot be found out."""
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
        """Whether it is a folder, where there are folders."""
        try:
            return self.lists and stat.S_ISDIR(self.stat().st_mode)
        except FileNotFoundError:
            return False

    def files(self) -> list[RemotePath]:
        """All files in and below a folder, sorted; raises OSError."""
        with as_os_errors(self.url):
            found = self._system().find(self._inside)
        within = self._inside.rstrip("/") + "/"
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
            raise OSError(errno.EROFS, "can only be written as a whole", self.url)
        options: dict[str, Any] = {"block_size": STREAMED, "cache_type": "readahead"}
        if not sequential:
            options = {"block_size": BLOCK, "cache_type": "blockcache", "cache_options": {"maxblocks": BLOCKS}}
        with as_os_errors(self.url):
            file = self._system().open(self._inside, "rb", **options)
            if not sequential and not file.seekable():
                file.close()
                raise OSError(errno.ESPIPE, NO_RANGES, self.url)
        return cast(BinaryIO, RangeStream(file, self.url))

    def ranges(self, parts: Sequence[tuple[int, int]]) -> list[bytes]:
        """Parts of the file, each from a first byte to before a last one, asked for at once; raises OSError."""
        starts, ends = [start for start, _ in parts], [end for _, end in parts]
        with as_os_errors(self.url):
            found = self._system().cat_ranges([self._inside] * len(parts), starts, ends)
        for (start, end), data in zip(parts, found, strict=True):
            if len(data) != end - start:
                raise OSError(errno.ESPIPE, NO_RANGES, self.url)
        return list(found)

    def read_bytes(self) -> bytes:
        """The whole content; raises OSError."""
        with self.open(sequential=True) as stream:
            return stream.read()

    def read_text(self, encoding: str = "utf-8") -> str:
        """The whole content as text; raises OSError."""
        return self.read_bytes().decode(encoding)

    def put(self, source: Path) -> None:
        """Make a local file the content, at once; raises OSError."""
        with as_os_errors(self.url):
            self._system().put_file(os.fspath(source), self._inside)

    def write_bytes(self, data: bytes) -> None:
        """Make bytes the content, at once; raises OSError."""
        with as_os_errors(self.url):
            self._system().pipe_file(self._inside, data)

    def create(self, data: bytes) -> None:
        """Make bytes the content of a file that is not there yet; FileExistsError if it is, other OSErrors.

        Of two that do so at once one has the error, if the store knows conditional writes (S3 does).
        """
        with as_os_errors(self.url):
            self._system().pipe_file(self._inside, data, mode="create")

    def touch(self) -> None:
        """Make an empty file; raises OSError."""
        self.write_bytes(b"")

    def unlink(self, missing_ok: bool = False) -> None:
        """Remove the file; raises OSError."""
        try:
            with as_os_errors(self.url):
                self._system().rm_file(self._inside)
        except FileNotFoundError:
            if not missing_ok:
                raise

    def mkdir(self, mode: int = 0o777, parents: bool = False, exist_ok: bool = False) -> None:
        """Nothing: a folder behind a URL is there as soon as a file is in it."""

    def _system(self) -> Any:
        """The file system of the URL."""
        if self._fs is None:
            try:
                import fsspec.core
            except ImportError:
                raise InputError(f"{self.url}: is a URL; install geomphys[remote] to use URLs") from None
            try:
                self._fs, self._inside = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
            except (ImportError, ValueError, TypeError) as problem:
                reason = " ".join(str(problem).split())
                raise InputError(f"{self.url}: such a URL cannot be opened here ({reason})") from None
        return self._fs
