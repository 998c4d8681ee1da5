"""Exceptions that geomphys raises.

::

    GeomphysError
    ├── InputError            a file that is wrong: says which, where in it, what to do
    │   ├── LogError          a recording
    │   │   └── DamagedLogError   cut off or corrupt: `--recover` replays what is intact
    │   ├── SceneError        a scene file
    │   ├── ModelError        a URDF
    │   └── MeshError         a mesh
    ├── OutputError           a result that cannot be written
    │   └── RefusedTargetError    a file that must not be: it is there, is an input, or no regular file
    ├── ViewerError           the rerun viewer cannot run or show a result
    ├── ClusterError          the Dask scheduler of a batch cannot be reached, or was lost
    └── ConfigError           a parameter out of its range
"""

from __future__ import annotations


class GeomphysError(Exception):
    """Base of all errors of this package. Its text is one line: what, where, what to do."""


class InputError(GeomphysError):
    """A file the user gave is wrong."""


class LogError(InputError):
    """A recording that cannot be replayed."""


class DamagedLogError(LogError):
    """A recording that ends early or is corrupt; what is intact can be replayed with ``recover``."""


class SceneError(InputError):
    """A scene file that is wrong; the text names file, key and value."""


class ModelError(InputError):
    """A URDF that is wrong; the text names file and element."""


class MeshError(InputError):
    """A mesh that cannot be used; the text names it and a remedy."""


class OutputError(GeomphysError):
    """A result that cannot be written."""


class RefusedTargetError(OutputError):
    """A path that no output is written to: it exists, is an input or another output, is no regular file, or on a web server."""


class ViewerError(GeomphysError):
    """The rerun viewer cannot run here, or cannot show a result."""


class ClusterError(GeomphysError):
    """The Dask scheduler of a batch cannot be reached, or was lost."""


class ConfigError(GeomphysError):
    """A parameter out of its range; the text names it, its value and the valid ones."""
