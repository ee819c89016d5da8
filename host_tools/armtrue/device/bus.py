"""Opens any bus that python-can supports, from command-line options."""

from __future__ import annotations

import importlib
import inspect
import logging
from dataclasses import dataclass, field
from typing import Any

import can
from can.interfaces import BACKENDS, VALID_INTERFACES
from can.util import cast_from_string

from armtrue.device.sdo import CommunicationError
from armtrue.errors import InputError, did_you_mean

# Interfaces whose options are all parameters of the constructor; others read more, some in a vendor's library.
_OPTIONS_ARE_PARAMETERS = ("socketcan", "virtual")


@dataclass(frozen=True)
class BusOptions:
    """Options with which python-can opens a bus; `extra`: further ones of the interface, as KEY=VALUE."""

    interface: str
    channel: str
    bitrate: int | None = None
    fd: bool = False
    data_bitrate: int | None = None
    extra: list[str] = field(default_factory=list)

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
        for text in self.extra:
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
