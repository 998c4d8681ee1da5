"""Makes what a fuzz run starts from, out of the assets of this checkout: ``python -m tests.fuzz.seeds``.

Files of the corpus that are not named here were found by a run.
"""

from __future__ import annotations

import base64
import io
import json
import struct
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

import geomphys
from geomphys.recording.message_kinds import KINDS
from tests.cli.press import SCENE
from tests.cli.press import write_log as write_press
from tests.fuzz.targets import _KINDS, CUBE, MODEL
from tests.recording.log_files import Item, joints, pose, transforms, turned, write_log
from tests.recording.made_messages import make
from tests.scene.test_scene_file import FULL

CORPUS = Path(__file__).with_name("corpus")
ROOT = Path(__file__).resolve().parents[2]
PLACED = (0.1, 0.2, 0.3, *turned(0.3))


def items(kind: str = "pose") -> list[Item]:
    """Three frames of a wrist and a glove."""
    found = []
    for k in range(3):
        found.append(pose("/wrist", k / 60, PLACED) if kind == "pose" else transforms("/wrist", k / 60, {"a": PLACED}))
        found.append(joints("/glove", k / 60, {"a": 0.1 * k, "b": None}))
    return found


def logs(folder: Path) -> dict[str, bytes]:
    """Logs in every encoding and layout."""
    found = {}
    for encoding in ("ros2", "protobuf", "json", "json-ros"):
        path = write_log(folder / "log.mcap", items(), encoding=encoding, compression=CompressionType.NONE,
                         enable_crcs=False, enable_data_crcs=False)  # fmt: skip
        found[f"log/{encoding}.mcap"] = path.read_bytes()
    for name, options in (
        ("zstd", {"compression": CompressionType.ZSTD}),
        ("lz4", {"compression": CompressionType.LZ4}),
        ("unchunked", {"use_chunking": False}),
        ("indexed", {"compression": CompressionType.NONE, "chunk_size": 100}),
    ):
        path = write_log(folder / "log.mcap", items(), encoding="json", metadata={"a": {"b": "c"}}, **options)
        found[f"log/{name}.mcap"] = path.read_bytes()
    return found


def messages() -> dict[str, bytes]:
    """A message of each kind and encoding, and a schema of each encoding that has one."""
    found = {}
    for number, (name, encoding) in enumerate(_KINDS):
        if not any(name == kind.names[0] for kind in KINDS):
            continue
        label = name.replace("/msg/", ".")
        made = make(name, encoding)
        found[f"message/{label}.{encoding}"] = bytes([number]) + made.data
        if encoding != "json" and number % 2:
            found[f"schema/{label}.{encoding}"] = bytes([number]) + made.schema_data
    return found


def meshes() -> dict[str, bytes]:
    """A cube in every format, and the ball of the assets."""
    corners = np.array([line.split()[1:] for line in CUBE.splitlines() if line[0] == "v"], float)
    faces = np.array([line.split()[1:] for line in CUBE.splitlines() if line[0] == "f"], int) - 1
    cube = trimesh.Trimesh(corners, faces, process=False)
    found: dict[str, bytes] = {"obj/cube.obj": b"mtllib a.mtl\nusemtl b\no c\n" + CUBE.encode()}
    for suffix in ("stl", "ply", "off", "glb", "dae"):
        data = cube.export(file_type=suffix)
        found[f"{suffix}/cube.{suffix}"] = data.encode() if isinstance(data, str) else data
    found["stl/text.stl"] = cube.export(file_type="stl_ascii").encode()
    found["ply/text.ply"] = cube.export(file_type="ply", encoding="ascii")
    glb = found["glb/cube.glb"]
    length = struct.unpack_from("<I", glb, 12)[0]
    tree = json.loads(glb[20 : 20 + length])
    start = 20 + length + 8
    tree["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(glb[start:]).decode()
    found["gltf/cube.gltf"] = json.dumps(tree).encode()
    return found


def results(folder: Path) -> dict[str, bytes]:
    """An output of two frames, copied into chunks that are not compressed and have no checksum."""
    write_press(folder / "press.mcap", frames=2)
    (folder / "press.toml").write_text(SCENE)
    geomphys.run(folder / "press.mcap", folder / "press.toml", out=folder / "out.mcap")
    copy = io.BytesIO()
    writer = Writer(copy, compression=CompressionType.NONE, enable_crcs=False, enable_data_crcs=False)
    writer.start()
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    with (folder / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        for schema, channel, message in reader.iter_messages():
            if schema is not None and schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, b"")
            if channel.id not in channels:
                schema_id = schemas.get(channel.schema_id, 0)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
    writer.add_attachment(0, 0, "scene.toml", "application/toml", SCENE.encode())
    writer.finish()
    return {"result/whole.mcap": copy.getvalue()}


def main() -> None:
    """Write the corpus."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {**logs(folder), **messages(), **meshes(), **results(folder)}
    files |= {
        "scene/press.toml": SCENE.encode(),
        "scene/full.toml": FULL.encode(),
        "scene/model.toml": b'[[avatar]]\nname = "h"\nurdf = "model.urdf"\nroot = {topic = "/w"}\n[[object]]\nname = "c"\n'
        b'class = "simulated"\nmesh = "cube.obj"\nmass = 1.0\nvelocity = [0, 0, 1]\nposition = [5, 0, 0]\n',
        "urdf/model.urdf": MODEL.encode(),
        "urdf/shapes.urdf": b'<robot name="s"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>'
        b'<collision><origin xyz="0 0 1" rpy="0 1 0"/><geometry><cylinder radius="1" length="2"/></geometry></collision>'
        b'</link><link name="b"/><link name="c"/><joint name="j" type="prismatic"><parent link="a"/><child link="b"/>'
        b'<limit lower="0" upper="1" effort="1" velocity="1"/></joint><joint name="k" type="continuous">'
        b'<parent link="b"/><child link="c"/><mimic joint="j" multiplier="2" offset="1"/></joint></robot>',
        "bag/metadata.yaml": b"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n"
        b"  relative_file_paths:\n    - a.mcap\n  compression_format: ''\n  compression_mode: ''\n",
    }
    for name, data in files.items():
        path = CORPUS / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


if __name__ == "__main__":
    main()
