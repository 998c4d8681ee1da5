"""Computes the arrays (columns) of outputs from the results of many frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.output.contact_arrows import ARROW_SCALE, MAX_ARROW_LENGTH, arrow_lengths, frame_durations
from geomphys.results import Contacts, Penetrations, ResultColumns

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


def all_contacts(results: ResultColumns) -> RaggedContacts:
    """The contacts of the frames."""
    return RaggedContacts(results.contacts, results.contact_counts)


def all_penetrations(results: ResultColumns) -> RaggedPenetrations:
    """The penetration depths of the frames."""
    return RaggedPenetrations(results.penetrations, results.penetration_counts)


def is_corrected(recorded: Floats, corrected: Floats) -> Flags:
    """(n, b) whether a body is drawn as corrected: its pose differs visibly from the recorded one; poses are (n, b, 7)."""
    is_moved: Flags = np.abs(corrected - recorded).max(axis=2) > CORRECTION_THRESHOLD
    return is_moved


def in_contact(results: ResultColumns, bodies: int) -> Flags:
    """(n, b) whether a body has a contact in a frame."""
    touched = np.zeros((len(results), bodies), bool)
    rows = np.repeat(np.arange(len(results)), results.contact_counts)
    touched[rows, results.contacts.body_a] = True
    touched[rows, results.contacts.body_b] = True
    return touched


def changed_rows(rows: NDArray[np.generic], before: NDArray[np.generic] | None) -> Flags:
    """(n,) whether a row of (n, k) differs from its predecessor; `before` is that of the first row, None if it has none."""
    changed = np.ones(len(rows), bool)
    if before is not None:
        changed[0] = bool((rows[0] != before).any())
    changed[1:] = (rows[1:] != rows[:-1]).any(axis=1)
    return changed


def rows_with_content(counts: Ints, before: int) -> tuple[Ints, Ints]:
    """Rows with content, or directly after one with content, and their counts; `before` is the count before the first."""
    previous = np.concatenate([[before], counts[:-1]])
    rows = np.flatnonzero((counts > 0) | (previous > 0))
    return rows, counts[rows]


def contact_arrows(results: ResultColumns, before_ns: int | None) -> tuple[Floats, Floats]:
    """Points (k, 3) and arrows (k, 3) of all contacts of the frames, m; `before_ns` is the time of the frame before the first."""
    contacts, counts = all_contacts(results)
    durations = frame_durations(results.times_ns, before_ns)
    return contacts.point, contacts.normal * arrow_lengths(contacts, np.repeat(durations, counts))[:, None]


def depth_arrows(results: ResultColumns) -> tuple[Floats, Floats]:
    """Origins (k, 3) and arrows (k, 3) of the global penetration depths of the frames, m.

    An arrow starts at the mean contact point of its pair, or at the recorded origin of body_a if it has no contact.
    """
    contacts, pairs, bodies = results.contacts, results.penetrations, results.recorded.shape[1]
    rows = np.repeat(np.arange(len(results)), results.penetration_counts)
    numbers, of_pair = np.unique(_pair_numbers(rows, pairs.body_a, pairs.body_b, bodies), return_inverse=True)
    contact_rows = np.repeat(np.arange(len(results)), results.contact_counts)
    of_contact = _pair_numbers(contact_rows, contacts.body_a, contacts.body_b, bodies)
    found = np.searchsorted(numbers, of_contact)
    known = numbers[np.minimum(found, len(numbers) - 1)] == of_contact if len(numbers) else np.zeros(len(found), bool)
    sums, counts = np.full((len(numbers), 3), -0.0), np.bincount(found[known], minlength=len(numbers))
    np.add.at(sums, found[known], contacts.point[known])
    means = sums / np.maximum(counts, 1)[:, None]
    origins = np.where((counts > 0)[of_pair, None], means[of_pair], results.recorded[rows, pairs.body_a, :3])
    lengths = np.linalg.norm(pairs.pd, axis=1, keepdims=True)
    scales = np.minimum(
        ARROW_SCALE, np.divide(MAX_ARROW_LENGTH, lengths, out=np.zeros_like(lengths), where=lengths > 0)
    )
    return origins, scales * pairs.pd


def _pair_numbers(rows: Ints, body_a: Ints, body_b: Ints, bodies: int) -> Ints:
    """A number (k,) for each row and unordered pair of bodies."""
    numbers: Ints = (rows * bodies + np.minimum(body_a, body_b)) * bodies + np.maximum(body_a, body_b)
    return numbers


def plot_values(results: ResultColumns) -> dict[str, Floats]:
    """Plot name -> (n,) values, in the units named by the plots."""
    m, pd = results.metrics, results.penetrations.pd
    deepest = np.zeros(len(results))
    rows = np.repeat(np.arange(len(results)), results.penetration_counts)
    np.maximum.at(deepest, rows, np.sqrt(np.einsum("ij,ij->i", pd, pd)))
    return {
        "penetration_mm/recorded": 1e3 * m["recorded_penetration_m"],
        "penetration_mm/global": 1e3 * deepest,
        "penetration_mm/remaining": 1e3 * m["residual_penetration_m"],
        "correction/mm": 1e3 * m["correction_m"],
        "correction/degrees": np.degrees(m["correction_rad"]),
        "contacts/contacts": m["contacts"].astype(np.float64),
        "contacts/impacts": m["impacts"].astype(np.float64),
    }


def stage_times(results: ResultColumns, depth: int) -> dict[str, Floats]:
    """Stage name -> times (n,) [µs] of ``step`` and its stages, with at most `depth` parts in their names.

    Decoding and encoding are left out: they work in batches, and their spikes would hide the other curves.
    """
    return {
        name: ns / 1e3
        for name, ns in zip(results.stages, results.stage_ns.T, strict=True)
        if name.split(".")[0] == "step" and name.count(".") < depth
    }
