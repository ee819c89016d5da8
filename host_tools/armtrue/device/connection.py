"""The options that all device commands share, and the connection that they describe."""

from __future__ import annotations

import functools
import importlib
import inspect
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import can
import typer
from can.interfaces import BACKENDS, VALID_INTERFACES
from can.util import cast_from_string

from armtrue.device.compensator import Compensator, DeviceRefusedError
from armtrue.device.sdo import DEFAULT_TIMEOUT_S, CommunicationError, SdoAbortError, SdoClient
from armtrue.errors import InputError, did_you_mean

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


# Interfaces whose options are all parameters of the constructor; others read more, some in a vendor's library.
_OPTIONS_ARE_PARAMETERS = ("socketcan", "virtual")


@dataclass(frozen=True)
class BusOptions:
    """Options with which python-can opens a bus; `extra`: further ones of the interface, as KEY=VALUE."""

    interface: Annotated[str, _InterfaceOption]
    channel: Annotated[str, _ChannelOption]
    bitrate: Annotated[int | None, _BitrateOption] = None
    fd: Annotated[bool, typer.Option("--fd/--classic", help="Open the bus for CAN FD.")] = False
    data_bitrate: Annotated[int | None, _DataBitrateOption] = None
    extra: Annotated[list[str] | None, _ExtraOption] = None

    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of can.Bus.

        Raises InputError for an extra that is not KEY=VALUE or that the interface does not have, and for a bit rate
        that is not above zero.
        """
        known: list[str] = []
        if self.interface in _OPTIONS_ARE_PARAMETERS:
            module, name = BACKENDS[self.interface]
            parameters = inspect.signature(getattr(importlib.import_module(module), name)).parameters.values()
            known = sorted(p.name for p in parameters if p.kind is not p.VAR_KEYWORD and p.name != "channel")
        rates = {"bitrate": self.bitrate, "fd": self.fd or None, "data_bitrate": self.data_bitrate}
        found: dict[str, Any] = {"interface": self.interface, "channel": self.channel}
        found |= {key: value for key, value in rates.items() if value is not None}
        for text in self.extra or []:
            key, separator, value = text.partition("=")
            if not separator or not key:
                raise InputError(f"--bus-option: found '{text}', expected KEY=VALUE")
            if known and key not in known:
                raise InputError(
                    f"--bus-option: found '{key}'{did_you_mean(key, known)}, expected an option of {self.interface}: "
                    f"{', '.join(known)}"
                )
            found[key] = cast_from_string(value)
        for rate in ("bitrate", "data_bitrate"):
            if rate in found and (type(found[rate]) is not int or found[rate] <= 0):
                raise InputError(
                    f"--{rate.replace('_', '-')}: found {found[rate]}, expected a whole number of bit/s above 0"
                )
        return found


def open_bus(options: BusOptions) -> can.BusABC:
    """Open the bus. Raises InputError for an unknown interface or option, CommunicationError if it cannot be opened."""
    if options.interface not in VALID_INTERFACES:
        known = sorted(VALID_INTERFACES)
        raise InputError(
            f"--interface: '{options.interface}'{did_you_mean(options.interface, known)}, "
            f"expected one of {', '.join(known)}"
        )
    arguments = options.arguments()
    try:
        return _with_errors_of_its_own(can.Bus(**arguments))
    except Exception as problem:
        # Interfaces fail with exceptions of many types (kvaser without its driver: NameError); the message names
        # the bus and the reason.
        raise CommunicationError(
            f"{options.interface} {options.channel}: cannot be opened: {str(problem) or type(problem).__name__}"
        ) from None


def _with_errors_of_its_own(bus: can.BusABC) -> can.BusABC:
    """`bus` whose `recv` raises CanError alone: for a damaged slcan line python-can raises ValueError."""
    receive = bus.recv

    def recv(timeout: float | None = None) -> can.Message | None:
        try:
            return receive(timeout)
        except (can.CanError, KeyboardInterrupt):
            raise
        except Exception as problem:
            raise can.CanOperationError(f"found a frame that cannot be read ({problem})") from None

    bus.recv = recv  # type: ignore[method-assign]
    return bus


def quiet_interfaces() -> None:
    """Keep python-can's log off stderr: every failure in it also raises an exception, whose message is printed."""
    log = logging.getLogger("can")
    log.addHandler(logging.NullHandler())
    log.propagate = False


@dataclass(frozen=True)
class Connection(BusOptions):
    """How to reach one compensator."""

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
            bus = open_bus(self)
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
