"""Converts a batch of frame results to the arrays (columns) of the rerun recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.output.contact_arrows import ARROW_SCALE, MAX_ARROW_LENGTH, arrow_lengths, frame_durations
from geomphys.results import Contacts, FrameResult, Penetrations

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

CORRECTION_THRESHOLD = 1e-4
"""Difference of a coordinate [m] or quaternion component above which a body is drawn as corrected."""


class RaggedContacts(NamedTuple):
    """The contacts of n frames one after another, and how many are of each."""

    columns: Contacts
    counts: Ints  # (n,)


class RaggedPenetrations(NamedTuple):
    """The penetration depths of n frames one after another, and how many are of each."""

    columns: Penetrations
    counts: Ints  # (n,)


def all_contacts(results: Sequence[FrameResult]) -> RaggedContacts:
    """The contacts of the frames."""
    columns = zip(*(result.contacts for result in results), strict=True)
    counts = np.array([len(result.contacts.depth) for result in results], np.int64)
    return RaggedContacts(Contacts(*map(np.concatenate, columns)), counts)


def all_penetrations(results: Sequence[FrameResult]) -> RaggedPenetrations:
    """The penetration depths of the frames."""
    columns = zip(*(result.penetrations for result in results), strict=True)
    counts = np.array([len(result.penetrations.largest) for result in results], np.int64)
    return RaggedPenetrations(Penetrations(*map(np.concatenate, columns)), counts)


def is_corrected(recorded: Floats, corrected: Floats) -> Flags:
    """(n, b) whether a body is drawn as corrected: its pose differs visibly from the recorded one; poses are (n, b, 7)."""
    is_moved: Flags = np.abs(corrected - recorded).max(axis=2) > CORRECTION_THRESHOLD
    return is_moved


def in_contact(results: Sequence[FrameResult], bodies: int) -> Flags:
    """(n, b) whether a body has a contact in a frame."""
    touched = np.zeros((len(results), bodies), bool)
    for row, result in enumerate(results):
        touched[row, result.contacts.body_a] = True
        touched[row, result.contacts.body_b] = True
    return touched


def changed_rows(rows: NDArray[np.generic], before: NDArray[np.generic] | None) -> Flags:
    """(n,) whether a row of (n, k) differs from its predecessor; `before` is that of the first row, None if it has none."""
    changed = np.ones(len(rows), bool)
    if before is not None:
        changed[0] = bool((rows[0] != before).any())
    changed[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return changed


def rows_with_content(counts_per_frame: Sequence[int], before: int) -> tuple[Ints, Ints]:
    """Rows with content, or directly after one with content, and their counts; `before` is the count before the first."""
    counts = np.array(counts_per_frame)
    previous = np.concatenate([[before], counts[:-1]])
    rows = np.flatnonzero((counts > 0) | (previous > 0))
    return rows, counts[rows]


def contact_arrows(results: Sequence[FrameResult], before_ns: int | None) -> tuple[Floats, Floats]:
    """Points (k, 3) and arrows (k, 3) of all contacts of the frames, m; `before_ns` is the time of the frame before the first."""
    contacts, counts = all_contacts(results)
    durations = frame_durations(np.array([result.frame.time_ns for result in results]), before_ns)
    return contacts.point, contacts.normal * arrow_lengths(contacts, np.repeat(durations, counts))[:, None]


def depth_arrows(results: Sequence[FrameResult]) -> tuple[Floats, Floats]:
    """Origins (k, 3) and arrows (k, 3) of the global penetration depths of the frames, m.

    An arrow starts at the mean contact point of its pair, or at the recorded origin of body_a if it has no contact.
    """
    origins: list[Floats] = []
    for result in results:
        contacts, pairs = result.contacts, result.penetrations
        for a, b in zip(pairs.body_a, pairs.body_b, strict=True):
            same = (contacts.body_a == a) & (contacts.body_b == b) | (contacts.body_a == b) & (contacts.body_b == a)
            origins.append(contacts.point[same].mean(axis=0) if same.any() else result.recorded[a, :3])
    vectors = np.concatenate([result.penetrations.pd for result in results])
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    scales = np.minimum(
        ARROW_SCALE, np.divide(MAX_ARROW_LENGTH, lengths, out=np.zeros_like(lengths), where=lengths > 0)
    )
    return np.array(origins).reshape(-1, 3), scales * vectors


def plot_values(results: Sequence[FrameResult]) -> dict[str, Floats]:
    """Plot name -> (n,) values, in the units named by the plots."""
    metrics = [result.metrics for result in results]
    deepest = [
        float(np.sqrt(np.einsum("ij,ij->i", r.penetrations.pd, r.penetrations.pd)).max(initial=0.0)) for r in results
    ]
    return {
        "penetration_mm/recorded": 1e3 * np.array([m.recorded_penetration_m for m in metrics]),
        "penetration_mm/global": 1e3 * np.array(deepest),
        "penetration_mm/remaining": 1e3 * np.array([m.residual_penetration_m for m in metrics]),
        "correction/mm": 1e3 * np.array([m.correction_m for m in metrics]),
        "correction/degrees": np.degrees([m.correction_rad for m in metrics]),
        "contacts/contacts": np.array([m.contacts for m in metrics], float),
        "contacts/impacts": np.array([m.impacts for m in metrics], float),
    }


def stage_times(results: Sequence[FrameResult], depth: int) -> dict[str, tuple[Ints, Floats]]:
    """Stage name -> rows and times [µs] of ``step`` and its stages, with at most `depth` parts in their names.

    Decoding and encoding are left out: they work in batches, and their spikes would hide the other curves.
    """
    touched: dict[str, tuple[list[int], list[float]]] = {}
    for row, result in enumerate(results):
        for name, ns, _ in result.timing:
            if name.split(".")[0] == "step" and name.count(".") < depth:
                rows, values = touched.setdefault(name, ([], []))
                rows.append(row)
                values.append(ns / 1e3)
    return {name: (np.array(rows), np.array(values)) for name, (rows, values) in touched.items()}
