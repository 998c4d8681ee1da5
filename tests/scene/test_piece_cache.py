"""Pieces kept between runs are those that were cut, bit for bit, or are cut again."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geomphys.scene.piece_cache import ConvexPieces, read_pieces, write_pieces


def test_pieces_come_back_and_a_flipped_bit_is_noticed(tmp_path: Path) -> None:
    archive = tmp_path / "ell"
    hulls = (np.random.default_rng(1).normal(size=(8, 3)), np.random.default_rng(2).normal(size=(5, 3)))
    write_pieces(archive, ConvexPieces(hulls, "coacd", np.float64(1e-4)))
    found = read_pieces(archive)
    assert found is not None
    assert [hull.tobytes() for hull in found.hulls] == [hull.tobytes() for hull in hulls]
    assert (found.method, found.uncovered_m) == ("coacd", 1e-4)
    data = archive.read_bytes()
    for bit in range(0, 8 * len(data), 7):
        broken = bytearray(data)
        broken[bit // 8] ^= 1 << bit % 8
        archive.write_bytes(broken)
        assert read_pieces(archive) is None, bit
