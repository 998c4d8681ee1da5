"""Geometry-driven contact for recorded motion capture: a hand that was recorded inside a table is put on it.

``replay(log, scene)`` yields one `FrameResult` a frame; ``run(log, scene, out=…)`` writes them to files and returns a
`Summary`. What is public is imported on first use, so that ``import geomphys`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geomphys.analysis.audit import AuditReport, audit_output
    from geomphys.analysis.diff.compare import compare_outputs
    from geomphys.analysis.diff.difference import OutputDifference
    from geomphys.analysis.diff.html_report import write_page
    from geomphys.analysis.diff.rerun_overlay import write_overlay
    from geomphys.analysis.json_schemas import json_schema
    from geomphys.analysis.lerobot import export_lerobot
    from geomphys.analysis.motion_audit import MotionAudit, audit_motion
    from geomphys.analysis.plots import plot_output
    from geomphys.analysis.stats import Statistics, statistics_of
    from geomphys.analysis.tables import export_tables
    from geomphys.authoring.calibration import Calibration, calibrate
    from geomphys.authoring.convex_pieces import DecomposedMesh, decompose_file, write_pieces
    from geomphys.authoring.demo_files import demo_files
    from geomphys.authoring.scene_draft import SceneDraft, draft_scene
    from geomphys.batch.run import BatchCallbacks, BatchOptions, BatchReport, run_batch
    from geomphys.bench.run import BenchOptions, run_bench
    from geomphys.config import Callbacks, Config, OutputOptions
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
    from geomphys.output.output_log import OutputLog, open_output
    from geomphys.output.summary import Summarizer, Summary
    from geomphys.recording.check import CheckReport, check_log
    from geomphys.recording.inspect import LogInfo, inspect_log
    from geomphys.replays import replay, run
    from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations
    from geomphys.scene.arrays import Scene
    from geomphys.scene.scene_file import scene_json_schema
    from geomphys.scene.world import World
    from geomphys.version import __version__
    from geomphys.viewer.foxglove_layout import write_foxglove_layout
    from geomphys.viewer.snapshot import take_snapshot
    from geomphys.viewer.video import VideoConfig, make_video
    from geomphys.viewer.view import view_result

_HOME = {
    "__version__": "version",
    "AuditReport": "analysis.audit",
    "BatchCallbacks": "batch.run",
    "BatchOptions": "batch.run",
    "BatchReport": "batch.run",
    "BenchOptions": "bench.run",
    "Calibration": "authoring.calibration",
    "Callbacks": "config",
    "CheckReport": "recording.check",
    "ClusterError": "errors",
    "Config": "config",
    "ConfigError": "errors",
    "Contacts": "results",
    "DamagedLogError": "errors",
    "DecomposedMesh": "authoring.convex_pieces",
    "Frame": "results",
    "FrameResult": "results",
    "GeomphysError": "errors",
    "InputError": "errors",
    "LogError": "errors",
    "LogInfo": "recording.inspect",
    "MeshError": "errors",
    "Metrics": "results",
    "ModelError": "errors",
    "MotionAudit": "analysis.motion_audit",
    "OutputDifference": "analysis.diff.difference",
    "OutputError": "errors",
    "OutputLog": "output.output_log",
    "OutputOptions": "config",
    "Penetrations": "results",
    "Scene": "scene.arrays",
    "SceneDraft": "authoring.scene_draft",
    "SceneError": "errors",
    "Statistics": "analysis.stats",
    "Summarizer": "output.summary",
    "Summary": "output.summary",
    "VideoConfig": "viewer.video",
    "ViewerError": "errors",
    "World": "scene.world",
    "audit_motion": "analysis.motion_audit",
    "audit_output": "analysis.audit",
    "calibrate": "authoring.calibration",
    "check_log": "recording.check",
    "compare_outputs": "analysis.diff.compare",
    "decompose_file": "authoring.convex_pieces",
    "demo_files": "authoring.demo_files",
    "draft_scene": "authoring.scene_draft",
    "export_lerobot": "analysis.lerobot",
    "export_tables": "analysis.tables",
    "inspect_log": "recording.inspect",
    "json_schema": "analysis.json_schemas",
    "load_world": "load",
    "make_video": "viewer.video",
    "open_output": "output.output_log",
    "plot_output": "analysis.plots",
    "replay": "replays",
    "run": "replays",
    "run_batch": "batch.run",
    "run_bench": "bench.run",
    "scene_json_schema": "scene.scene_file",
    "statistics_of": "analysis.stats",
    "take_snapshot": "viewer.snapshot",
    "view_result": "viewer.view",
    "write_foxglove_layout": "viewer.foxglove_layout",
    "write_overlay": "analysis.diff.rerun_overlay",
    "write_page": "analysis.diff.html_report",
    "write_pieces": "authoring.convex_pieces",
}

__all__ = [
    "AuditReport",
    "BatchCallbacks",
    "BatchOptions",
    "BatchReport",
    "BenchOptions",
    "Calibration",
    "Callbacks",
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
    "MotionAudit",
    "OutputDifference",
    "OutputError",
    "OutputLog",
    "OutputOptions",
    "Penetrations",
    "Scene",
    "SceneDraft",
    "SceneError",
    "Statistics",
    "Summarizer",
    "Summary",
    "VideoConfig",
    "ViewerError",
    "World",
    "__version__",
    "audit_motion",
    "audit_output",
    "calibrate",
    "check_log",
    "compare_outputs",
    "decompose_file",
    "demo_files",
    "draft_scene",
    "export_lerobot",
    "export_tables",
    "inspect_log",
    "json_schema",
    "load_world",
    "make_video",
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
    "write_foxglove_layout",
    "write_overlay",
    "write_page",
    "write_pieces",
]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'geomphys' has no attribute {name!r}")
    value = getattr(import_module(f"geomphys.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Every public name, imported or not."""
    return sorted(__all__)
