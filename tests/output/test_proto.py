"""The project's own messages: the generated code is fresh, and names stay as they are promised."""

from __future__ import annotations

import pytest

from geomphys.output.proto import geomphys_pb2
from geomphys.output.proto.generate import stale
from geomphys.results import Metrics

PROMISED = {
    "Contacts": "timestamp frame contacts",
    "Contact": "body_a body_b point normal depth normal_impulse tangential_impulse",
    "PenetrationDepths": "timestamp frame pairs",
    "PairPenetration": "body_a body_b pd convex_pairs largest method",
    "FrameMetrics": (
        "timestamp frame contacts recorded_penetration_m residual_penetration_m iterations impacts fallbacks "
        "correction_m correction_rad held flags "
        "recorded_speed_m_s correction_speed_m_s recorded_jerk_m_s3 correction_jerk_m_s3 shape_change_rad "
        "amplification contacts_recorded contacts_kept grasps_recorded grasps_kept fingertip_error_m "
        "contact_precision_m contact_alignment_rad"
    ),
    "Timing": "timestamp frame stages",
    "Stage": "name ns count",
}


def test_generated_code_is_fresh() -> None:
    assert stale() == []


@pytest.mark.parametrize("name", PROMISED)
def test_fields_are_those_promised(name: str) -> None:
    fields = [field.name for field in getattr(geomphys_pb2, name).DESCRIPTOR.fields]
    assert fields == PROMISED[name].split()


def test_vectors_are_foxgloves_and_times_are_googles() -> None:
    contact, contacts = geomphys_pb2.Contact.DESCRIPTOR, geomphys_pb2.Contacts.DESCRIPTOR
    assert contact.fields_by_name["point"].message_type.full_name == "foxglove.Vector3"
    assert contact.fields_by_name["normal"].message_type.full_name == "foxglove.Vector3"
    pd = geomphys_pb2.PairPenetration.DESCRIPTOR.fields_by_name["pd"]
    assert pd.message_type.full_name == "foxglove.Vector3"
    assert contacts.fields_by_name["timestamp"].message_type.full_name == "google.protobuf.Timestamp"


def test_every_figure_of_a_frame_has_its_field() -> None:
    fields = {field.name for field in geomphys_pb2.FrameMetrics.DESCRIPTOR.fields}
    assert fields - set(Metrics._fields) == {"timestamp", "frame"}
    assert set(Metrics._fields) < fields
