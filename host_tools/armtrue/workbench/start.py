"""From opened files to a server that is ready to answer."""

from __future__ import annotations

from pathlib import Path

from armtrue.errors import InputError
from armtrue.progress import Progress
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening import Opened
from armtrue.workbench.server import Server
from armtrue.workbench.session import Session, default_folder, key_of, load_session


def start(
    opened: Opened,
    port: int = 0,
    folder: Path | None = None,
    new: bool = False,
    progress: Progress | None = None,
) -> Server:
    """A server of the session of these files: the one that was kept, or a new one with its first fit made.

    Errors: InputError where the port is taken, the session cannot be written or the data cannot carry the model.
    """
    key = key_of(opened.files)
    place = folder or default_folder(key)
    if place.exists() and not place.is_dir():
        raise InputError(f"--session: found a file '{place}', expected a folder")
    kept = None if new else load_session(place, key, opened.data)
    engine = Engine(kept or Session(place, key, opened.data))
    name = str(opened.robot.spec.get("name", "robot"))
    about = f"{opened.data.file.name}: {opened.data.count} measurements"
    try:
        server = Server(engine, port, name, about, opened.notes)
    except OSError as error:
        raise InputError(f"--port: found port {port} that cannot be had ({error.strerror})") from None
    if kept:
        engine.said = f"The session is gone on with. {kept.node.said}"
    else:
        try:
            engine.begin(opened, progress)
        except OSError as error:
            raise InputError(f"--session: {place} cannot be written ({error.strerror})") from None
    return server
