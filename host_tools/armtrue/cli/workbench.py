"""The command open."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armtrue.cli.shared.output import Output, waiting
from armtrue.errors import InputError

if TYPE_CHECKING:
    from armtrue.workbench.compensator import Device

_HIGHEST_PORT = 65535


def open_workbench(
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="FILE…", help="Measurements (CSV, dataset.yaml) or fits (fit.json)."),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(
            "--robot", "-r", metavar="ROBOT", help="The nominal arm; default: robot.yaml beside the data."
        ),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            "-m",
            metavar="MODEL",
            help="The effects to begin with; default: model.yaml beside the data.",
        ),
    ] = None,
    port: Annotated[int, typer.Option("--port", metavar="N", help="Port; 0: any that is free.")] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address and open no browser.")
    ] = False,
    session: Annotated[
        Path | None,
        typer.Option(
            "--session",
            metavar="FOLDER",
            help="Folder of the session; default: in your state folder. A session that exists there is continued.",
        ),
    ] = None,
    new: Annotated[
        bool, typer.Option("--new", help="Start a new session even if there is one of these files.")
    ] = False,
    interface: Annotated[
        str | None,
        typer.Option(
            "--interface", "-i", metavar="NAME", help="python-can interface of a compensator's bus."
        ),
    ] = None,
    channel: Annotated[
        str | None, typer.Option("--channel", "-c", metavar="NAME", help="Its channel, such as can0.")
    ] = None,
    bitrate: Annotated[
        int | None, typer.Option("--bitrate", metavar="BIT/S", help="Bit rate, for interfaces that need it.")
    ] = None,
    node: Annotated[int, typer.Option("--node", "-n", min=1, max=127, help="CANopen node-ID.")] = 32,
) -> None:
    """Open the workbench: add effects on a page in your browser, see the error fall, and undo.

    Serves only this machine, until Ctrl-C; continues the session if it is started on the same files again.

    Example: armtrue open data.csv --robot robot.yaml --model model.yaml
    """
    from armtrue.workbench.opening.opened import open_files
    from armtrue.workbench.start import guessed, start

    if not 0 <= port <= _HIGHEST_PORT:
        raise InputError(f"--port: found {port}, expected 0 to {_HIGHEST_PORT}")
    output = Output(None)
    if not files and (robot or model):
        raise InputError(f"{robot or model}: found no measurements beside it, expected DATA or a fit.json")
    device = _device(interface, channel, bitrate, node)
    opened = drop = None
    if files:
        try:
            opened = open_files(files, robot, model)
        except InputError:
            with waiting(output):
                drop = guessed(files, robot, model)
            if drop is None:
                raise
    with waiting(output) as progress:
        server = start(opened, port, session, new, progress, device, drop)
    if drop is not None:
        output.say("The files are not in Armtrue's own form: the page shows the guesses about them.")
    if opened is not None:
        output.items(opened.notes)
        output.say(f"session: {server.engine.session.folder}")
    print(f"workbench {server.address}", flush=True)
    if not no_browser:
        webbrowser.open(server.address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        sys.stdout.flush()
        kept = "\nThe session is kept; 'armtrue open' on the same files goes on with it."
        print(kept, file=sys.stderr, flush=True)
    # _exit, so as not to wait for a fit that still runs in its own thread and is no longer needed.
    os._exit(0)


def _device(interface: str | None, channel: str | None, bitrate: int | None, node: int) -> Device | None:
    """The compensator on the given bus; None if no bus is given."""
    if interface is None and channel is None:
        return None
    if interface is None or channel is None:
        raise InputError("--interface, --channel: found one without the other, expected both")
    from armtrue.device.connection import BusOptions, open_bus, quiet_interfaces
    from armtrue.device.sdo import DEFAULT_TIMEOUT_S
    from armtrue.workbench.compensator import Device

    quiet_interfaces()
    options = BusOptions(interface, channel, bitrate)
    return Device(lambda: open_bus(options), f"{interface} {channel}", node, DEFAULT_TIMEOUT_S)
