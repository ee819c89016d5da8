"""How long work tells whoever waits for it how far it is."""

from __future__ import annotations

from collections.abc import Callable

# progress(share, stage): the share done, 0 to 1, of what `stage` says in words.
Progress = Callable[[float, str], None]
