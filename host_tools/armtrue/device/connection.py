"""The options that all device commands share, and the connection that they describe."""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import can
import typer

from armtrue.device.bus import BusOptions, open_bus, quiet_interfaces
from armtrue.device.compensator import Compensator, DeviceRefusedError
from armtrue.device.sdo import DEFAULT_TIMEOUT_S, CommunicationError, SdoAbortError, SdoClient

REFUSED = 1
NO_COMMUNICATION = 3
DEFAULT_NODE = 32

_InterfaceOption = typer.Option(
    "--interface", "-i", metavar="NAME", help="python-can interface: socketcan, slcan, pcan, …"
)
_ChannelOption = typer.Option(
    "--channel", "-c", metavar="NAME", help="Its channel: can0, /dev/ttyACM0, socket://host:port, …"
)
_BitrateOption = typer.Option("--bitrate", metavar="BIT/S", help="Bit rate, for interfaces that need it.")
_DataBitrateOption = typer.Option("--data-bitrate", metavar="BIT/S", help="CAN FD data phase.")
_ExtraOption = typer.Option(
    "--bus-option", metavar="KEY=VALUE", help="Passed to python-can as it stands; repeatable."
)


@dataclass(frozen=True)
class Connection:
    """How to reach one compensator."""

    interface: Annotated[str, _InterfaceOption]
    channel: Annotated[str, _ChannelOption]
    bitrate: Annotated[int | None, _BitrateOption] = None
    fd: Annotated[bool, typer.Option("--fd/--classic", help="Open the bus for CAN FD.")] = False
    data_bitrate: Annotated[int | None, _DataBitrateOption] = None
    bus_option: Annotated[list[str] | None, _ExtraOption] = None
    node: Annotated[int, typer.Option("--node", "-n", min=1, max=127, help="CANopen node-ID.")] = DEFAULT_NODE
    timeout: Annotated[
        float,
        typer.Option("--timeout", metavar="S", min=0.05, max=60.0, help="How long one answer may take."),
    ] = DEFAULT_TIMEOUT_S

    @contextmanager
    def bus(self) -> Iterator[can.BusABC]:
        """The open bus; an error on it ends the command with a message of one sentence and its exit status."""
        quiet_interfaces()
        try:
            options = BusOptions(
                self.interface, self.channel, self.bitrate, self.fd, self.data_bitrate, self.bus_option or []
            )
            bus = open_bus(options)
            try:
                yield bus
            finally:
                bus.shutdown()
        except (DeviceRefusedError, SdoAbortError) as refusal:
            begins = "the device refused: " if isinstance(refusal, SdoAbortError) else ""
            print(f"armtrue: {begins}{refusal}", file=sys.stderr)
            raise typer.Exit(REFUSED) from None
        except (CommunicationError, can.CanError) as problem:
            print(f"armtrue: {' '.join(str(problem).split())}", file=sys.stderr)
            raise typer.Exit(NO_COMMUNICATION) from None

    @contextmanager
    def compensator(self) -> Iterator[Compensator]:
        """The device, after a check that it is a compensator."""
        with self.bus() as bus:
            device = Compensator(SdoClient(bus, self.node, self.timeout))
            device.greet()
            yield device


def on_a_bus(command: Callable[..., None]) -> Callable[..., None]:
    """Replace a command's parameter `connection` by the command-line options of a Connection."""
    signature = inspect.signature(command, eval_str=True)
    shared = inspect.signature(Connection, eval_str=True).parameters
    own = [parameter for name, parameter in signature.parameters.items() if name != "connection"]

    @functools.wraps(command)
    def wrapped(**values: Any) -> None:
        connection = Connection(**{name: values.pop(name) for name in shared})
        command(connection=connection, **values)

    by_name = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in [*own, *shared.values()]
    ]
    wrapped.__signature__ = signature.replace(parameters=by_name)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {parameter.name: parameter.annotation for parameter in by_name}
    return wrapped
