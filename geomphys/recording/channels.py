"""Maps a channel to its message kind and to the function that reads its messages.

Every encoding of the same data yields the same `JointSample` or `Poses`, to the bit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from geomphys.recording.decoders import PAYLOAD_ERRORS, BadMessageError, make_decoder
from geomphys.recording.display_names import printable
from geomphys.recording.field_access import FieldAccess
from geomphys.recording.fixed_layout import FixedLayoutReader
from geomphys.recording.message_kinds import (
    ENCODINGS,
    MessageKind,
    canonical_type_name,
    encodings_of,
    find_kind,
    type_names,
)
from geomphys.recording.message_layouts import make_extractor
from geomphys.recording.reader import LogChannel
from geomphys.recording.samples import Content, ContentType, JointSample, Pose

__all__ = ["Content", "JointSample", "MessageKind", "Pose", "kind_of", "make_message_reader", "unsupported_reason"]

MESSAGE_LIMIT = 4 * 2**20
"""Bytes; a longer message of joints or poses is not decoded: decoded it would take many times that."""


MAX_CACHED_READERS = 64
"""Readers of CDR that are kept for other logs with the same types, which then know the layouts of their messages."""
CACHED_SCHEMA_BYTES = 1 << 16
"""A reader of a longer schema is made for each log."""

_cache = threading.local()  # a reader learns while it reads, and so has one thread


def kind_of(channel: LogChannel) -> MessageKind | None:
    """How a channel's messages are read; None if they are not understood."""
    return find_kind(channel.schema_name, channel.encoding)


def make_message_reader(channel: LogChannel, kind: MessageKind, *, points: bool = False) -> Callable[[bytes], Content]:
    """Make the function from a message's bytes to its content; it raises BadMessageError on bytes that hold none.

    With `points`, the poses that come along with joint values, of a kind that has them, and poses may lack an orientation.

    Raises LogError if the channel's schema cannot be read.
    """
    if channel.encoding != "cdr" or len(channel.schema_data) > CACHED_SCHEMA_BYTES:
        return _make_reader(channel, kind, points)
    readers: dict[object, FixedLayoutReader] = _cache.__dict__.setdefault("readers", {})
    key = channel.schema_name, channel.schema_encoding, channel.schema_data, kind, points
    reader = readers.get(key)
    if reader is None or reader.is_full:
        if len(readers) >= MAX_CACHED_READERS:
            readers.clear()
        reader = readers[key] = FixedLayoutReader(_make_reader(channel, kind, points))
    return reader


def _make_reader(channel: LogChannel, kind: MessageKind, points: bool) -> Callable[[bytes], Content]:
    """As `make_message_reader`, by the decoder of the encoding."""
    layout = kind.points if points and kind.points is not None else kind.layout
    decode = make_decoder(channel, canonical_type_name(channel.schema_name))
    read = make_extractor(
        layout,
        FieldAccess(channel.encoding, lenient=kind.omits_defaults and channel.encoding == "json", points=points),
    )

    def content(data: bytes) -> Content:
        if len(data) > MESSAGE_LIMIT:
            raise BadMessageError(f"of {len(data)} bytes is longer than the limit of {MESSAGE_LIMIT}")
        message = decode(data)
        try:
            return read(message)
        except PAYLOAD_ERRORS as problem:
            raise BadMessageError(f"does not hold what its type says ({type(problem).__name__})") from problem

    return content


def unsupported_reason(channel: LogChannel, accepted: tuple[ContentType, ...], holds: str) -> str:
    """Say why a channel does not provide the `accepted` content (`holds` in words), and which types would.

    It goes on a sentence that names the topic.
    """
    kind = kind_of(channel)
    what = f"({printable(channel.schema_name) or 'no schema'}, {printable(channel.encoding) or 'no encoding'})"
    if kind is not None:
        return f"{what} does not hold {holds}"
    read_in = encodings_of(channel.schema_name)
    if read_in:
        encoding_text = " or ".join(ENCODINGS[e] for e in read_in)
        return f"{what} is not understood: this type is read in {encoding_text}, so convert the log"
    if channel.encoding not in ENCODINGS:
        return f"{what} is not understood: of the encodings {', '.join(ENCODINGS)} are read, so convert the log"
    names = ", ".join(type_names(accepted))
    return f"{what} is not understood; types with {holds} that are: {names}"
