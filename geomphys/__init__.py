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
    from geomphys.config import Config
    from geomphys.diff.compare import compare_outputs
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
    )
    from geomphys.load import load_world
    from geomphys.pipeline import replay
    from geomphys.plots import plot_output
    from geomphys.results import Contacts, Frame, FrameResult, Metrics, Penetrations
    from geomphys.runner import run
    from geomphys.stats import Statistics, statistics_of
    from geomphys.summary import Summarizer, Summary
    from geomphys.world.scene import Scene, World

_HOME = {
    "AuditReport": "audit",
    "BatchReport": "batch.run",
    "ClusterError": "errors",
    "Config": "config",
    "ConfigError": "errors",
    "Contacts": "results",
    "DamagedLogError": "errors",
    "Frame": "results",
    "FrameResult": "results",
    "GeomphysError": "errors",
    "InputError": "errors",
    "LogError": "errors",
    "MeshError": "errors",
    "Metrics": "results",
    "ModelError": "errors",
    "OutputDifference": "diff.report",
    "OutputError": "errors",
    "Penetrations": "results",
    "Scene": "world.scene",
    "SceneDraft": "draft",
    "SceneError": "errors",
    "Statistics": "stats",
    "Summarizer": "summary",
    "Summary": "summary",
    "World": "world.scene",
    "audit_output": "audit",
    "compare_outputs": "diff.compare",
    "draft_scene": "draft",
    "load_world": "load",
    "plot_output": "plots",
    "replay": "pipeline",
    "run": "runner",
    "run_batch": "batch.run",
    "statistics_of": "stats",
}

__all__ = [
    "AuditReport",
    "BatchReport",
    "ClusterError",
    "Config",
    "ConfigError",
    "Contacts",
    "DamagedLogError",
    "Frame",
    "FrameResult",
    "GeomphysError",
    "InputError",
    "LogError",
    "MeshError",
    "Metrics",
    "ModelError",
    "OutputDifference",
    "OutputError",
    "Penetrations",
    "Scene",
    "SceneDraft",
    "SceneError",
    "Statistics",
    "Summarizer",
    "Summary",
    "World",
    "__version__",
    "audit_output",
    "compare_outputs",
    "draft_scene",
    "load_world",
    "plot_output",
    "replay",
    "run",
    "run_batch",
    "statistics_of",
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
