"""From opened files to a server that is ready to answer."""

from __future__ import annotations

import secrets
from pathlib import Path

from armtrue.errors import InputError
from armtrue.progress import Progress
from armtrue.workbench.allocator import share_one_arena
from armtrue.workbench.compensator import Device
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import LOOK_AT_GUESSES, Drop
from armtrue.workbench.opening.opened import Opened
from armtrue.workbench.server import Server
from armtrue.workbench.session import default_folder


def guessed(files: list[Path], robot: Path | None, model: Path | None) -> Drop | None:
    """Foreign files with the guesses about them, as if they had been dropped; None where they are not foreign."""
    drop = _new_drop()
    return drop if drop.take_foreign(files, robot, model) else None


def _new_drop() -> Drop:
    return Drop(default_folder(f"dropped-{secrets.token_hex(4)}"))


def start(
    opened: Opened | None,
    port: int = 0,
    folder: Path | None = None,
    new: bool = False,
    progress: Progress | None = None,
    device: Device | None = None,
    drop: Drop | None = None,
) -> Server:
    """A server for the session of these files: the saved one, or a new one with its first fit.

    `opened`: None for a page that waits for files. `device`: the compensator on the named CAN bus. `drop`: foreign
    files whose guesses wait for review. Errors: InputError where the port is taken, the session cannot be written or
    the data do not allow the model.
    """
    share_one_arena()
    engine = Engine(drop or _new_drop(), device)
    try:
        server = Server(engine, port)
    except OSError as error:
        raise InputError(f"--port: found port {port}, which cannot be had ({error.strerror})") from None
    if opened is not None:
        engine.begin(opened, folder, new, progress)
    elif drop is not None:
        engine.said = LOOK_AT_GUESSES
    else:
        engine.said = "Drop files on the page, or choose them."
        if not new:
            engine.go_on_waiting()
    return server
