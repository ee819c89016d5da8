"""Foreign measurement files, as instruments and controllers export them: their meaning is guessed and reported."""

from armtrue.foreign.init import Guessed, init

__all__ = ["Guessed", "init"]
