"""Even samples: every item whose number is a multiple of a power of two, fewer than the capacity."""

from __future__ import annotations

import pytest

from geomphys.numerics.even_samples import EvenSamples


@pytest.mark.parametrize("capacity", [4, 7, 64])
@pytest.mark.parametrize("length", [0, 1, 5, 64, 1000])
def test_items_at_multiples_of_a_power_of_two_are_samples(length: int, capacity: int) -> None:
    samples = EvenSamples[int](capacity)
    for item in range(length):
        samples.offer(item)
    strides = (2**k for k in range(11))
    assert samples.items == next(list(range(0, length, s)) for s in strides if len(range(0, length, s)) < capacity)


def test_few_items_are_made_that_are_no_samples() -> None:
    samples, made = EvenSamples[int](4), []
    for item in range(100):
        if samples.takes_next():
            made.append(item)
            samples.append(item)
    assert len(made) < 20
    assert set(samples.items) <= set(made)
