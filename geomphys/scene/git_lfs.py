"""Recognises Git LFS pointers: text files that stand for a file until ``git lfs pull`` fetches it."""

from __future__ import annotations

POINTER = b"version https://git-lfs.github.com/spec/"
"""First bytes of every pointer."""
IS_POINTER = "is a Git LFS pointer, not the file itself: run `git lfs pull` in its repository"


def is_lfs_pointer(data: bytes) -> bool:
    """Whether a file that begins with these bytes is a pointer."""
    return data.startswith(POINTER)
