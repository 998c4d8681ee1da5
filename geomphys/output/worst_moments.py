"""Finds the worst moments of a replay: deepest overlap, largest correction, largest amplification, most lost contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geomphys.results import FrameResult, Moment, ResultColumns
from geomphys.scene.frame_ids import RECORDED_PREFIX
from geomphys.scene.intersection_volume import intersection_volume
from geomphys.scene.world import World

if TYPE_CHECKING:
    from geomphys.output.output_log import OutputFrame

Floats = NDArray[np.float64]

LABELS = {
    "recorded_penetration": "deepest recorded overlap",
    "correction": "largest correction",
    "amplification": "largest amplification",
    "contacts_lost": "most contacts lost",
    "fallbacks": "most fallbacks",
}
"""Kind of a moment -> its label."""

MIN_CORRECTION_M = 1e-5
"""m; overlaps and corrections up to this are not worth a look."""


def figure_text(moment: Moment) -> str:
    """What a moment is, its figure and the bodies, without its frame."""
    value = f"{1e3 * moment.value:.3g} mm" if moment.unit == "m" else f"{moment.value:.3g}"
    value += " times the recorded depth" if moment.kind == "amplification" else ""
    joint = " in " if moment.kind in ("recorded_penetration", "contacts_lost") else ", "
    bodies = f": {joint.join(moment.bodies)}" if moment.bodies else ""
    volume = f", {1e6 * moment.volume_m3:.3g} cm³ in common" if moment.volume_m3 is not None else ""
    return f"{LABELS[moment.kind]} {value}{bodies}{volume}"


def command_text(moment: Moment, output: str = "OUT") -> str:
    """The command that shows a moment of an output."""
    return f"geomphys snapshot {quote(output)} --frame {moment.frame} -o frame_{moment.frame}.png"


def log_text(moment: Moment) -> str:
    """A moment as a line of the log."""
    return f"{figure_text(moment)}; frame {moment.frame}, {moment.time_s:.2f} s; {command_text(moment)}"


def document_text(moments: Sequence[Moment]) -> str:
    """The moments in Markdown, with their commands: a viewer wraps a document, but cuts the lines of its log."""
    return "".join(
        f"**{figure_text(moment)}**, frame {moment.frame}, {moment.time_s:.2f} s:\n\n`{command_text(moment)}`\n\n"
        for moment in moments
    )


@dataclass
class WorstMoments:
    """Keeps the first of the worst frames of each kind; memory does not grow with the frames.

    `body_names` are those of the world that is replayed; they are not needed for frames of outputs.
    """

    body_names: tuple[str, ...] = ()
    _first_ns: int | None = None
    _found: dict[str, Moment] = field(default_factory=dict)
    _deepest: tuple[tuple[int, int], Floats] | None = None  # bodies and recorded poses (2, 7) of the deepest overlap

    def add(self, result: FrameResult) -> None:
        """Take a frame of a replay."""
        self.add_columns(ResultColumns.of(result))

    def add_columns(self, columns: ResultColumns) -> None:
        """Take frames of a replay."""
        if self._first_ns is None:
            self._first_ns = int(columns.times_ns[0])
        m = columns.metrics
        lost = m["contacts_recorded"] - m["contacts_kept"]
        values = _values(m["recorded_penetration_m"], m["correction_m"], m["amplification"], lost, m["fallbacks"])
        for kind, column in values.items():
            row = int(column.argmax())
            result = columns.result(row) if self._is_worse(kind, float(column[row])) else None
            if result is None:
                continue
            frame = result.frame
            self._set(kind, frame.index, frame.time_ns, float(column[row]), self._bodies(kind, result))
            if kind == "recorded_penetration" and (pair := _deepest_pair(result)) is not None:
                self._deepest = (pair, result.recorded[list(pair)])

    def add_output(self, frame: OutputFrame) -> None:
        """Take a frame of an output; its channels ``/metrics``, ``/penetration`` and poses are used as far as they were read."""
        if self._first_ns is None:
            self._first_ns = frame.time_ns
        m = frame.metrics
        lost = m["contacts_recorded"] - m["contacts_kept"]
        values = _values(m["recorded_penetration_m"], m["correction_m"], m["amplification"], lost, m["fallbacks"])
        for kind, value in values.items():
            if self._is_worse(kind, float(value)):
                self._set(kind, frame.index, frame.time_ns, float(value), _bodies_of_output(kind, frame))

    def moments(self, volume_m3: float | None = None) -> tuple[Moment, ...]:
        """The moments so far, in the order of `LABELS`; `volume_m3` is that of the deepest recorded overlap, if it is known."""
        found = dict(self._found)
        if "recorded_penetration" in found:
            found["recorded_penetration"] = replace(found["recorded_penetration"], volume_m3=volume_m3)
        return tuple(found[kind] for kind in LABELS if kind in found)

    def intersection_volume(self, world: World) -> float | None:
        """Volume common to the two bodies of the deepest recorded overlap [m³]; None without one, or if a surface is open."""
        return None if self._deepest is None else intersection_volume(world, *self._deepest)

    def _is_worse(self, kind: str, value: float) -> bool:
        return value > 0.0 and (kind not in self._found or value > self._found[kind].value)

    def _set(self, kind: str, frame: int, time_ns: int, value: float, bodies: tuple[str, ...]) -> None:
        assert self._first_ns is not None
        self._found[kind] = Moment(
            kind=kind,
            frame=frame,
            time_ns=time_ns,
            time_s=(time_ns - self._first_ns) / 1e9,
            bodies=bodies,
            value=value,
            unit="m" if kind in ("recorded_penetration", "correction") else "",
        )

    def _bodies(self, kind: str, result: FrameResult) -> tuple[str, ...]:
        if kind in ("correction", "amplification"):
            distances = np.linalg.norm(result.corrected[:, :3] - result.recorded[:, :3], axis=1)
            return (self.body_names[int(distances.argmax())],)
        pair = _deepest_pair(result)
        return () if pair is None else (self.body_names[pair[0]], self.body_names[pair[1]])


def _deepest_pair(result: FrameResult) -> tuple[int, int] | None:
    """The bodies of the deepest recorded overlap of a frame."""
    pairs = result.penetrations
    if len(pairs.largest) == 0:
        return None
    row = int(pairs.largest.argmax())
    return int(pairs.body_a[row]), int(pairs.body_b[row])


def _values(recorded_m: Any, correction_m: Any, amplification: Any, lost: Any, fallbacks: Any) -> dict[str, Any]:
    """The value of each kind: numbers, or columns (n,) of them."""
    values = {"recorded_penetration": recorded_m, "correction": correction_m}
    values = {kind: np.where(np.greater(value, MIN_CORRECTION_M), value, 0.0) for kind, value in values.items()}
    return values | {"amplification": amplification, "contacts_lost": lost, "fallbacks": fallbacks}


def _bodies_of_output(kind: str, frame: OutputFrame) -> tuple[str, ...]:
    if kind in ("correction", "amplification"):
        rows = {name: row for row, name in enumerate(frame.tf.names)}
        names = [name.removeprefix(RECORDED_PREFIX) for name in frame.recorded.names]
        if not names or any(name not in rows for name in names):
            return ()
        corrected = frame.tf.values[[rows[name] for name in names], :3]
        return (names[int(np.linalg.norm(corrected - frame.recorded.values[:, :3], axis=1).argmax())],)
    if not frame.penetrations:
        return ()
    deepest = max(frame.penetrations, key=lambda pair: pair.largest)
    return (deepest.body_a, deepest.body_b)
