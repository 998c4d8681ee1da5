"""Geometry-driven contact for recorded motion capture: a hand that was recorded inside a table is put on it.

``replay(log, scene)`` yields one `FrameResult` a frame; ``run(log, scene, out=…)`` writes them to files and returns a
`Summary`. What is public is imported on first use, so that ``import geomphys`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from geomphys.audit import AuditReport, audit_output
    from geomphys.batch.run import BatchReport, run_batch
    from geomphys.bench.run import run_bench
    from geomphys.config import Config
    from geomphys.diff.compare import compare_outputs
    from geomphys.diff.overlay import write_overlay
    from geomphys.diff.page import write_page
    from geomphys.diff.report import OutputDifference
    from geomphys.draft import SceneDraft, draft_scene
    from geomphys.errors import (
        ClusterError,
        ConfigError,
        DamagedLogError,
        GeomphysError,
        InputError,
        LogError,
        MeshError,
        ModelError,
        OutputError,
        SceneError,
        ViewerError,
    )
    from geomphys.load import load_world
    from geomphys.output_log import OutputLog, open_output
    from geomphys.piece_files import DecomposedMesh, decompose_file, write_pieces
    from geomphys.pipeline import replay
    from geomphys.plots import plot_output
    from geomphys.recording.check import CheckReport, check_log
    from geomphys.recording.inspect import LogInfo, inspect_log
    from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations
    from geomphys.runner import run
    from geomphys.snapshot import take_snapshot
    from geomphys.stats import Statistics, statistics_of
    from geomphys.summary import Summarizer, Summary
    from geomphys.view import view_result
    from geomphys.world.scene import Scene, World
    from geomphys.world.scene_file import scene_json_schema

_HOME = {
    "AuditReport": "audit",
    "BatchReport": "batch.run",
    "CheckReport": "recording.check",
    "ClusterError": "errors",
    "Config": "config",
    "ConfigError": "errors",
    "Contacts": "results",
    "DamagedLogError": "errors",
    "DecomposedMesh": "piece_files",
    "Frame": "results",
    "FrameResult": "results",
    "GeomphysError": "errors",
    "InputError": "errors",
    "LogError": "errors",
    "LogInfo": "recording.inspect",
    "MeshError": "errors",
    "Metrics": "results",
    "ModelError": "errors",
    "OutputDifference": "diff.report",
    "OutputError": "errors",
    "OutputLog": "output_log",
    "Penetrations": "results",
    "Scene": "world.scene",
    "SceneDraft": "draft",
    "SceneError": "errors",
    "Statistics": "stats",
    "Summarizer": "summary",
    "Summary": "summary",
    "ViewerError": "errors",
    "World": "world.scene",
    "audit_output": "audit",
    "check_log": "recording.check",
    "compare_outputs": "diff.compare",
    "decompose_file": "piece_files",
    "draft_scene": "draft",
    "inspect_log": "recording.inspect",
    "load_world": "load",
    "open_output": "output_log",
    "plot_output": "plots",
    "replay": "pipeline",
    "run": "runner",
    "run_batch": "batch.run",
    "run_bench": "bench.run",
    "scene_json_schema": "world.scene_file",
    "statistics_of": "stats",
    "take_snapshot": "snapshot",
    "view_result": "view",
    "write_overlay": "diff.overlay",
    "write_page": "diff.page",
    "write_pieces": "piece_files",
}

__all__ = [
    "AuditReport",
    "BatchReport",
    "CheckReport",
    "ClusterError",
    "Config",
    "ConfigError",
    "Contacts",
    "DamagedLogError",
    "DecomposedMesh",
    "Frame",
    "FrameResult",
    "GeomphysError",
    "InputError",
    "LogError",
    "LogInfo",
    "MeshError",
    "Metrics",
    "ModelError",
    "OutputDifference",
    "OutputError",
    "OutputLog",
    "Penetrations",
    "Scene",
    "SceneDraft",
    "SceneError",
    "Statistics",
    "Summarizer",
    "Summary",
    "ViewerError",
    "World",
    "__version__",
    "audit_output",
    "check_log",
    "compare_outputs",
    "decompose_file",
    "draft_scene",
    "inspect_log",
    "load_world",
    "open_output",
    "plot_output",
    "replay",
    "run",
    "run_batch",
    "run_bench",
    "scene_json_schema",
    "statistics_of",
    "take_snapshot",
    "view_result",
    "write_overlay",
    "write_page",
    "write_pieces",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    value: Any
    if name == "__version__":
        value = _installed_version()
    elif name in _HOME:
        value = getattr(import_module(f"geomphys.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module 'geomphys' has no attribute {name!r}")
    globals()[name] = value
    return value


def _installed_version() -> str:
    """Version of the installed package; `0+unknown` in a checkout that was never installed."""
    metadata = import_module("importlib.metadata")
    try:
        return str(metadata.version("geomphys"))
    except metadata.PackageNotFoundError:
        return "0+unknown"


def __dir__() -> list[str]:
    """Every public name, imported or not."""
    return sorted(__all__)
