"""Writes the reference of outputs, and the layout for Foxglove, from the sources: ``python tests/house/output_reference.py``."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

PAGE = ROOT / "assets" / "docs" / "output.md"
LAYOUT = ROOT / "assets" / "foxglove_layout.json"

HEAD = """# The output, field by field

Written by `python tests/house/output_reference.py` from the sources. SI units: m, rad, s, kg, N s; the world's z is up;
quaternions x y z w; normals point out of body b into body a; depths are ≥ 0.
"""

PURPOSES = {
    "/robot_description": "URDF in primitives of the only avatar; `/AVATAR/robot_description`, `/OBJECT/robot_description`",
    "/objects/robot_description": "URDF, in primitives, of the objects without a URDF of their own",
    "/meshes": "surfaces of all bodies in their frames, once",
    "/recorded/meshes": "the ghost: driven bodies in the frames of `/recorded/tf`, translucent, 0.3 mm smaller, once",
    "/tf": "`world` to every body, corrected; bodies that never move in the first frame only",
    "/tf_static": "`world` to the bodies that never move",
    "/recorded/tf": "`world` to the driven bodies as recorded; frame ids prefixed `recorded/`",
    "/joint_states": "corrected joint values of the only avatar; `/AVATAR/joint_states` of several",
    "/contacts": "where bodies touch",
    "/contacts/points": "the same as points: x y z, depth, normal, bodies",
    "/contacts/scene": "the same as arrows along normals: 1 cm longer for each newton, else by the depth",
    "/contacts/markers": "an arrow for each contact",
    "/penetration": "pairs of bodies that overlapped as recorded",
    "/metrics": "figures of every frame",
    "/timing": "stage times; the only channel that may differ between two runs",
    "/log": "warnings",
}
OF_ROS2 = PURPOSES | {"/tf": "`world` to the bodies that move, corrected"}
ATTACHMENTS = """
Attached are the scene file, `TREE.urdf` for every URDF, meshes as `meshes/DIGEST/NAME`, and `attachments.json`, which tells
which mesh stands for which name (`meshes`: object or tree; for trees by the name in the URDF) and the pairs of links that
overlap in the zero pose. The metadata record `geomphys` has
`version`, `input_sha256`, `scene_sha256`, `world_sha256`, `complete` and every parameter as text; where the recording overlapped
`intersection_volume_m3`, the volume common to the two bodies of its deepest overlap.
"""
SCHEMAS = """
As JSON Schemas: `geomphys schema NAME`, where NAME is any command that has `--json`, and `geomphys schema manifest` of the file
that a batch keeps. Numbers are in SI units; what is not finite is null.
"""
JSON = {
    "replay": [("output/summary.py", "Summary")],
    "stats": [
        ("analysis/stats.py", "Statistics"),
        ("analysis/stats.py", "OutputStatistics"),
        ("analysis/metric_values.py", "Distribution"),
    ],
    "audit OUT": [("analysis/audit.py", "AuditReport"), ("analysis/audit.py", "Overlap")],
    "audit LOG --scene SCENE": [
        ("analysis/motion_audit.py", "MotionAudit"),
        ("analysis/motion_audit.py", "PairOverlap"),
    ],
}
"""Command -> module and class of what its --json prints."""


def page() -> str:
    """The page as it should be."""
    parts = [HEAD, "\n## Topics\n", topics(), ATTACHMENTS, "\nWith `--ros2`:\n", topics(ros2=True)]
    parts += [
        "\n## Messages of our own\n\nAs in `geomphys/output/proto/geomphys.proto`, which is in the package.\n",
        messages(),
    ]
    parts += ["\n## Bits of `flags`\n", flags(), "\n## Tables of `geomphys export`\n", tables()]
    parts += ["\n## JSON of commands\n", SCHEMAS, *(json_of(command) for command in JSON)]
    parts += ["\n## The rerun recording\n\nTimelines `frame` and `time`. Entities:\n", entities()]
    return "".join(parts)


def topics(ros2: bool = False) -> str:
    """Topics of a file that is written for this."""
    purposes = OF_ROS2 if ros2 else PURPOSES
    rows = [f"| `{topic}` | {schema} | {encoding} | {purposes[topic]} |" for topic, schema, encoding in channels(ros2)]
    return "\n".join(["", "| topic | schema | encoding | content |", "|---|---|---|---|", *rows, ""])


def channels(ros2: bool = False) -> list[tuple[str, str, str]]:
    """Topic, schema and encoding of each channel of a file that is written for this."""
    from mcap.reader import make_reader

    from geomphys.config import Config
    from geomphys.output.file_sinks import FILE_SINKS, FileSinkOptions
    from geomphys.output.provenance import provenance_of
    from tests.output.made_world import frames, make_world

    with TemporaryDirectory() as folder:
        world = make_world(Path(folder) / "scene", avatars=("hand",))
        sink = FILE_SINKS[".mcap"](Path(folder) / "out.mcap", FileSinkOptions(ros2=ros2))
        sink.open(world, Config(), provenance_of(world.path, world, Config()))
        for result in frames(world, 2):
            sink.write(result)
        sink.close(complete=True)
        with (Path(folder) / "out.mcap").open("rb") as stream:
            summary = make_reader(stream).get_summary()
    return [(c.topic, summary.schemas[c.schema_id].name, c.message_encoding) for c in summary.channels.values()]


def foxglove() -> str:
    """The layout for Foxglove that is shipped: for outputs of one avatar, the hand of the demonstration."""
    from geomphys.load import load_world
    from geomphys.output.camera import Viewpoint
    from geomphys.viewer.foxglove_layout import foxglove_layout, layout_text

    world = load_world(ROOT / "assets/scenes/gallery.toml")
    eye = Viewpoint(np.array([0.7, -0.7, 0.6]), np.zeros(3))
    return layout_text(foxglove_layout([topic for topic, _, _ in channels()], {"/joint_states": world.dof_names}, eye))


def messages() -> str:
    """Fields of the messages, with the comments of the file."""
    text = (ROOT / "geomphys/output/proto/geomphys.proto").read_text()
    found = []
    for comment, name, body in re.findall(r"((?:// [^\n]*\n)*)message (\w+) \{\n(.*?)\n\}", text, flags=re.DOTALL):
        told = " ".join(line.removeprefix("// ") for line in comment.splitlines())
        lines = [f"\n### geomphys.{name}\n", f"{told}\n" if told else "", "| field | type | meaning |", "|---|---|---|"]
        joined = re.sub(r"\n\s+// ", " ", body)
        for kind, field, meaning in re.findall(
            r"^\s*((?:repeated )?[\w.]+) (\w+) = \d+;(?:\s*// ([^\n]*))?", joined, flags=re.M
        ):
            lines.append(f"| `{field}` | {kind} | {escaped(meaning)} |")
        found.append("\n".join([line for line in lines if line] + [""]))
    return "".join(found)


def flags() -> str:
    """Bits and their comments, with the names of `--json`."""
    from geomphys.output.summary import FLAG_NAMES

    text = (ROOT / "geomphys/results.py").read_text()
    rows = [
        f"| {value} | `{FLAG_NAMES.get(int(value), name.lower())}` | {escaped(meaning)} |"
        for name, value, meaning in re.findall(r"^FLAG_(\w+) = (\d+)(?:  # (.*))?$", text, flags=re.M)
    ]
    return "\n".join(["", "| bit | name | meaning |", "|---|---|---|", *rows, ""])


def tables() -> str:
    """Columns of the exported tables."""
    from geomphys.analysis.tables import COLUMNS

    rows = [
        f"| `{table}` | {', '.join(f'`{name}` {kind}' for name, kind in columns)} |"
        for table, columns in COLUMNS.items()
    ]
    return "\n".join(["", "| table | columns |", "|---|---|", *rows, ""])


def json_of(command: str) -> str:
    """Fields of what a command prints."""
    found = [f"\n### `geomphys {command} --json`\n"]
    for module, name in JSON[command]:
        if name != JSON[command][0][1]:
            found.append(f"\n`{name}`:\n")
        found += ["\n| field | type | meaning |\n|---|---|---|\n", *fields_of(ROOT / "geomphys" / module, name)]
    return "".join(found)


def fields_of(path: Path, name: str) -> list[str]:
    """Rows of the fields of a dataclass, with the comment or the text below each."""
    source = path.read_text()
    lines = source.splitlines()
    (made,) = [n for n in ast.parse(source).body if isinstance(n, ast.ClassDef) and n.name == name]
    rows = []
    for node, below in zip(made.body, [*made.body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        meaning = lines[node.end_lineno - 1].partition("#")[2].strip()
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            meaning = str(below.value.value)
        rows.append(f"| `{node.target.id}` | {escaped(ast.unparse(node.annotation))} | {escaped(meaning)} |\n")
    return rows


def entities() -> str:
    """Entity paths, from the names in the code."""
    from geomphys.output import rerun_blueprint as names

    rows = {
        "/".join((*names.CORRECTED_BODIES, "BODY")): "mesh, pose and colour of a body, corrected",
        "/".join((*names.RECORDED_BODIES, "BODY")): "a driven body as recorded, translucent where it differs",
        "/".join((*names.CONTACTS, "points")): "contact points",
        "/".join((*names.CONTACTS, "normals")): "arrows along normals: 1 cm longer for each newton, else by the depth",
        "/".join(names.DEPTHS): "global penetration depths of pairs",
        **{"/".join((*names.PLOTS, line)): "a curve" for line in names.LINES},
        "/".join((*names.PLOTS, "stages_us", "STAGE")): "stage times, µs",
        "/".join((*names.JOINTS, "AVATAR", "JOINT")): "a joint value, corrected, rad or m",
        "/".join((*names.RECORDED_JOINTS, "AVATAR", "JOINT")): "the same as recorded",
        "/".join(names.METRICS): "a column for each figure of a frame",
        "/".join(names.FLAGS): "a column for each bit of `flags`",
        "/".join(names.LOG): "warnings, and the moments to look at first where they happen",
        "/".join(names.MOMENTS): "document: the moments to look at first, with the commands that show them",
        "/".join(names.LEGEND): "document: what the colours mean",
    }
    return "\n".join(["", "| entity | content |", "|---|---|", *(f"| `{k}` | {v} |" for k, v in rows.items()), ""])


def escaped(text: str) -> str:
    """Text for a cell."""
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page())
    LAYOUT.write_text(foxglove())
