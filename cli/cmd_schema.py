"""``geomphys schema``: prints the JSON Schema of the scene file."""

from __future__ import annotations

from .command import command, current_terminal


@command(
    "schema",
    examples="""
    geomphys schema
    geomphys schema > scene.schema.json
    """,
)
def schema() -> None:
    """Print the JSON Schema of the scene file, for editors that complete and check TOML."""
    from geomphys.scene.scene_file import scene_json_schema

    current_terminal().json(scene_json_schema())
