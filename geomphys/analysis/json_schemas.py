"""JSON Schemas of what commands print with ``--json`` and of a batch's manifest, made from the records themselves."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from geomphys.errors import ConfigError

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_RECORDS: dict[str, tuple[str, ...]] = {
    "replay": ("output.summary:Summary",),
    "batch": ("batch.run:BatchReport",),
    "manifest": ("batch.manifest:ManifestRecord",),
    "stats": ("analysis.stats:Statistics",),
    "diff": ("analysis.diff.difference:DifferenceRecord",),
    "audit": ("analysis.audit:AuditReport", "analysis.motion_audit:MotionAudit"),
    "check": ("recording.check:CheckRecord",),
    "info": ("recording.inspect:LogInfo",),
    "calibrate": ("authoring.calibration:Calibration",),
    "init": ("authoring.scene_draft:DraftRecord",),
    "decompose": ("authoring.convex_pieces:MeshRecords",),
    "bench": ("bench.report:Report",),
}
"""Name -> the records, one of which is printed: module and class, or tuple of it."""

JSON_OUTPUTS = tuple(_RECORDS)
"""Names that `json_schema` knows: commands with ``--json``, and ``manifest``, the file of a batch."""


def json_schema(name: str) -> dict[str, Any]:
    """JSON Schema (2020-12) of what ``geomphys NAME --json`` prints, or of the file ``manifest.json`` of a batch.

    Numbers are in SI units. An object has no other keys than those listed.

    Raises
    ------
    ConfigError
        `name` is none of `JSON_OUTPUTS`.
    """
    from pydantic import TypeAdapter

    if name not in _RECORDS:
        raise ConfigError(f"name = {name!r}: choose among {', '.join(JSON_OUTPUTS)}")
    records = [getattr(import_module(f"geomphys.{m}"), r) for m, r in (text.split(":") for text in _RECORDS[name])]
    found: list[dict[str, Any]] = [TypeAdapter(record).json_schema(mode="serialization") for record in records]
    shared: dict[str, Any] = {}
    for schema in found:
        shared |= schema.pop("$defs", {})
    for schema in (*found, *shared.values()):
        if "properties" in schema:
            schema["additionalProperties"] = False
    title = "manifest.json of geomphys batch" if name == "manifest" else f"geomphys {name} --json"
    content = found[0] | {"title": title} if len(found) == 1 else {"title": title, "anyOf": found}
    return {"$schema": DIALECT, **content, **({"$defs": shared} if shared else {})}
