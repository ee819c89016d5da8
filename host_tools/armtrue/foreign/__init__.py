"""Measurements as instruments and controllers export them: what their files mean, guessed and said."""

from armtrue.foreign.init import Guessed, init

__all__ = ["Guessed", "init"]
