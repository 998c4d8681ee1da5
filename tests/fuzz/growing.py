"""Files that grow: each family makes one of any size, of something that a reader might take too long for."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import NamedTuple

from tests.fuzz.targets import CUBE, kind_number
from tests.recording.conformance import CHANNEL, CHUNK, DATA_END, FOOTER, HEADER, MAGIC, MESSAGE, SCHEMA, text
from tests.recording.conformance import record as _record

JOINTS, POSE, TRANSFORMS = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
BAR = "=" * 80


class Family(NamedTuple):
    """A target of `targets.TARGETS`, what makes its input of a size, a size, and how much time a byte may take."""

    target: str
    make: Callable[[int], bytes]
    size: int
    microseconds: float = 5.0  # of processor time per byte


def record(opcode: int, body: bytes) -> bytes:
    return _record(opcode, body, pad=False)


def channel(number: int, schema: int, topic: str, encoding: str = "json") -> bytes:
    return record(CHANNEL, struct.pack("<HH", number, schema) + text(topic) + text(encoding) + text(""))


def schema(number: int, name: str, encoding: str = "jsonschema", data: str = "{}") -> bytes:
    return record(SCHEMA, struct.pack("<H", number) + text(name) + text(encoding) + text(data))


def message(number: int, time: int, data: bytes) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", number, 0, time, time) + data)


def chunk(records: bytes, first: int, last: int) -> bytes:
    head = struct.pack("<QQQI", first, last, len(records), 0) + text("") + struct.pack("<Q", len(records))
    return record(CHUNK, head + records)


def log(records: bytes) -> bytes:
    """A log of a wrist and a glove, with some records more."""
    own = schema(1, POSE) + channel(0, 1, "/wrist") + schema(2, JOINTS) + channel(1, 2, "/glove")
    frames = b"".join(message(0, k * 10**7, pose()) + message(1, k * 10**7, joints(["a", "b"])) for k in range(3))
    end = record(DATA_END, bytes(4)) + record(FOOTER, bytes(20)) + MAGIC
    return MAGIC + record(HEADER, text("") + text("")) + own + frames + records + end


def pose() -> bytes:
    position, orientation = dict.fromkeys("xyz", 0.0), {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "world"}
    return json.dumps({"header": header, "pose": {"position": position, "orientation": orientation}}).encode()


def joints(names: list[str]) -> bytes:
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    return json.dumps({"header": header, "name": names, "position": [0.0] * len(names)}).encode()


def transform(parent: str, child: str) -> dict[str, object]:
    value = {"translation": dict.fromkeys("xyz", 0.0), "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": parent}
    return {"header": header, "child_frame_id": child, "transform": value}


def transforms(count: int) -> bytes:
    """A chain of frames, one message for each."""
    chain = (json.dumps({"transforms": [transform(f"f{k}", f"f{k + 1}")]}).encode() for k in range(count))
    return log(
        schema(3, TRANSFORMS) + channel(2, 3, "/tf") + b"".join(message(2, 5 + k, d) for k, d in enumerate(chain))
    )


def ros(encoding: str, *lines: str) -> bytes:
    """A message definition of joint values."""
    return bytes([kind_number(JOINTS, encoding)]) + "\n".join(lines).encode() + b"\n"


def types(count: int, body: Callable[[int], str]) -> list[str]:
    """Types of a message definition."""
    return [f"{BAR}\nMSG: a/T{k}\n{body(k)}" for k in range(count)]


def toml(count: int, lines: Callable[[int], str]) -> bytes:
    return "".join(lines(k) for k in range(count)).encode()


def ball(number: int, kind: str, more: str) -> str:
    return f'[[object]]\nname = "o{number}"\nclass = "{kind}"\nsphere = 0.1\n{more}\n'


def urdf(count: int, parent: Callable[[int], int], mimic: bool = False) -> bytes:
    """Links with a ball each, joined to another one."""
    shape = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    parts = [f'<link name="l{k}">{shape}</link>' for k in range(count)]
    for k in range(1, count):
        kind = 'type="revolute"><limit lower="0" upper="1" effort="1" velocity="1"/>' if mimic else 'type="fixed">'
        follows = f'<mimic joint="j{k - 1}"/>' if mimic and k > 1 else ""
        parts.append(f'<joint name="j{k}" {kind}{follows}<parent link="l{parent(k)}"/><child link="l{k}"/></joint>')
    return f'<robot name="r">{"".join(parts)}</robot>'.encode()


def one_link(inside: str, before: str = "") -> bytes:
    return f'<robot name="r">{before}<link name="a">{inside}</link></robot>'.encode()


def cubes(count: int) -> bytes:
    """Cubes side by side, every second one inside out."""
    rows = [line.split() for line in CUBE.splitlines()]
    lines = []
    for k in range(count):
        lines += [f"v {float(x) + 4 * k} {y} {z}" for kind, x, y, z in rows if kind == "v"]
        corners = ([int(c) + 8 * k for c in row[1:]] for row in rows if row[0] == "f")
        lines += ["f {} {} {}".format(*(face[::-1] if k % 2 else face)) for face in corners]
    return "\n".join(lines).encode() + b"\n"


def glb(nodes: list[dict[str, object]], primitives: int = 1, vertices: int = 8, buffered: bool = True) -> bytes:
    """A cube at some nodes, of which the first is the root; its primitives are equal, and most of its vertices unused."""
    rows = [line.split() for line in CUBE.splitlines()]
    corners = b"".join(struct.pack("<3f", *map(float, row[1:])) for row in rows if row[0] == "v")
    corners += bytes(12 * (vertices - 8) if buffered else 0)
    faces = b"".join(struct.pack("<3I", *(int(c) - 1 for c in row[1:])) for row in rows if row[0] == "f")
    end = len(corners)
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": end}, {"buffer": 0, "byteOffset": end, "byteLength": 144}]
    positions = {"bufferView": 0} if buffered else {}
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": [{"primitives": primitives * [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [positions | {"componentType": 5126, "count": vertices, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR"}],
        "bufferViews": views, "buffers": [{"byteLength": end + 144}],
    }  # fmt: skip
    head = json.dumps(tree).encode()
    head += b" " * (-len(head) % 4)
    whole = (
        struct.pack("<II", len(head), 0x4E4F534A) + head + struct.pack("<II", end + 144, 0x004E4942) + corners + faces
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(whole)) + whole


def nested_nodes(count: int, **each: object) -> bytes:
    return glb([{"children": [k + 1], **each} for k in range(count)] + [{"mesh": 0}])


def collada(nodes: str, library: str = "", faces: int = 1) -> bytes:
    """Nodes of a scene and of a library; ``{mesh}`` in them stands for a tetrahedron, some of its faces more than once."""
    tetrahedron = ["0 2 1", "0 1 3", "1 2 3", "0 3 2"]
    indices = " ".join(tetrahedron[k % 4] for k in range(max(faces, 4)))
    names = "".join(f'<param name="{c}" type="float"/>' for c in "XYZ")
    accessor = f'<technique_common><accessor source="#n" count="4" stride="3">{names}</accessor></technique_common>'
    source = f'<source id="p"><float_array id="n" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>{accessor}</source>'
    shape = f'<triangles count="{max(faces, 4)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>'
    mesh = f'<mesh>{source}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>{shape}</mesh>'
    text = (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
        f'<library_geometries><geometry id="g">{mesh}</geometry></library_geometries><library_nodes>{library}</library_nodes>'
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )
    return text.replace("{mesh}", '<instance_geometry url="#g"/>').encode()


def node(number: int, inside: str) -> str:
    return f'<node id="n{number}">{inside}</node>'


def named(number: int) -> str:
    return f'<instance_node url="#n{number}"/>'


def doubling(count: int) -> bytes:
    """Nodes of which each names the one before twice."""
    return collada(named(count), node(0, "{mesh}") + "".join(node(k, 2 * named(k - 1)) for k in range(1, count + 1)))


def defined_later(count: int) -> bytes:
    """Nodes of which each names the one after it."""
    return collada(named(0), "".join(node(k, named(k + 1)) for k in range(count)) + node(count, "{mesh}"))


def ply(vertices: int, faces: int, kind: str = "ascii") -> bytes:
    head = f"ply\nformat {kind} 1.0\nelement vertex {vertices}\n" + "".join(f"property float {c}\n" for c in "xyz")
    head += f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    return f"{head}0 0 0\n1 0 0\n0 1 1\n3 0 1 2\n".encode()


def materials(count: int) -> bytes:
    """An OBJ with a triangle of each of its materials."""
    return CUBE.encode() + toml(count, lambda k: f"usemtl m{k}\nf 1 2 4\n")


def packages(count: int) -> bytes:
    """A URDF with a mesh of each of some packages, none of which is there."""
    mesh = '<visual><geometry><mesh filename="package://p{}/a.obj"/></geometry></visual>'
    return one_link("".join(mesh.format(k) for k in range(count)))


def attributes(count: int) -> bytes:
    text = " ".join(f'k{k}=""' for k in range(count))
    return f'<robot name="r"><link name="a" {text}/></robot>'.encode()


def side_by_side(count: int) -> bytes:
    cube: list[dict[str, object]] = [{"mesh": 0, "translation": [3 * k, 0, 0]} for k in range(1, count)]
    return glb([{"children": list(range(1, count))}, *cube])


def balls(count: int, step: int) -> bytes:
    return toml(count, lambda k: ball(k, "fixed", f"position = [{step * k}.0, 0.0, 0.0]"))


FAMILIES = {
    "fields of a ROS 2 message": Family("schema", lambda n: ros("cdr", *(f"int32 f{k}" for k in range(n))), 20_000),
    "constants of a ROS 2 message": Family("schema", lambda n: ros("cdr", *(f"int32 F{k}={k}" for k in range(n))), 20_000),
    "fields as many as are read": Family("schema", lambda n: ros("cdr", *(f"int32 f{k}" for k in range(n))), 2_000),
    "blank lines of a definition": Family("schema", lambda n: ros("cdr", "\n" * n, "int32 a"), 40_000),
    "types of a ROS 2 message": Family("schema", lambda n: ros("cdr", "int32 a", *types(n, lambda k: "int32 b")), 2_000),
    "types in one another": Family("schema", lambda n: ros("cdr", "a/T0 a", *types(n, lambda k: f"a/T{k + 1} b")), 400),
    "types of a ROS 1 message": Family(
        "schema", lambda n: ros("ros1", *(f"a/T{k} x{k}" for k in range(n)), *types(n, lambda k: "int32 b")), 400
    ),
    "texts of a ROS 1 message": Family("schema", lambda n: ros("ros1", *(f"string f{k}" for k in range(n))), 900, 60.0),
    "lists in one another": Family("schema", lambda n: ros("ros1", "a/T0[] a", *types(n, lambda k: f"a/T{k + 1}[] b")), 30),
    "channels of one topic": Family(
        "log", lambda n: log(b"".join(channel(k, 1, "/wrist") + message(k, 5, pose()) for k in range(2, n))), 1_000, 8.0
    ),
    "topics": Family("log", lambda n: log(b"".join(channel(k, 1, f"/t{k}") for k in range(2, n))), 1_500, 20.0),
    "frames in one another": Family("log", transforms, 2_000, 1.0),
    "names of joints": Family("log", lambda n: log(message(1, 10**8, joints([f"q{k}" for k in range(n)]))), 4_000),
    "damage": Family("log", lambda n: log(b"\x06\xff\xff\xff\xff\0\0\0\0" * n), 10_000),
    "arrays of JSON in one another": Family("log", lambda n: log(message(1, 10**8, b"[" * n)), 100_000),
    "digits of a number": Family("log", lambda n: log(message(1, 10**8, b'{"a":' + b"9" * n + b"}")), 100_000),
    "lists of YAML in one another": Family("bag", lambda n: b"a: " + b"[" * n, 2_000),
    "merge keys of YAML": Family(
        "bag", lambda n: b"a0: &a0 {x: 1}\n" + toml(n, lambda k: f"a{k + 1}: &a{k + 1} {{<<: *a{k}, x{k}: 1}}\n"), 1_500
    ),
    "parts of a bag": Family(
        "bag",
        lambda n: b"rosbag2_bagfile_information:\n  relative_file_paths:\n" + toml(n, lambda k: f"  - a{k}.mcap\n"),
        1_000, 20.0,
    ),
    "balls of a scene": Family("scene", lambda n: balls(n, 1), 300, 20.0),
    "balls in one place": Family("scene", lambda n: balls(n, 0), 300, 20.0),
    "avatars of a scene": Family(
        "scene",
        lambda n: toml(n, lambda k: f'[[avatar]]\nname = "h{k}"\nurdf = "model.urdf"\nroot = {{ topic = "/w{k}" }}\n'),
        30, 150.0,
    ),
    "wrong keys of a scene": Family("scene", lambda n: toml(n, lambda k: f'[[object]]\nnme = "o{k}"\n'), 2_000),
    "arrays of TOML in one another": Family("scene", lambda n: b"a = " + b"[" * n, 50_000),
    "dotted keys": Family("scene", lambda n: b"a" + b".a" * n + b" = 1", 50_000),
    "dotted keys on many lines": Family("scene", lambda n: toml(n, lambda k: f"a{'.a' * 30}.b{k} = 1\n"), 1_000),
    "links in a chain": Family("urdf", lambda n: urdf(n, lambda k: k - 1), 1_000),
    "links at one link": Family("urdf", lambda n: urdf(n, lambda k: 0), 1_000),
    "links in a circle": Family("urdf", lambda n: urdf(n, lambda k: k + 1 if k < n - 1 else 1), 1_000),
    "joints that follow another": Family("urdf", lambda n: urdf(n, lambda k: 0, mimic=True), 1_000),
    "elements of XML in one another": Family("urdf", lambda n: one_link("", "<a>" * n + "</a>" * n), 20_000),
    "attributes": Family("urdf", attributes, 5_000),
    "packages of ROS": Family("urdf", packages, 400, 20.0),
    "materials of an OBJ": Family("obj", materials, 100_000, 1.0),
    "materials that are told apart": Family("obj", materials, 500, 20.0),
    "corners of a polygon": Family("obj", lambda n: CUBE.encode() + b"f" + b" 1 2 4" * n, 4_000),
    "parts inside out": Family("obj", cubes, 300),
    "nodes in one another": Family("glb", nested_nodes, 3_000),
    "cubes in one another": Family("glb", lambda n: nested_nodes(n, mesh=0, translation=[3, 0, 0]), 3_000),
    "cubes as deep as are read": Family("glb", lambda n: nested_nodes(n, mesh=0, translation=[3, 0, 0]), 31, 100.0),
    "cubes side by side": Family("glb", side_by_side, 300, 40.0),
    "nodes in a circle": Family("glb", lambda n: glb([{"children": [(k + 1) % n], "mesh": 0} for k in range(n)]), 3_000),
    "meshes that share their vertices": Family("glb", lambda n: glb([{"mesh": 0}], n, 80 * n), 1_000),
    "as many as are read": Family("glb", lambda n: glb([{"mesh": 0}], n, 80 * n), 60, 20.0),
    "vertices without a buffer": Family("glb", lambda n: glb([{"mesh": 0}], 20, n, buffered=False), 1_400_000),
    "nodes of a COLLADA that double": Family("dae", doubling, 500),
    "doubled as often as is read": Family("dae", doubling, 8, 100.0),
    "nodes of a COLLADA in a circle": Family(
        "dae", lambda n: collada(named(0), "".join(node(k, named((k + 1) % n)) for k in range(n))), 500
    ),
    "nodes that are defined later": Family("dae", defined_later, 3_000),
    "as many as are waited for": Family("dae", defined_later, 250, 60.0),
    "nodes with one mesh": Family("dae", lambda n: collada("".join(node(k, "{mesh}") for k in range(n))), 600, 30.0),
    "nodes with one large mesh": Family("dae", lambda n: collada("".join(node(k, "{mesh}") for k in range(n)), "", n), 1_500),
    "solids of an STL": Family(
        "stl",
        lambda n: toml(n, lambda k: f"solid a{k}\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 {k}\n"
                       "endloop\nendfacet\nendsolid\n"),
        400, 20.0,
    ),
    "vertices that are announced": Family("ply", lambda n: ply(n, 1), 10**9),
    "faces that are announced": Family("ply", lambda n: ply(3, n, "binary_little_endian"), 10**9),
    "faces of an OFF that are announced": Family(
        "off", lambda n: b"OFF\n%d %d 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n" % (n, n), 10**9
    ),
}  # fmt: skip
LARGE = {
    "channels of one topic": 20_000, "topics": 65_000, "frames in one another": 9_000, "corners of a polygon": 50_000,
    "links in a chain": 4_000, "balls of a scene": 4_000, "parts inside out": 4_000, "cubes side by side": 3_000,
    "solids of an STL": 4_000, "names of joints": 100_000, "damage": 200_000, "wrong keys of a scene": 30_000,
}  # fmt: skip
"""Sizes that take longer, for the slow tests."""
OVERLAPPING = Family(
    "log",
    lambda n: log(b"".join(chunk(message(0, k, pose()) + message(0, 10**10, pose()), 0, 10**10) for k in range(n))),
    15_000,
    2.0,
)
"""Chunks of which each spans all of the log."""
