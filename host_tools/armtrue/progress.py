"""The callback by which long computations report their progress."""

from __future__ import annotations

from collections.abc import Callable

# progress(share, stage): the share done, 0 to 1, of the stage named in words.
Progress = Callable[[float, str], None]
