"""Memory of fits that were let go goes back to the system: else the server would hold the most it ever needed."""

from __future__ import annotations

import ctypes

_M_ARENA_MAX = -8  # mallopt's name for it, in glibc's malloc.h


def _of_the_c_library(name: str, *arguments: int) -> None:
    """Call a function that glibc has and other C libraries may lack."""
    function = getattr(ctypes.CDLL(None), name, None)
    if function is not None:
        function(*arguments)


def share_one_arena() -> None:
    """Have all threads allocate from one arena, for each arena keeps what it was once grown to.

    To be called before any thread starts.
    """
    _of_the_c_library("mallopt", _M_ARENA_MAX, 1)


def give_back() -> None:
    """Hand memory that is free back to the system."""
    _of_the_c_library("malloc_trim", 0)
