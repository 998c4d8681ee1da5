"""Decodes ROS 2 messages whose layout does not change from one to the next: all numbers at once.

Messages of one length with the same names have their numbers at the same bytes. Which bytes these are is found by trial:
a number is written over bytes that differ between two messages, the encoding's own decoder reads the result, and the
value that has changed to that number is the one that stands there. Bytes that never differed must stay as they are, and
every other message goes to that decoder; so the content is the same, to the bit, with and without this.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.decoders import BadMessageError
from geomphys.recording.samples import Content, JointSample, Pose
from geomphys.recording.stamps import STAMP_LIMIT, stamp_of

Read = Callable[[bytes], Content]
Kind = Literal["time", "number", "unused"]
Leaves = tuple[
    Any, ...
]  # the numbers of a content: of joints the stamp and all values, of each pose its stamp and its seven

HEAD_BYTES = 4  # of CDR; alignment counts from behind it
LITTLE_ENDIAN = 1  # the second of them
ALIGNMENT = {"time": 4, "number": 8}
WINDOW_BYTES = 8  # a number, or seconds and nanoseconds
_TIME = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
MAX_BYTES = 65_536  # of a message; longer ones are left to the decoder
MAX_LAYOUTS = 16  # of a channel: as many lengths of messages
FIRST_TRIALS = 64
TRIALS_PER_MESSAGE = 4  # that the decoder has read: what does not pay costs a few times as much at most


class Window(NamedTuple):
    """Bytes that may differ, and the leaves of the content that they are."""

    start: int
    kind: Kind
    leaves: tuple[int, ...]


class JointShape(NamedTuple):
    """What a sample of joints has beside numbers."""

    names: tuple[str, ...]
    values: int
    side: str
    is_stamped: bool


class PoseShape(NamedTuple):
    """What a pose has beside numbers."""

    child: str
    frame: str
    is_stamped: bool


Shape = JointShape | tuple[PoseShape, ...]


class Columns(NamedTuple):
    """The contents of n messages of one layout: one sample of joints, or one pose, each with a stamp."""

    shape: JointShape | PoseShape
    stamps: NDArray[np.int64]  # (n,) ns
    values: NDArray[np.float64]  # (n, k) of the joints, or the seven of the pose


class FixedLayoutReader:
    """Reads messages as `read` does, and sooner once their layout is known."""

    def __init__(self, read: Read) -> None:
        self._read = read
        self._layouts: dict[int, _Layout] = {}  # by the length of the message
        self._trials = FIRST_TRIALS

    @property
    def is_full(self) -> bool:
        """Whether it has met as many lengths of messages as it can keep the layouts of."""
        return len(self._layouts) >= MAX_LAYOUTS

    def __call__(self, data: bytes) -> Content:
        """The content of a message. Raises what `read` raises."""
        layout = self._layouts.get(len(data))
        if layout is not None:
            content = layout.content(data)
            if content is not None:
                return content
        content = self._read(data)
        self._trials += TRIALS_PER_MESSAGE
        if layout is not None:
            layout.learn(data, content, self._try)
        elif len(self._layouts) < MAX_LAYOUTS and HEAD_BYTES < len(data) <= MAX_BYTES and data[1] == LITTLE_ENDIAN:
            self._layouts[len(data)] = _Layout(data, content)
        return content

    def columns(self, messages: Sequence[bytes]) -> Columns | None:
        """The contents of many messages at once; None where they are not all of one layout, known by now, with such contents."""
        layout = self._layouts.get(len(messages[0]))
        return None if layout is None else layout.columns(messages)

    def _try(self, data: bytes) -> Content | None:
        """Content of a message that was made up; None if it has none, or too many were tried."""
        if self._trials <= 0:
            return None
        self._trials -= 1
        try:
            return self._read(data)
        except BadMessageError:
            return None


class _Layout:
    """Where the numbers stand in messages of one length, as far as it is known."""

    def __init__(self, data: bytes, content: Content) -> None:
        self._adopt(data, content, [])

    def _adopt(self, data: bytes, content: Content, windows: list[Window]) -> None:
        """Go on from a message and what is known of its bytes."""
        self._data, self._shape, self._constants = data, _shape_of(content), _leaves_of(content)
        self._windows, self._known = windows, _covered(len(data), windows)
        self._mask = int.from_bytes(bytes(0 if known else 255 for known in self._known), "little")
        self._fixed = int.from_bytes(data, "little") & self._mask
        codes, end, fields = "<", 0, 0
        sources: dict[int, int] = {}  # leaf -> its index among the numbers, the times, and the leaves of `content`
        times: list[tuple[int, Window]] = []
        for window in sorted(w for w in windows if w.kind != "unused"):
            codes += f"{window.start - end}x" + ("d" if window.kind == "number" else "iI")
            end = window.start + WINDOW_BYTES
            if window.kind == "number":
                sources |= dict.fromkeys(window.leaves, fields)
                fields += 1
            else:
                times.append((fields, window))
                fields += 2
        for k, (_, window) in enumerate(times):
            sources |= dict.fromkeys(window.leaves, fields + k)
        first_constant = fields + len(times)
        self._numbers, self._times = struct.Struct(codes), [at for at, _ in times]
        leaves = range(len(self._constants))
        self._pick = itemgetter(*(sources.get(leaf, first_constant + leaf) for leaf in leaves)) if windows else None
        self._columns: _ColumnBytes | None = None

    def content(self, data: bytes) -> Content | None:
        """Content of a message of that length; None if it is of another layout, or has a time that cannot be."""
        if self._pick is None or int.from_bytes(data, "little") & self._mask != self._fixed:
            return None
        numbers = self._numbers.unpack_from(data)
        try:
            times = [stamp_of(numbers[at], numbers[at + 1]) for at in self._times]
        except ValueError:
            return None
        return _content_of(self._shape, self._pick((*numbers, *times, *self._constants)))

    def columns(self, messages: Sequence[bytes]) -> Columns | None:
        """See `FixedLayoutReader.columns`."""
        shape = (
            self._shape if isinstance(self._shape, JointShape) else self._shape[0] if len(self._shape) == 1 else None
        )
        if self._pick is None or shape is None:
            return None
        if self._columns is None:
            self._columns = _ColumnBytes.of(self._data, self._windows, self._constants, self._mask)
        at = self._columns
        if at.stamp is None or {*map(len, messages)} != {len(self._data)}:
            return None
        rows = np.frombuffer(b"".join(messages), np.uint8).reshape(len(messages), -1)
        if ((rows ^ at.reference) & at.fixed).any():
            return None
        stamps = np.ascontiguousarray(rows[:, at.stamp : at.stamp + WINDOW_BYTES]).view(_TIME)[:, 0]
        times = stamps["sec"].astype(np.int64) * 10**9 + stamps["nanosec"]
        if times.min() < 0 or times.max() >= STAMP_LIMIT:
            return None
        values = np.tile(at.constants, (len(messages), 1))
        values[:, at.leaves] = np.ascontiguousarray(rows[:, at.numbers]).view("<f8")
        return Columns(shape, times, values)

    def learn(self, data: bytes, content: Content, trial: Callable[[bytes], Content | None]) -> None:
        """Find out what the bytes are that differ in this message."""
        if _shape_of(content) != self._shape or len(self._constants) < 2:
            return
        differing = [p for p in range(HEAD_BYTES, len(data)) if data[p] != self._data[p] and not self._known[p]]
        trials, windows = _Trials(data, self._data, content, trial), list(self._windows)
        stamps = {struct.pack("<iI", *divmod(t, 10**9)) for t in trials.stamps}
        for kind in ("time", "number"):
            known = _covered(len(data), windows)
            starts = [
                s for s in _starts(kind, (p for p in differing if not known[p])) if not any(known[s : s + WINDOW_BYTES])
            ]
            if kind == "time":
                starts = [s for s in starts if data[s : s + WINDOW_BYTES] in stamps]
            windows += trials.windows(kind, [s for s in starts if HEAD_BYTES <= s <= len(data) - WINDOW_BYTES])
        self._adopt(data, content, windows)


class _ColumnBytes(NamedTuple):
    """Which bytes of the messages of a layout the numbers of a content are."""

    reference: NDArray[np.uint8]  # (size,) a message
    fixed: NDArray[np.uint8]  # (size,) 255 where all messages have its bytes
    stamp: int | None  # where the stamp begins; None: it is not known to be the only time
    numbers: NDArray[np.int64]  # (8 m,) bytes of the numbers
    leaves: NDArray[np.int64]  # (m,) which values these are
    constants: NDArray[np.float64]  # (k,) the values in that message

    @classmethod
    def of(cls, data: bytes, windows: Sequence[Window], constants: Leaves, mask: int) -> _ColumnBytes:
        """Those of the layout with these windows, of a message and the leaves of its content."""
        times = [window for window in windows if window.kind == "time"]
        numbers = [(window.start, leaf - 1) for window in windows if window.kind == "number" for leaf in window.leaves]
        return cls(
            np.frombuffer(data, np.uint8),
            np.frombuffer(mask.to_bytes(len(data), "little"), np.uint8),
            times[0].start if len(times) == 1 and times[0].leaves == (0,) else None,
            np.array([start + k for start, _ in numbers for k in range(WINDOW_BYTES)], np.int64),
            np.array([leaf for _, leaf in numbers], np.int64),
            np.array(constants[1:], np.float64),
        )


def _covered(size: int, windows: Iterable[Window]) -> bytearray:
    """1 for each of `size` bytes that stands in a window, else 0."""
    covered = bytearray(size)
    for window in windows:
        covered[window.start : window.start + WINDOW_BYTES] = b"\1" * WINDOW_BYTES
    return covered


def _starts(kind: Literal["time", "number"], differing: Iterable[int]) -> list[int]:
    """Where windows may begin that hold bytes which differ; of times, either half may."""
    step = ALIGNMENT[kind]
    begins = (p - (p - HEAD_BYTES) % step for p in differing)
    return list(dict.fromkeys(start for begin in begins for start in range(begin, begin - WINDOW_BYTES, -step)))


class _Trials:
    """Writes over bytes of a message and looks what becomes of its content; `other` is a message with other bytes there."""

    def __init__(self, data: bytes, other: bytes, content: Content, trial: Callable[[bytes], Content | None]) -> None:
        self._data, self._other, self._trial = data, other, trial
        self._shape, self._leaves = _shape_of(content), _leaves_of(content)
        self.stamps = {leaf for leaf in self._leaves if isinstance(leaf, int)}

    def windows(self, kind: Literal["time", "number"], starts: Sequence[int]) -> list[Window]:
        """Of windows that begin at `starts`, those that hold numbers, or times; or, of the former, nothing that is used."""
        if not starts:
            return []
        feeds = [self._fed(kind, starts, sign) for sign in (1, -1)]
        if feeds[0] is None or feeds[0] != feeds[1]:
            return self._halves(kind, starts)
        found = [Window(s, kind, leaves) for s, leaves in zip(starts, feeds[0], strict=True) if leaves]
        unused = [s for s, leaves in zip(starts, feeds[0], strict=True) if not leaves] if kind == "number" else []
        for fill in (b"\xff", b"\0", None) if unused else ():
            pieces = (self._other[s : s + WINDOW_BYTES] if fill is None else fill * WINDOW_BYTES for s in unused)
            if self._changed(dict(zip(unused, pieces, strict=True))) != {}:
                return self._halves(kind, starts)
        return found + [Window(s, "unused", ()) for s in unused]

    def _halves(self, kind: Literal["time", "number"], starts: Sequence[int]) -> list[Window]:
        """The same of fewer windows at once: one of them holds something else."""
        if len(starts) == 1:
            return []
        middle = len(starts) // 2
        return self.windows(kind, starts[:middle]) + self.windows(kind, starts[middle:])

    def _fed(self, kind: Literal["time", "number"], starts: Sequence[int], sign: int) -> list[tuple[int, ...]] | None:
        """The leaves that change to what is written at each start; None where something else changes."""
        if kind == "number":
            values: list[float] = [sign * (k + 0.625) for k in range(len(starts))]
            pieces = [struct.pack("<d", value) for value in values]
        else:
            values = [
                (1_000_000_000 + 499_999_999 * (1 + sign) + k) * 10**9 + 500 - 3 * sign for k in range(len(starts))
            ]
            pieces = [struct.pack("<iI", *divmod(value, 10**9)) for value in values]
        changed = self._changed(dict(zip(starts, pieces, strict=True)))
        if changed is None or not set(changed.values()) <= set(values):
            return None
        return [tuple(leaf for leaf, found in changed.items() if found == value) for value in values]

    def _changed(self, written: dict[int, bytes]) -> dict[int, Any] | None:
        """Leaves that are others with these bytes, and what they are; None if that is no content of this shape."""
        data = bytearray(self._data)
        for start, piece in written.items():
            data[start : start + WINDOW_BYTES] = piece
        content = self._trial(bytes(data))
        if content is None or _shape_of(content) != self._shape:
            return None
        pairs = enumerate(zip(_leaves_of(content), self._leaves, strict=True))
        return {leaf: new for leaf, (new, old) in pairs if new != old and not (new != new and old != old)}


def _shape_of(content: Content) -> Shape:
    """What a content has beside numbers."""
    if isinstance(content, JointSample):
        return JointShape(tuple(content.names), len(content.values), content.side, content.stamp is not None)
    return tuple(PoseShape(pose.child, pose.frame, pose.stamp is not None) for pose in content)


def _leaves_of(content: Content) -> Leaves:
    """The numbers of a content."""
    if isinstance(content, JointSample):
        return (content.stamp, *content.values)
    return tuple(leaf for pose in content for leaf in (pose.stamp, *pose.value))


def _content_of(shape: Shape, leaves: Leaves) -> Content:
    """The content of a shape with these numbers."""
    if isinstance(shape, JointShape):
        return JointSample(leaves[0], shape.names, leaves[1:], shape.side)
    return [Pose(leaves[8 * k], pose.child, leaves[8 * k + 1 : 8 * k + 8], pose.frame) for k, pose in enumerate(shape)]
