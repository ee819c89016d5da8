"""Returns the memory of released fits to the system; otherwise the server would hold its peak for ever."""

from __future__ import annotations

import ctypes

_M_ARENA_MAX = -8  # M_ARENA_MAX of mallopt, in glibc's malloc.h


def _of_the_c_library(name: str, *arguments: int) -> None:
    """Call a function that glibc has and other C libraries may lack."""
    function = getattr(ctypes.CDLL(None), name, None)
    if function is not None:
        function(*arguments)


def share_one_arena() -> None:
    """Make all threads allocate from one arena, because each arena keeps its largest size.

    Call it before any thread starts.
    """
    _of_the_c_library("mallopt", _M_ARENA_MAX, 1)


def give_back() -> None:
    """Return free memory to the system."""
    _of_the_c_library("malloc_trim", 0)
