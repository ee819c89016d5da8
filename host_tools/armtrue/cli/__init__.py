"""The command `armtrue`."""

from armtrue.cli.app import main

__all__ = ["main"]
