"""Encodes tf2_msgs/TFMessage and visualization_msgs/MarkerArray, for outputs that ROS 2 tools read."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.output.cdr import NS_PER_S, CdrWriter
from geomphys.output.colours import CONTACT, Colour, colours_of_trees
from geomphys.output.contact_arrows import arrow_lengths
from geomphys.output.urdf_description import WORLD
from geomphys.results import Contacts
from geomphys.scene.world import World

Floats = NDArray[np.float64]

_SEPARATOR = "=" * 80
_TIME, _HEADER = "int32 sec\nuint32 nanosec", "builtin_interfaces/Time stamp\nstring frame_id"
_XYZ, _XYZW = "float64 x\nfloat64 y\nfloat64 z", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"


def _definition(fields: str, **parts: str) -> bytes:
    """Text of a message definition with those of its parts (``package__Name``)."""
    texts = [f"{_SEPARATOR}\nMSG: {name.replace('__', '/')}\n{text}\n" for name, text in parts.items()]
    return (f"{fields}\n" + "".join(texts)).encode()


TF_DEFINITION = _definition(
    "geometry_msgs/TransformStamped[] transforms",
    geometry_msgs__TransformStamped="std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
    std_msgs__Header=_HEADER,
    builtin_interfaces__Time=_TIME,
    geometry_msgs__Transform="geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    geometry_msgs__Vector3=_XYZ,
    geometry_msgs__Quaternion=_XYZW,
)
MARKERS_DEFINITION = _definition(
    "visualization_msgs/Marker[] markers",
    visualization_msgs__Marker="std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
    "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\n"
    "bool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
    "sensor_msgs/CompressedImage texture\nvisualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
    "visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials",
    std_msgs__Header=_HEADER,
    builtin_interfaces__Time=_TIME,
    geometry_msgs__Pose="geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    geometry_msgs__Point=_XYZ,
    geometry_msgs__Quaternion=_XYZW,
    geometry_msgs__Vector3=_XYZ,
    std_msgs__ColorRGBA="float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    builtin_interfaces__Duration=_TIME,
    sensor_msgs__CompressedImage="std_msgs/Header header\nstring format\nuint8[] data",
    visualization_msgs__UVCoordinate="float32 u\nfloat32 v",
    visualization_msgs__MeshFile="string filename\nuint8[] data",
)

ARROW, TRIANGLE_LIST = 0, 11
ADD, DELETE = 0, 2
_SHAFT_M, _HEAD_M = 0.002, 0.005


class TransformsCdrEncoder:
    """tf2_msgs/TFMessage from ``world`` to a list of frames; only stamps and poses are written anew.

    Parameters
    ----------
    children : sequence of str
        Frame ids, in the order of the rows handed to `encode`.
    """

    def __init__(self, children: Sequence[str]) -> None:
        message = CdrWriter()
        message.numbers("I", len(children))
        self._offsets: list[tuple[int, int]] = []  # of stamp and pose
        for child in children:
            stamp = message.header(0, WORLD)
            message.string(child)
            message.align(8)
            self._offsets.append((stamp, message.length))
            message.numbers("d", *([0.0] * 7))
        self._data = message.data()

    def encode(self, poses: Floats, time_ns: int) -> bytes:
        """The message with world poses (n, 7): position [m] and quaternion x y z w."""
        seconds, nanos = divmod(time_ns, NS_PER_S)
        for (stamp, offset), pose in zip(self._offsets, poses.tolist(), strict=True):
            struct.pack_into("<iI", self._data, stamp, seconds, nanos)
            struct.pack_into("<7d", self._data, offset, *pose)
        return bytes(self._data)


class _Marker(NamedTuple):
    frame_id: str
    name: str
    number: int
    kind: int
    action: int = ADD
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    colour: Colour = CONTACT
    locked: bool = False
    points: Sequence[Sequence[float]] = ()  # m, in the frame


class ContactMarkersEncoder:
    """visualization_msgs/MarkerArray with an arrow along the normal at each contact; those of the frame before that are no
    longer there are deleted.
    """

    def __init__(self) -> None:
        self._shown = 0

    def encode(self, contacts: Contacts, time_ns: int, duration: float) -> bytes:
        """The message of a frame and its duration [s]; see `arrow_lengths`."""
        lengths = arrow_lengths(contacts, np.full(len(contacts.depth), duration))
        ends = contacts.point + contacts.normal * lengths[:, None]
        markers = [
            _Marker(WORLD, "contacts", k, ARROW, scale=(_SHAFT_M, _HEAD_M, _HEAD_M), points=(start, end))
            for k, (start, end) in enumerate(zip(contacts.point.tolist(), ends.tolist(), strict=True))
        ]
        gone = range(len(markers), self._shown)
        self._shown = len(markers)
        return _encode_markers([*markers, *(_Marker(WORLD, "contacts", k, ARROW, DELETE) for k in gone)], time_ns)


def encode_surface_markers(world: World, time_ns: int) -> bytes:
    """visualization_msgs/MarkerArray with the display meshes of all bodies, each moving with its frame."""
    palette = colours_of_trees(world.facts)
    markers = []
    for body, (vertices, faces) in enumerate(world.triangles):
        if len(faces):
            colour = palette[world.tree_names[world.scene.bodies.tree[body]]]
            points = vertices[faces].reshape(-1, 3).tolist()
            name, frame = world.body_names[body], world.frame_names[body]
            markers.append(_Marker(frame, name, 0, TRIANGLE_LIST, colour=colour, locked=True, points=points))
    return _encode_markers(markers, time_ns)


def _encode_markers(markers: Sequence[_Marker], time_ns: int) -> bytes:
    message = CdrWriter()
    message.numbers("I", len(markers))
    for marker in markers:
        message.header(time_ns, marker.frame_id)
        message.string(marker.name)
        message.numbers("i", marker.number, marker.kind, marker.action)
        message.numbers("d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *marker.scale)
        message.numbers("f", *(channel / 255 for channel in marker.colour))
        message.numbers("i", 0, 0)  # lifetime: for ever
        message.numbers("?", marker.locked)
        message.vectors(marker.points)
        message.numbers("I", 0)  # colours of the points
        message.string("")  # texture: its name, then an empty image
        message.header(0, "")
        message.string("")
        message.numbers("I", 0, 0)  # bytes of the image; texture coordinates
        for _ in range(3):  # text, mesh resource, name of a mesh file
            message.string("")
        message.numbers("I", 0)
        message.numbers("?", False)
    return bytes(message.data())
