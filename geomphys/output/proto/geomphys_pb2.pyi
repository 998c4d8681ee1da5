import datetime

from google.protobuf import timestamp_pb2 as _timestamp_pb2
from foxglove_schemas_protobuf import Vector3_pb2 as _Vector3_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Contacts(_message.Message):
    __slots__ = ("timestamp", "frame", "contacts")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    CONTACTS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    contacts: _containers.RepeatedCompositeFieldContainer[Contact]
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., contacts: _Optional[_Iterable[_Union[Contact, _Mapping]]] = ...) -> None: ...

class Contact(_message.Message):
    __slots__ = ("body_a", "body_b", "point", "normal", "depth", "normal_impulse", "tangential_impulse")
    BODY_A_FIELD_NUMBER: _ClassVar[int]
    BODY_B_FIELD_NUMBER: _ClassVar[int]
    POINT_FIELD_NUMBER: _ClassVar[int]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    NORMAL_IMPULSE_FIELD_NUMBER: _ClassVar[int]
    TANGENTIAL_IMPULSE_FIELD_NUMBER: _ClassVar[int]
    body_a: str
    body_b: str
    point: _Vector3_pb2.Vector3
    normal: _Vector3_pb2.Vector3
    depth: float
    normal_impulse: float
    tangential_impulse: float
    def __init__(self, body_a: _Optional[str] = ..., body_b: _Optional[str] = ..., point: _Optional[_Union[_Vector3_pb2.Vector3, _Mapping]] = ..., normal: _Optional[_Union[_Vector3_pb2.Vector3, _Mapping]] = ..., depth: _Optional[float] = ..., normal_impulse: _Optional[float] = ..., tangential_impulse: _Optional[float] = ...) -> None: ...

class PenetrationDepths(_message.Message):
    __slots__ = ("timestamp", "frame", "pairs")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    PAIRS_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    pairs: _containers.RepeatedCompositeFieldContainer[PairPenetration]
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., pairs: _Optional[_Iterable[_Union[PairPenetration, _Mapping]]] = ...) -> None: ...

class PairPenetration(_message.Message):
    __slots__ = ("body_a", "body_b", "pd", "convex_pairs", "largest", "method")
    BODY_A_FIELD_NUMBER: _ClassVar[int]
    BODY_B_FIELD_NUMBER: _ClassVar[int]
    PD_FIELD_NUMBER: _ClassVar[int]
    CONVEX_PAIRS_FIELD_NUMBER: _ClassVar[int]
    LARGEST_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    body_a: str
    body_b: str
    pd: _Vector3_pb2.Vector3
    convex_pairs: int
    largest: float
    method: str
    def __init__(self, body_a: _Optional[str] = ..., body_b: _Optional[str] = ..., pd: _Optional[_Union[_Vector3_pb2.Vector3, _Mapping]] = ..., convex_pairs: _Optional[int] = ..., largest: _Optional[float] = ..., method: _Optional[str] = ...) -> None: ...

class FrameMetrics(_message.Message):
    __slots__ = ("timestamp", "frame", "contacts", "recorded_penetration_m", "residual_penetration_m", "iterations", "impacts", "fallbacks", "correction_m", "correction_rad", "held", "flags", "recorded_speed_m_s", "correction_speed_m_s", "recorded_jerk_m_s3", "correction_jerk_m_s3", "shape_change_rad", "amplification", "contacts_recorded", "contacts_kept", "grasps_recorded", "grasps_kept", "fingertip_error_m", "contact_precision_m", "contact_alignment_rad")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    CONTACTS_FIELD_NUMBER: _ClassVar[int]
    RECORDED_PENETRATION_M_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_PENETRATION_M_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    IMPACTS_FIELD_NUMBER: _ClassVar[int]
    FALLBACKS_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_M_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_RAD_FIELD_NUMBER: _ClassVar[int]
    HELD_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    RECORDED_SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    RECORDED_JERK_M_S3_FIELD_NUMBER: _ClassVar[int]
    CORRECTION_JERK_M_S3_FIELD_NUMBER: _ClassVar[int]
    SHAPE_CHANGE_RAD_FIELD_NUMBER: _ClassVar[int]
    AMPLIFICATION_FIELD_NUMBER: _ClassVar[int]
    CONTACTS_RECORDED_FIELD_NUMBER: _ClassVar[int]
    CONTACTS_KEPT_FIELD_NUMBER: _ClassVar[int]
    GRASPS_RECORDED_FIELD_NUMBER: _ClassVar[int]
    GRASPS_KEPT_FIELD_NUMBER: _ClassVar[int]
    FINGERTIP_ERROR_M_FIELD_NUMBER: _ClassVar[int]
    CONTACT_PRECISION_M_FIELD_NUMBER: _ClassVar[int]
    CONTACT_ALIGNMENT_RAD_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    contacts: int
    recorded_penetration_m: float
    residual_penetration_m: float
    iterations: int
    impacts: int
    fallbacks: int
    correction_m: float
    correction_rad: float
    held: bool
    flags: int
    recorded_speed_m_s: float
    correction_speed_m_s: float
    recorded_jerk_m_s3: float
    correction_jerk_m_s3: float
    shape_change_rad: float
    amplification: float
    contacts_recorded: int
    contacts_kept: int
    grasps_recorded: int
    grasps_kept: int
    fingertip_error_m: float
    contact_precision_m: float
    contact_alignment_rad: float
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., contacts: _Optional[int] = ..., recorded_penetration_m: _Optional[float] = ..., residual_penetration_m: _Optional[float] = ..., iterations: _Optional[int] = ..., impacts: _Optional[int] = ..., fallbacks: _Optional[int] = ..., correction_m: _Optional[float] = ..., correction_rad: _Optional[float] = ..., held: _Optional[bool] = ..., flags: _Optional[int] = ..., recorded_speed_m_s: _Optional[float] = ..., correction_speed_m_s: _Optional[float] = ..., recorded_jerk_m_s3: _Optional[float] = ..., correction_jerk_m_s3: _Optional[float] = ..., shape_change_rad: _Optional[float] = ..., amplification: _Optional[float] = ..., contacts_recorded: _Optional[int] = ..., contacts_kept: _Optional[int] = ..., grasps_recorded: _Optional[int] = ..., grasps_kept: _Optional[int] = ..., fingertip_error_m: _Optional[float] = ..., contact_precision_m: _Optional[float] = ..., contact_alignment_rad: _Optional[float] = ...) -> None: ...

class Timing(_message.Message):
    __slots__ = ("timestamp", "frame", "stages")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    STAGES_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    frame: int
    stages: _containers.RepeatedCompositeFieldContainer[Stage]
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., frame: _Optional[int] = ..., stages: _Optional[_Iterable[_Union[Stage, _Mapping]]] = ...) -> None: ...

class Stage(_message.Message):
    __slots__ = ("name", "ns", "count")
    NAME_FIELD_NUMBER: _ClassVar[int]
    NS_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    name: str
    ns: int
    count: int
    def __init__(self, name: _Optional[str] = ..., ns: _Optional[int] = ..., count: _Optional[int] = ...) -> None: ...
