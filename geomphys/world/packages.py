"""Where a mesh lies that a URDF names: relative to it, by ``file://``, or in a ROS package by ``package://``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import cast
from urllib.parse import unquote

from geomphys.errors import MeshError
from geomphys.remote import is_remote
from geomphys.world.sources import is_there, note_contents
from geomphys.world.urdf_kinds import EXPRESSION

LARGEST_MANIFEST = 256 * 1024
"""bytes of a package.xml"""
MOST_LEVELS = 32
"""folders above a URDF that are looked at"""
MOST_SIBLINGS = 200
"""folders in each of these that are looked at, in the order of their names"""


def mesh_file(name: str, folder: Path) -> Path:
    """Local path of a mesh named in a URDF of this folder; see `MeshFinder.find`."""
    return MeshFinder(folder).find(name)


class MeshFinder:
    """Finds the meshes that a URDF of a folder names; packages are looked for once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._by_manifest: dict[str, list[Path]] = {}

    def find(self, name: str) -> Path:
        """Local path of a mesh.

        `file://` URLs, `package://` URLs and paths relative to the folder. A package is looked for in the folder, those
        above it and those beside these, then in $ROS_PACKAGE_PATH and $AMENT_PREFIX_PATH: a folder is a package's by
        its own name or by the ``<name>`` of its package.xml. The first that has the file counts.

        Raises MeshError for other URLs, for what xacro would have filled in, where no package of that name is found,
        and where none of those found has the file.
        """
        shown = "".join(c if c.isprintable() else "?" for c in name[:200])
        scheme, sign, rest = name.partition("://")
        if "\0" in name:
            raise MeshError(f"{shown}: is not a path")
        if EXPRESSION.search(name):
            raise MeshError(f"{shown}: holds an expression that xacro fills in: make the URDF of its xacro file again")
        if not sign:
            return self.folder / name
        if scheme == "file":
            host, slash, local = rest.partition("/")
            if host not in ("", "localhost"):
                raise MeshError(f"{shown}: lies on another machine, only local files are read")
            return Path(unquote(slash + local))
        if scheme != "package":
            raise MeshError(f"{shown}: only file://, package:// and relative paths are read")
        package, _, inner = unquote(rest).partition("/")
        inner = inner.lstrip("/")
        if not package.strip(".") or not inner:
            raise MeshError(f"{shown}: expected package://PACKAGE/PATH")
        return self._in_package(package, inner, shown)

    def _in_package(self, package: str, inner: str, shown: str) -> Path:
        found: list[Path] = []
        for root in self._roots(package):
            if is_there(root / inner):
                return root / inner
            if is_there(root) and root.is_dir():
                found.append(root)
        if found:
            raise MeshError(f"{shown}: no such file in the package {package!r}, which is {found[0]}")
        raise MeshError(
            f"{shown}: package {package!r} was not found in the folders above {_above(self.folder)[0]}, "
            "nor in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH: set one of them or put the files beside the URDF"
        )

    def _roots(self, package: str) -> Iterator[Path]:
        """Folders that may be the package's: first those so named, then those whose package.xml says so."""
        bases = [*_above(self.folder), *_searched()]
        for base in bases:
            yield base / package
            if base.name == package:
                yield base
        if package not in self._by_manifest:
            folders = dict.fromkeys(folder for base in bases for folder in (base, *_children(base)))
            self._by_manifest[package] = [folder for folder in folders if _name_of(folder) == package]
        yield from self._by_manifest[package]


def _searched() -> list[Path]:
    """Folders of packages that the environment names."""
    return [
        Path(entry) / inside
        for variable, inside in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for entry in os.environ.get(variable, "").split(os.pathsep)
        if entry
    ]


def _above(folder: Path) -> list[Path]:
    """A folder and those above it; also as they really are where a link leads elsewhere."""
    if is_remote(folder):
        return [cast(Path, level) for level in (folder, *folder.parents[:MOST_LEVELS])]
    here, real = Path(os.path.abspath(folder)), Path(os.path.realpath(folder))
    levels = [here, *list(here.parents)[:MOST_LEVELS]]
    if real != here:
        levels += [up for up in (real, *list(real.parents)[:MOST_LEVELS]) if up not in levels]
    return levels


def _children(folder: Path) -> list[Path]:
    """Folders in a local folder, the first `MOST_SIBLINGS` by name."""
    if is_remote(folder):
        return []
    try:
        with os.scandir(folder) as entries:
            names = sorted(e.name for e in entries if not e.name.startswith(".") and e.is_dir())
    except OSError:
        return []
    return [folder / name for name in names[:MOST_SIBLINGS]]


def _name_of(folder: Path) -> str:
    """The ``<name>`` in a folder's package.xml; "" where there is none that can be read."""
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    manifest = folder / "package.xml"
    try:
        if not manifest.is_file():
            return ""
        with manifest.open("rb") as stream:
            data = stream.read(LARGEST_MANIFEST + 1)
        if len(data) > LARGEST_MANIFEST:
            return ""
        root = fromstring(note_contents(manifest, data), forbid_dtd=True)
    except (OSError, DefusedXmlException, ParseError, ValueError, LookupError):
        return ""
    return (root.findtext("name") or "").strip() if root.tag == "package" else ""
