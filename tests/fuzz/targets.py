"""What is fuzzed: bytes through every loader. Each may raise what `geomphys.errors` has, on one line, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from geomphys.analysis.stats import statistics_of
from geomphys.config import Config
from geomphys.errors import GeomphysError
from geomphys.load import load_world
from geomphys.output.output_log import open_output
from geomphys.recording.channels import kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.frames import FrameSource
from geomphys.recording.inspect import inspect_log
from geomphys.recording.reader import LogChannel
from geomphys.scene.meshes import SUFFIXES, load_mesh, oriented_outwards, require_closed
from geomphys.scene.skeleton import load_skeleton
from tests.recording.log_files import Tree, make_world
from tests.recording.made_messages import make, pairs

WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b"), mimics=("b",)))
_KINDS = pairs()


def said(error: Exception) -> None:
    """What an error says is one line of some length that cannot steer a terminal."""
    text = str(error)
    assert text
    assert text.isprintable(), repr(text)
    assert len(text) < 4000, len(text)


def log(data: bytes, folder: Path) -> None:
    """An MCAP file: looked at, and replayed up to its frames."""
    path = folder / "log.mcap"
    path.write_bytes(data)
    for recover in (False, True):
        try:
            inspect_log(path, recover=recover)
        except GeomphysError as error:
            said(error)
        try:
            with FrameSource(path, WORLD, Config(recover=recover)) as source:
                frames = list(source)
                assert source.report.frames == len(frames)
        except GeomphysError as error:
            said(error)


def bag(data: bytes, folder: Path) -> None:
    """The metadata.yaml of a bag."""
    (folder / "metadata.yaml").write_bytes(data)
    try:
        inspect_log(folder, recover=True)
    except GeomphysError as error:
        said(error)


def kind_number(schema: str, encoding: str) -> int:
    """The first byte of a message or schema of a kind."""
    return _KINDS.index((schema, encoding))


def _channel(number: int, schema: bytes | None) -> LogChannel:
    made = make(*_KINDS[number % len(_KINDS)])
    known = made.schema_data if schema is None else schema
    return LogChannel(0, "/t", made.schema, made.schema_encoding, known, made.encoding, 1, 0, 0)


def message(data: bytes, folder: Path) -> None:
    """A message; the first byte says of which kind."""
    if data:
        channel = _channel(data[0], None)
        kind = kind_of(channel)
        assert kind is not None
        read = make_message_reader(channel, kind)
        with suppress(BadMessageError):
            read(data[1:])


def schema(data: bytes, folder: Path) -> None:
    """A schema, and 256 bytes as a message of it; the first byte says of which kind."""
    if data:
        channel = _channel(data[0], data[1:])
        kind = kind_of(channel)
        assert kind is not None
        try:
            read = make_message_reader(channel, kind)
        except GeomphysError as error:
            said(error)
            return
        with suppress(BadMessageError):
            read(b"\0\1\0\0" + bytes(252))


def result(data: bytes, folder: Path) -> None:
    """An output, read back."""
    path = folder / "result.mcap"
    path.write_bytes(data)
    try:
        read = open_output(path)
        read.attachments(), read.descriptions(), read.metrics(), read.timing()
        assert all(frame.time_ns >= 0 for frame in read.frames())
        statistics_of([path])
    except GeomphysError as error:
        said(error)


def scene(data: bytes, folder: Path) -> None:
    """A scene file beside a model and a mesh."""
    path = folder / "scene.toml"
    path.write_bytes(data)
    for name, text in (("model.urdf", MODEL), ("cube.obj", CUBE)):
        (folder / name).write_text(text)
    try:
        load_world(path)
    except GeomphysError as error:
        said(error)


def urdf(data: bytes, folder: Path) -> None:
    """A URDF beside a mesh."""
    path = folder / "model.urdf"
    path.write_bytes(data)
    (folder / "cube.obj").write_text(CUBE)
    try:
        load_skeleton(path)
    except GeomphysError as error:
        said(error)


def _mesh(suffix: str) -> Callable[[bytes, Path], None]:
    def mesh(data: bytes, folder: Path) -> None:
        path = folder / f"mesh.{suffix}"
        path.write_bytes(data)
        try:
            loaded = load_mesh(path)
            require_closed(loaded)
            assert abs(oriented_outwards(loaded).signed_volume) < 1e20
            assert len(loaded.hull_vertices) >= 4
        except GeomphysError as error:
            said(error)

    return mesh


MODEL = """<robot name="m"><link name="a"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="b"><collision><geometry><mesh filename="cube.obj" scale="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + "".join(
    f"f {a} {b} {c}\nf {a} {c} {d}\n"
    for a, b, c, d in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
)
TARGETS: dict[str, Callable[[bytes, Path], None]] = {
    "log": log, "bag": bag, "message": message, "schema": schema, "result": result, "scene": scene, "urdf": urdf,
    **{suffix: _mesh(suffix) for suffix in SUFFIXES},
}  # fmt: skip
"""Name -> what is done with some bytes, in an empty folder."""
