"""The manifest of a batch: the outcome of each log and the hashes that decide whether it must be replayed again."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from typing import Any, Literal

from geomphys.errors import OutputError
from geomphys.output.provenance import sha256_of_file
from geomphys.storage.output_file import write_file
from geomphys.storage.remote_files import AnyPath

FILE_NAME = "manifest.json"
FORMAT = 1

EntryStatus = Literal["pending", "done", "failed", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A log of a batch. Hashes are SHA-256 in hexadecimal, None for a log that is not done."""

    log: str
    status: EntryStatus = "pending"
    out: str
    """Relative to the manifest, with forward slashes; `rrd` likewise."""
    rrd: str | None = None
    error: str | None = None
    traceback: str | None = None
    version: str
    """Of geomphys."""
    input_sha256: str | None = None
    scene_sha256: str | None = None
    world_sha256: str
    """Of the scene with its meshes and URDFs."""
    parameters: dict[str, Any]
    """Every parameter of the replay, and ``timing``, ``copy_input`` and ``ros2``."""
    out_sha256: str | None = None
    rrd_sha256: str | None = None
    metrics: dict[str, Any] | None = None
    """The replay's `Summary`."""

    def is_made_from(self, other: Entry, input_sha256: str) -> bool:
        """Whether this is a done replay of the same input, scene, parameters and version as `other` asks for."""
        return (
            self.status == "done"
            and self.input_sha256 == input_sha256
            and self.world_sha256 == other.world_sha256
            and self.scene_sha256 == other.scene_sha256
            and self.parameters == other.parameters
            and self.version == other.version
            and self.rrd == other.rrd
        )

    def outputs_are_complete(self, folder: AnyPath) -> bool:
        """Whether the outputs are there and are the bytes that were written."""
        files = ((self.out, self.out_sha256), (self.rrd, self.rrd_sha256))
        return all(
            name is None or ((folder / name).is_file() and sha256_of_file(folder / name) == digest)
            for name, digest in files
        )


_ENCODER = json.JSONEncoder(ensure_ascii=False)


def _indented(value: Any) -> str:
    """A field of an entry as JSON."""
    if isinstance(value, dict):
        return json.dumps(value, indent=1, ensure_ascii=False).replace("\n", "\n   ")
    return _ENCODER.encode(value)


SAVING_SHARE = 0.002
"""Share of its time that a batch may spend on saving its manifest; what a killed one did since the last time is done again."""


@dataclass(frozen=True)
class ManifestRecord:
    """The content of the file."""

    format: int
    logs: tuple[Entry, ...]


@dataclass
class Manifest:
    """All entries of a folder by the name of their output; `save` replaces the file atomically."""

    folder: AnyPath
    entries: dict[str, Entry] = field(default_factory=dict)
    is_saved: bool = field(default=True, init=False)
    _next_save: float = field(default=0.0, init=False)  # s, of `time.monotonic`
    _texts: dict[str, tuple[Entry, str]] = field(default_factory=dict, init=False)  # of the entries, as they were saved
    _parameters: tuple[Any, str] | None = field(default=None, init=False)  # of the last entry encoded, with their text

    @property
    def path(self) -> AnyPath:
        """The file."""
        return self.folder / FILE_NAME

    @classmethod
    def load(cls, folder: AnyPath) -> Manifest:
        """Read the manifest of a folder, an empty one if it has none; raises OutputError if it cannot be understood."""
        path = folder / FILE_NAME
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return cls(folder)
        except OSError as problem:
            raise OutputError(f"{path}: cannot be read ({problem.strerror})") from problem
        except (ValueError, RecursionError) as problem:
            raise OutputError(f"{path}: is no manifest of a batch ({problem}); move it away") from problem
        if not isinstance(content, dict) or "format" not in content:
            raise OutputError(f"{path}: is no manifest of a batch (it names no format); move it away")
        if content["format"] != FORMAT:
            raise OutputError(f"{path}: has format {content['format']!r}, this version knows {FORMAT}; move it away")
        from pydantic import TypeAdapter, ValidationError

        try:
            entries = TypeAdapter(list[Entry]).validate_python(content.get("logs"))
        except ValidationError as problem:
            first = problem.errors(include_url=False)[0]
            where = ".".join(map(str, ("logs", *first["loc"])))
            raise OutputError(
                f"{path}: is no manifest of a batch ({where}: {' '.join(first['msg'].split())}); move it away"
            ) from problem
        return cls(folder, {entry.out: entry for entry in entries})

    def _text(self) -> str:
        """The content as JSON, indented; an entry that was saved before is not encoded again."""
        texts = []
        for out in sorted(self.entries):
            entry = self.entries[out]
            saved = self._texts.get(out)
            if saved is None or saved[0] is not entry:
                saved = self._texts[out] = entry, self._text_of(entry)
            texts.append(saved[1])
        logs = "[\n  " + ",\n  ".join(texts) + "\n ]" if texts else "[]"
        return f'{{\n "format": {FORMAT},\n "logs": {logs}\n}}\n'

    def _text_of(self, entry: Entry) -> str:
        """An entry as JSON; the parameters, which a batch's entries have in common, are encoded once."""
        if self._parameters is None or self._parameters[0] is not entry.parameters:
            self._parameters = entry.parameters, _indented(entry.parameters)
        fields = (
            f'"{name}": {self._parameters[1] if name == "parameters" else _indented(value)}'
            for name, value in vars(entry).items()
        )
        return "{\n   " + ",\n   ".join(fields) + "\n  }"

    def set(self, entry: Entry) -> None:
        """Note an entry, and save it, unless the last time took too long for how lately it was (`SAVING_SHARE`).

        Raises what `save` raises.
        """
        self.entries[entry.out], self.is_saved = entry, False
        if time.monotonic() >= self._next_save:
            self.save()

    def save(self) -> None:
        """Replace the file, atomically; raises OutputError if the folder refuses."""
        start = time.thread_time()
        write_file(self.path, self._text().encode(), force=True)
        self.is_saved = True
        self._next_save = time.monotonic() + (time.thread_time() - start) / SAVING_SHARE
