"""Writes the output as a ROS 2 bag in MCAP: what ``ros2 bag play``, RViz and rosbags read, all of it in CDR."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geomphys.output.byte_strings import ByteStrings
from geomphys.output.encoders import JOINT_STATE_DEFINITION, STRING_DEFINITION
from geomphys.output.mcap_sink import Column, McapSink
from geomphys.output.ros2_messages import (
    MARKERS_DEFINITION,
    TF_DEFINITION,
    ContactMarkersEncoder,
    TransformsCdrEncoder,
    encode_surface_markers,
)
from geomphys.results import ResultColumns
from geomphys.scene.arrays import DRIVEN

_LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service of topics with one message: kept for subscribers that come later (transient local)."""


class Ros2Sink(McapSink):
    """Writes a bag of profile ``ros2`` with its attachments and metadata as in other outputs.

    ``/tf`` has the bodies that move, every frame, ``/tf_static`` the others, ``/recorded/tf`` the driven ones as recorded;
    ``/contacts/markers`` an arrow for each contact. ``/meshes`` has the display meshes. Metrics, stage times and the log, whose
    messages ROS 2 does not know, are not in it.
    """

    profile = "ros2"

    def _declare_channels(self) -> None:
        string = self._file.register_schema("std_msgs/msg/String", "ros2msg", STRING_DEFINITION)
        transforms = self._file.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", TF_DEFINITION)
        markers = self._file.register_schema("visualization_msgs/msg/MarkerArray", "ros2msg", MARKERS_DEFINITION)
        joints = self._file.register_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE_DEFINITION)
        once = {**dict.fromkeys(self._descriptions, string), "/meshes": markers, "/tf_static": transforms}
        self._channels = {
            topic: self._file.register_channel(topic, "cdr", schema, {"offered_qos_profiles": _LATCHED})
            for topic, schema in once.items()
        }
        self._joints = self._joint_encoders()
        every = {"/tf": transforms, "/recorded/tf": transforms, "/contacts/markers": markers}
        every |= {topic: joints for topic, *_ in self._joints}
        for topic, schema in every.items():
            self._channels[topic] = self._file.register_channel(topic, "cdr", schema)

    def _prepare_messages(self) -> None:
        world = self._world
        self._moving = self._moving_bodies()
        self._still = np.setdiff1d(np.arange(len(world.frame_names)), self._moving)
        self._driven = np.flatnonzero(world.scene.bodies.role == DRIVEN)
        names = world.frame_names
        self._tf = TransformsCdrEncoder([names[b] for b in self._moving])
        self._tf_static = TransformsCdrEncoder([names[b] for b in self._still])
        self._tf_recorded = TransformsCdrEncoder([f"recorded/{names[b]}" for b in self._driven])
        self._markers = ContactMarkersEncoder()

    def _columns(self, results: ResultColumns) -> Iterator[Column]:
        every, times = np.arange(len(results)), results.times_ns.tolist()
        if not self._has_transforms:
            self._has_transforms = True
            still = self._tf_static.encode(results.corrected[0, self._still], times[0])
            yield Column("/tf_static", every[:1], ByteStrings.of([still]))
        for topic, encoder, poses in (
            ("/tf", self._tf, results.corrected[:, self._moving]),
            ("/recorded/tf", self._tf_recorded, results.recorded[:, self._driven]),
        ):
            yield Column(topic, every, ByteStrings.of(map(encoder.encode, poses, times)))
        yield from self._encode_joints(results)
        durations = self._durations(results.times_ns).tolist()
        contacts = [results.result(row).contacts for row in range(len(results))]
        yield Column("/contacts/markers", every, ByteStrings.of(map(self._markers.encode, contacts, times, durations)))

    def _lines(self, results: ResultColumns) -> Iterator[tuple[int, int, int, bytes]]:
        return iter(())

    def _write_surfaces(self, time: int) -> None:
        self._write_message("/meshes", encode_surface_markers(self._world, time), time)
