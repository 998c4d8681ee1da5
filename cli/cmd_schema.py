"""``geomphys schema``: prints the JSON Schema of the scene file, or of what a command prints with ``--json``."""

from __future__ import annotations

import click

from .command import command, current_terminal

OUTPUTS = (
    "replay",
    "batch",
    "manifest",
    "stats",
    "diff",
    "audit",
    "check",
    "info",
    "calibrate",
    "init",
    "decompose",
    "bench",
)
"""As `geomphys.analysis.json_schemas.JSON_OUTPUTS`, which is imported only when one is asked for."""


@command(
    "schema",
    examples="""
    geomphys schema > scene.schema.json
    geomphys schema replay > replay.schema.json
    geomphys schema manifest
    """,
)
@click.argument("name", type=click.Choice(["scene", *OUTPUTS]), default="scene", metavar="[NAME]")
def schema(name: str) -> None:
    """Print the JSON Schema of the scene file, for editors that complete and check TOML.

    Or of what a command prints with --json: NAME is the command's; or of the manifest of a batch: NAME is manifest.
    """
    import geomphys

    current_terminal().json(geomphys.scene_json_schema() if name == "scene" else geomphys.json_schema(name))
