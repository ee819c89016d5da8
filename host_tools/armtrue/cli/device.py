"""The commands upload and device: a compensator on a bus."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import Annotated

import can
import typer
from rich.console import Console
from rich.live import Live
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from armtrue.cli.shared.options import JsonOption, TablesArgument
from armtrue.cli.shared.output import STANDARD_OUTPUT, Output, plain_table
from armtrue.device.commission import Listener, Report, examine
from armtrue.device.compensator import (
    COMPENSATOR_STATES,
    MODES,
    NO_SLOT,
    PROTECTIONS,
    RESET_CAUSES,
    SLOT_STATES,
    STAGING_STATES,
    Compensator,
    DeviceRefusedError,
    Status,
    name_of,
)
from armtrue.device.connection import REFUSED, Connection, on_a_bus
from armtrue.device.image import checksum_of, read_image
from armtrue.device.monitor import Monitor, Snapshot, draw
from armtrue.device.recording import Recording, channel_label
from armtrue.device.sdo import SdoClient
from armtrue.device.upload import Step, upload_image
from armtrue.errors import InputError
from armtrue.io.files import write_file
from armtrue.units import plural

app = typer.Typer(
    no_args_is_help=True,
    help="""Query and manage a compensator on a bus.

Exit status: 0 done, 1 the device refused or a test failed, 2 bad input (nothing was sent),
3 the bus or the device did not answer, or answered wrongly, 130 interrupted,
141 the reader of the output closed the pipe.""",
)

NOMINAL_BITRATE = 1_000_000
SHORTEST_PERIOD_S = 0.05


class Transfer(str, Enum):
    """How SDO moves a table."""

    BLOCK = "block"
    SEGMENTED = "segmented"


@contextmanager
def _transfer_bar(quiet: bool) -> Iterator[Progress]:
    """Rate and remaining time of a transfer, on stderr."""
    console = Console(stderr=True)
    # No bar where it cannot be redrawn in place: each update would add a line to a log.
    console.quiet = quiet or not console.is_interactive
    speed = (DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    with Progress("{task.description}", BarColumn(), *speed, console=console, transient=True) as bar:
        yield bar


@on_a_bus
def upload(
    tables: TablesArgument,
    connection: Connection,
    transfer: Annotated[Transfer, typer.Option("--transfer", help="SDO transfer.")] = Transfer.BLOCK,
    confirm: Annotated[
        bool,
        typer.Option("--confirm/--trial", help="End the trial at once, or leave that to 'device confirm'."),
    ] = False,
    json_to: JsonOption = None,
) -> None:
    """Install a table on a compensator: compare, transfer, verify, commit, activate on trial.

    The image is compared with the device (robot, joints, format, signature, age) before a byte is sent.
    After any interruption the same command continues where it stopped, or starts again. The
    device takes tables only while no joint commands arrive. A table on trial is active until the next
    reset; 'armtrue device confirm' makes it permanent.

    Example: armtrue upload tables.bin --interface socketcan --channel can0

    Exit status: 0 done, 1 the device refused, 2 bad input or not for this device (nothing was sent),
    3 the bus or the device did not answer, or wrongly, 130 interrupted, 141 the reader of the output closed
    the pipe.
    """
    output = Output(json_to)
    image = read_image(tables)
    with connection.compensator() as device, _transfer_bar(quiet=json_to == STANDARD_OUTPUT) as bar:
        task = bar.add_task("transferring", total=len(image.data), visible=False)

        def show(step: Step) -> None:
            output.say(f"{step.name:18} {step.note}")

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, visible=done < total)

        warnings = device.warnings()
        result = upload_image(device, image, show, advance, transfer is Transfer.BLOCK, confirm)
    _say_warnings(output, warnings)
    told = {"sequence": image.sequence, "checksum": image.checksum, "warnings": warnings}
    output.figures(asdict(result) | told)


def _say_warnings(output: Output, warnings: list[str]) -> None:
    for warning in warnings:
        output.say(f"! warning   {warning}")


@app.command()
@on_a_bus
def info(connection: Connection, json_to: JsonOption = None) -> None:
    """Print the device's identity, its table and its counters.

    Example: armtrue device info --interface socketcan --channel can0
    """
    output = Output(json_to)
    with connection.compensator() as device:
        status, warnings = device.identify(), device.warnings()
    for line in _describe(status):
        output.say(line)
    _say_warnings(output, warnings)
    output.figures(status.values | {"warnings": warnings})


def _describe(status: Status) -> list[str]:
    active = status["Table status.Active slot"]
    table = "none: pass-through"
    if active != NO_SLOT:
        trial = ", on trial" if status["Table status.Trial"] else ""
        table = f"export {status['Table status.Active table sequence']}, slot {'AB'[active]}{trial}"
    slots = ", ".join(
        f"{slot} {name_of(SLOT_STATES, status[f'Table status.Slot {slot} state'])}" for slot in "AB"
    )
    in_force = status["Start and supply.Protection in force"]
    missing = [name for bit, name in enumerate(PROTECTIONS) if not in_force & 1 << bit]
    control, counters = "Compensator control", "Compensator status"
    counted = ("Cycles", "Clamped", "Stale", "Refused", "Sets withheld", "Worst cycle (us)")
    return [
        f"device      {status.text('Manufacturer device name')} {status.text('Manufacturer software version')}, "
        f"serial number {status['Identity object.Serial number']}",
        f"robot       {status.text('Robot serial') or '(not bound)'}, "
        f"{plural(status[f'{counters}.Joint count'], 'joint')}",
        f"state       {name_of(COMPENSATOR_STATES, status[f'{counters}.State'])}, "
        f"mode {name_of(MODES, status[f'{control}.Mode'])}, "
        f"correction {'enabled' if status[f'{control}.Correction enable'] else 'disabled'}",
        f"table       {table}",
        f"slots       {slots}; staging {name_of(STAGING_STATES, status['Table status.Staging state'])}, "
        f"room for {status['Table status.Capacity (bytes)']} bytes",
        f"tables      format {status['Table status.Format version read']}, "
        f"{'signed only' if status['Table status.Signature required'] else 'unsigned accepted'}",
        f"start       {name_of(RESET_CAUSES, status['Start and supply.Cause of the last reset'])}; not in force: "
        + (", ".join(missing) or "nothing"),
        "counters    " + ", ".join(f"{name.lower()} {status[f'{counters}.{name}']}" for name in counted),
    ]


@app.command()
@on_a_bus
def dump(
    out: Annotated[Path, typer.Argument(metavar="FILE", help="File to write.")],
    connection: Connection,
    json_to: JsonOption = None,
) -> None:
    """Read the active table back into a file.

    Example: armtrue device dump active.bin --interface socketcan --channel can0
    """
    output = Output(json_to)
    with connection.compensator() as device:
        image = _read_back(device, json_to == STANDARD_OUTPUT)
    write_file(out, image)
    output.say(f"written: {out} ({len(image)} bytes)")
    output.figures({"bytes": len(image), "checksum": checksum_of(image)})


def _read_back(device: Compensator, quiet: bool) -> bytes:
    """The table in force. Raises DeviceRefusedError where there is none."""
    with _transfer_bar(quiet) as bar:
        task = bar.add_task("reading", total=None)
        image = device.dump(lambda done, total: bar.update(task, completed=done, total=total or None))
    if not image:
        raise DeviceRefusedError("the device has no table in force")
    return image


@app.command()
@on_a_bus
def verify(tables: TablesArgument, connection: Connection, json_to: JsonOption = None) -> None:
    """Read the active table back and compare it with a file, byte by byte; exit status 1 if they differ.

    Example: armtrue device verify tables.bin --interface socketcan --channel can0
    """
    output = Output(json_to)
    image = read_image(tables)
    with connection.compensator() as device:
        held = _read_back(device, json_to == STANDARD_OUTPUT)
        if held != image.data:
            pairs = enumerate(zip(held, image.data, strict=False))
            bytes_apart = (f"byte {k}" for k, (one, other) in pairs if one != other)
            where = next(bytes_apart, f"its length, {len(held)} instead of {len(image.data)} bytes")
            raise DeviceRefusedError(
                f"the device's table differs from {tables}: the first difference is in {where}"
            )
    output.say(f"the device's table is {tables} ({len(held)} bytes)")
    output.figures({"bytes": len(held), "checksum": image.checksum, "sequence": image.sequence})


@app.command()
@on_a_bus
def activate(connection: Connection, json_to: JsonOption = None) -> None:
    """Put the table that waits in the spare slot on trial.

    Example: armtrue device activate --interface socketcan --channel can0
    """
    done = "on trial: a reset returns to the previous table unless this one is confirmed"
    _order(connection, "actv", done, json_to)


@app.command()
@on_a_bus
def confirm(connection: Connection, json_to: JsonOption = None) -> None:
    """End the trial: the table is active after every start.

    Example: armtrue device confirm --interface socketcan --channel can0
    """
    _order(connection, "cfrm", "confirmed: this table is active after every start", json_to)


@app.command()
@on_a_bus
def revert(connection: Connection, json_to: JsonOption = None) -> None:
    """End the trial and return to the previous table; or drop the one that waits in the spare slot.

    Example: armtrue device revert --interface socketcan --channel can0
    """
    _order(connection, "rvrt", "reverted", json_to)


def _order(connection: Connection, word: str, done: str, json_to: str | None) -> None:
    """Send one table command, and print the table status after it."""
    output = Output(json_to)
    with connection.compensator() as device:
        device.command(word)
        status = device.status("Table status")
    output.say(done)
    output.figures(status.values)


@app.command()
@on_a_bus
def save(connection: Connection, json_to: JsonOption = None) -> None:
    """Save the device's parameters as they are: mode, PDOs, times. Otherwise they are lost at a restart.

    Example: armtrue device save --interface socketcan --channel can0
    """
    output = Output(json_to)
    with connection.compensator() as device:
        device.save()
        warnings = device.warnings()
    output.say("saved: these parameters are used after every start")
    _say_warnings(output, warnings)
    output.figures({"saved": True, "warnings": warnings})


@app.command()
@on_a_bus
def selftest(connection: Connection, json_to: JsonOption = None) -> None:
    """Let the device test itself; exit status 1 if a test failed.

    Example: armtrue device selftest --interface socketcan --channel can0
    """
    output = Output(json_to)
    with connection.compensator() as device:
        results = device.self_test()
    table = plain_table("test", "result")
    for name, passed in results.items():
        table.add_row(name, "passed" if passed else "FAILED")
    output.table(table)
    output.figures(results)
    if not all(results.values()):
        raise typer.Exit(REFUSED)


@app.command()
@on_a_bus
def commission(
    connection: Connection,
    duration: Annotated[
        float, typer.Option("--duration", metavar="S", help="How long to watch the arm move.")
    ] = 30.0,
    json_to: JsonOption = None,
) -> None:
    """Find exchanged drives and drives with a wrong sign or scale; moves nothing, observes the controller's motion.

    Let the controller move every axis, one after the other, while this runs. Targets are compared with the
    actual positions that follow them. Run it with correction disabled or before the first table.

    Exit status 1 if something is wrong or the motion is not sufficient to decide.

    Example: armtrue device commission --interface socketcan --channel can0
    """
    output = Output(json_to)
    _refuse_short("--duration", duration)
    with connection.bus() as bus:
        report, absent = _watch_commissioning(bus, connection, duration)
    table = plain_table("axis", "commanded", "moved", "follows target of", "slope", "delay")
    for number, axis in enumerate(report.axes, 1):
        unheard = "no drive" if number - 1 in absent else "not heard"
        table.add_row(
            str(number),
            f"{axis.commanded:.0f}",
            unheard if axis.moved is None else f"{axis.moved:.0f}",
            ", ".join(map(str, axis.follows)) or "–",
            "–" if axis.slope is None else f"{axis.slope:.4f}",
            "–" if axis.delay is None else plural(axis.delay, "cycle"),
        )
    output.table(table)
    for sentence in report.findings:
        output.say(f"WRONG    {sentence}")
    for sentence in report.unknown:
        output.say(f"unknown  {sentence}")
    if report.is_right:
        output.say("all axes: order, sign and scale of the drives are as commanded")
    output.figures(report.document())
    if not report.is_right:
        raise typer.Exit(REFUSED)


def _refuse_short(name: str, seconds: float | None) -> None:
    if seconds is not None and not seconds >= SHORTEST_PERIOD_S:
        raise InputError(f"{name}: found {seconds:g}, expected at least {SHORTEST_PERIOD_S:g} s")


def _watch_commissioning(
    bus: can.BusABC, connection: Connection, duration: float
) -> tuple[Report, frozenset[int]]:
    client = SdoClient(bus, connection.node, connection.timeout)
    device = Compensator(client)
    device.greet()
    listener = Listener(client, device.read_number("Compensator status.Joint count"))
    if not listener.maps_targets:
        raise DeviceRefusedError(
            "valid RPDOs do not map the targets of all joints (0x1400, 0x1600): configure the device first (a joint "
            "without a motor needs no target once the active table marks it as passive)"
        )
    end = time.monotonic() + duration
    while (left := end - time.monotonic()) > 0.0:
        if (message := bus.recv(left)) is not None:
            listener.take(message)
    return examine(*listener.recorded(), listener.absent), listener.absent


@app.command()
@on_a_bus
def monitor(
    connection: Connection,
    period: Annotated[float, typer.Option("--period", metavar="S", help="Time between updates.")] = 0.25,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="Stop after this time.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            metavar="FILE",
            help="Record all frames, in python-can's .asc, .blf, .log, …; replaces FILE at the end.",
        ),
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Show targets, corrections, limits, state and bus load, live; Ctrl-C ends it.

    Example: armtrue device monitor --interface socketcan --channel can0 --record run.blf
    """
    output = Output(json_to)
    _refuse_short("--period", period)
    _refuse_short("--duration", duration)
    last: Snapshot | None = None
    nominal = connection.bitrate or NOMINAL_BITRATE
    label = channel_label(connection.interface, connection.channel)
    with (
        nullcontext() if record is None else Recording(record, label) as recording,
        connection.bus() as bus,
    ):
        watcher = Monitor(
            bus, connection.node, connection.timeout, nominal, connection.data_bitrate or nominal, recording
        )
        try:
            with Live(console=output.console, auto_refresh=False) as page:
                for last in watcher.snapshots(period, duration):
                    page.update(draw(last), refresh=True)
        except KeyboardInterrupt:
            if last is None:
                raise
            output.say("stopped")
    if recording is not None:
        output.say(f"recorded: {record} ({plural(recording.frames, 'frame')})")
    if last is not None:
        output.figures(vars(last))
