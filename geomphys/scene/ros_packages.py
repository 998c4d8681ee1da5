"""Resolves mesh names of a URDF: relative paths, ``file://`` URLs, and ``package://`` URLs of ROS packages."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from geomphys.errors import MeshError
from geomphys.scene.model_formats import EXPRESSION
from geomphys.scene.source_files import path_exists, track_contents
from geomphys.storage.remote_files import AnyPath, is_remote

MAX_MANIFEST_BYTES = 256 * 1024
"""bytes of a package.xml"""
MAX_LEVELS = 32
"""folders above a URDF that are searched"""
MAX_SIBLINGS = 200
"""folders in each of these that are searched, in the order of their names"""


class MeshResolver:
    """Resolves mesh names of the URDFs in a folder; folders are searched for packages once."""

    def __init__(self, folder: AnyPath) -> None:
        self.folder = folder
        self._by_manifest: dict[str, list[AnyPath]] | None = None  # name in package.xml -> folders

    def find(self, name: str) -> AnyPath:
        """Path of a mesh.

        `file://` URLs, `package://` URLs and paths relative to the folder. A package is searched in the folder, its
        ancestors and their subfolders, then in $ROS_PACKAGE_PATH and $AMENT_PREFIX_PATH. A folder matches by its own
        name or by the ``<name>`` of its package.xml; the first match that contains the file is used. For a
        URDF behind a URL only files in or below its folder are resolved: no local files, no search paths.

        Raises MeshError for other URLs, unexpanded xacro expressions, a package that is not found, and a file that is in
        none of the packages found.
        """
        printable_name = "".join(c if c.isprintable() else "?" for c in name[:200])
        scheme, separator, rest = name.partition("://")
        if "\0" in name:
            raise MeshError(f"{printable_name}: is not a path")
        if EXPRESSION.search(name):
            raise MeshError(
                f"{printable_name}: holds an expression that xacro fills in: make the URDF of its xacro file again"
            )
        if not separator:
            return self.folder / name
        if scheme == "file":
            if is_remote(self.folder):
                raise MeshError(f"{printable_name}: is a local file, which a URDF behind a URL may not name")
            host, slash, local = rest.partition("/")
            if host not in ("", "localhost"):
                raise MeshError(f"{printable_name}: lies on another machine, only local files are read")
            return Path(unquote(slash + local))
        if scheme != "package":
            raise MeshError(f"{printable_name}: only file://, package:// and relative paths are read")
        package, _, path_in_package = unquote(rest).partition("/")
        path_in_package = path_in_package.lstrip("/")
        if not package.strip(".") or not path_in_package:
            raise MeshError(f"{printable_name}: expected package://PACKAGE/PATH")
        return self._in_package(package, path_in_package, printable_name)

    def _in_package(self, package: str, path_in_package: str, printable_name: str) -> AnyPath:
        found: list[AnyPath] = []
        for root in self._candidate_roots(package):
            if path_exists(root / path_in_package):
                return root / path_in_package
            if path_exists(root) and root.is_dir():
                found.append(root)
        if found:
            raise MeshError(f"{printable_name}: no such file in the package {package!r}, which is {found[0]}")
        if is_remote(self.folder):
            raise MeshError(
                f"{printable_name}: package {package!r} was not found in {self.folder} and the folders above"
            )
        raise MeshError(
            f"{printable_name}: package {package!r} was not found in the folders above {Path(os.path.abspath(self.folder))}, "
            "nor in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH: set one of them or put the files beside the URDF"
        )

    def _candidate_roots(self, package: str) -> Iterator[AnyPath]:
        """Folders that may be the package: first by folder name, then by package.xml."""
        bases: list[AnyPath]
        if is_remote(self.folder):
            bases = [self.folder, *self.folder.parents]
        else:
            bases = [*_with_ancestors(self.folder), *_environment_folders()]
        for base in bases:
            yield base / package
            if base.name == package:
                yield base
        if self._by_manifest is None:
            self._by_manifest = {}
            for folder in dict.fromkeys(folder for base in bases for folder in (base, *_subfolders(base))):
                self._by_manifest.setdefault(_manifest_name(folder), []).append(folder)
        yield from self._by_manifest.get(package, ())


def _environment_folders() -> list[Path]:
    """Folders of packages named by environment variables."""
    return [
        Path(entry) / inside
        for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for entry in os.environ.get(variable, "").split(os.pathsep)
        if entry
    ]


def _with_ancestors(folder: Path) -> list[Path]:
    """A folder and its ancestors, also of its resolved path if it is a symbolic link."""
    absolute, real = Path(os.path.abspath(folder)), Path(os.path.realpath(folder))
    levels = [absolute, *list(absolute.parents)[:MAX_LEVELS]]
    if real != absolute:
        levels += [up for up in (real, *list(real.parents)[:MAX_LEVELS]) if up not in levels]
    return levels


def _subfolders(folder: AnyPath) -> list[Path]:
    """Folders in a folder, the first `MAX_SIBLINGS` by name."""
    if is_remote(folder):
        return []
    try:
        with os.scandir(folder) as entries:
            names = sorted(e.name for e in entries if not e.name.startswith(".") and e.is_dir())
    except OSError:
        return []
    return [folder / name for name in names[:MAX_SIBLINGS]]


def _manifest_name(folder: AnyPath) -> str:
    """The ``<name>`` in a folder's package.xml; "" if it is missing or unreadable."""
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    manifest = folder / "package.xml"
    try:
        if not manifest.is_file():
            return ""
        with manifest.open("rb") as stream:
            data = stream.read(MAX_MANIFEST_BYTES + 1)
        if len(data) > MAX_MANIFEST_BYTES:
            return ""
        root = fromstring(track_contents(manifest, data), forbid_dtd=True)
    except (OSError, DefusedXmlException, ParseError, ValueError, LookupError):
        return ""
    return (root.findtext("name") or "").strip() if root.tag == "package" else ""
