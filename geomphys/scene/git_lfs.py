"""Git LFS pointers: the few lines that stand in a file's place until ``git lfs pull`` brings it."""

from __future__ import annotations

POINTER = b"version https://git-lfs.github.com/spec/"
"""What every pointer begins with."""
IS_POINTER = "is a Git LFS pointer, not the file itself: run `git lfs pull` in its repository"


def is_lfs_pointer(data: bytes) -> bool:
    """Whether these bytes, or the first of them, are a pointer's."""
    return data.startswith(POINTER)
