"""Records in a chunk, one after another and many at a time."""

from __future__ import annotations

import random
import struct

import pytest
from mcap.opcode import Opcode

from geomphys.recording import mcap_records
from geomphys.recording.mcap_records import MESSAGE, heads_of_records, walk


def chunk(rng: random.Random) -> bytes:
    """Up to 20 messages and other records, some of them cut off or longer than what is there."""
    data = b""
    for number in range(rng.randrange(20)):
        body = MESSAGE.pack(number, 7 * number, 2**63 + number, 2**64 - 1 - number) + bytes(rng.randrange(5))
        is_message = rng.random() < 0.8
        body = body if is_message else body[: rng.randrange(9)]
        data += struct.pack("<BQ", Opcode.MESSAGE if is_message else rng.randrange(256), len(body)) + body
    return rng.choice([data, data[: rng.randrange(len(data) + 1)], data + struct.pack("<BQ", 5, 2**64 - 1)])


@pytest.mark.parametrize("many", [1, 3, 4096])
def test_records_are_found_many_at_a_time_as_one_after_another(many: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_records, "BLOCK_RECORDS", many)
    rng = random.Random(many)
    for _ in range(200):
        data = chunk(rng)
        found = [*heads_of_records(data)]
        assert all(len(heads.begin) <= many for heads in found)
        places = [
            place
            for heads in found
            for place in zip(heads.fields["opcode"].tolist(), heads.begin.tolist(), heads.end.tolist(), strict=True)
        ]
        assert places == [*walk(data)]
        messages = [row.tolist()[2:] for heads in found for row in heads.fields if row["opcode"] == Opcode.MESSAGE]
        assert messages == [MESSAGE.unpack_from(data, begin) for opcode, begin, _ in places if opcode == Opcode.MESSAGE]
        half = len(data) // 2
        assert sum(len(heads.begin) for heads in heads_of_records(data, half)) == sum(end <= half for *_, end in places)
