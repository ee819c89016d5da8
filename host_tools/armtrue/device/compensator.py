"""One compensator on a bus: values by name, table commands, status."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from armtrue.device.eds import dictionary
from armtrue.device.image import checksum_of, own_checksum
from armtrue.device.sdo import ByteProgress, CommunicationError, SdoAbortError, SdoClient

STAGING_STATES = ("empty", "receiving", "received", "verified", "refused", "committed")
SLOT_STATES = (
    "blank", "torn", "foreign", "newer", "refused", "pending", "trial", "confirmed", "rejected",
)  # fmt: skip
COMPENSATOR_STATES = ("pass-through", "blending", "active")
MODES = ("forward", "inline", "offset")
# 0x2040 subs 1 and 8: firmware/ports/common/reset_log.h, firmware/canopen/node/port_health.h.
RESET_CAUSES = (
    "unknown", "power-on", "brown-out", "reset pin", "watchdog", "window watchdog", "debugger", "NMT reset",
    "processor fault", "memory fault", "crystal failed", "low power",
)  # fmt: skip
PROTECTIONS = (
    "memory protection", "clock security", "voltage detector", "window watchdog", "brown-out level 3",
    "hardware watchdog", "read protection", "write-protected code",
)  # fmt: skip
BUS_STATES = ("active", "warning", "passive", "bus-off")
NO_SLOT = 0xFF

# Why a table was refused: firmware/core/table/table.h, and from 0x100 the upload's own reasons.
REFUSALS = {
    0: "accepted",
    1: "too short",
    2: "not a table",
    3: "unknown format version",
    4: "wrong length",
    5: "wrong checksum",
    6: "another number of joints",
    7: "another robot's table",
    8: "not signed, and this device takes only signed tables",
    9: "wrong signature",
    10: "unknown flag",
    11: "unknown section",
    12: "missing section",
    13: "section out of bounds",
    14: "unknown kind of record",
    15: "reference to nothing",
    16: "value out of range",
    17: "reserved field not zero",
    18: "more records than this firmware has room for",
    19: "an earlier activation is still pending",
    20: "too much work for a control cycle: export with fewer or coarser tables",
    21: "increment scales that do not fit each other",
    22: "made for drives with another resolution than this device's (0x608F)",
    0x100: "an older export than the table in force",
    0x101: "limits beyond the firmware's own maxima",
    0x102: "other passive joints than the table before: disable the correction (0x2000 sub 2) and the drives first",
}
_OTHER_AXES = 0x102
SELF_TESTS = ("checksums", "object dictionary", "table in force", "buses", "pass-through")

# Valid numbers of the values that the host computes with, and their wording in the error for any other number.
_POSSIBLE = {
    "Compensator status.Joint count": (range(1, 9), "1 to 8"),
    "Table status.Active slot": ((0, 1, NO_SLOT), f"0, 1 or {NO_SLOT}"),
}

_PRODUCT_CODE = int.from_bytes(b"ARMT", "big")
_DEVICE_STATE = 0x08000022
_INCOMPATIBLE = 0x06040043
# Erasing a flash sector takes up to two seconds, a signature check tens of milliseconds.
_COMMAND_TIMEOUT_S = 20.0
_SAVE = int.from_bytes(b"save", "little")
# Timeout of the first request, short because an interrupted client often left the device waiting.
_FIRST_PATIENCE_S = 0.5


class DeviceRefusedError(Exception):
    """The device refused a request; the message says why and what to do."""


@dataclass(frozen=True)
class Status:
    """Values of the device's status objects, by name."""

    values: dict[str, int | str]

    def __getitem__(self, name: str) -> int:
        return int(self.values[name])

    def text(self, name: str) -> str:
        """A string value."""
        return str(self.values[name])


class Compensator:
    """A compensator node. Every method raises SdoAbortError or CommunicationError of the SDO client."""

    def __init__(self, client: SdoClient) -> None:
        self.client = client

    def read(self, name: str) -> int | str:
        """The value of an object by its EDS name."""
        entry = dictionary()[name]
        data = self.client.upload(entry.index, entry.sub)
        if not entry.is_number:
            return data.decode("ascii", "replace")
        number = int.from_bytes(data, "little", signed=entry.signed)
        possible, words = _POSSIBLE.get(name, ((number,), ""))
        if number not in possible:
            raise CommunicationError(
                f"node {self.client.node_id} says {number} of '{name}', expected {words}"
            )
        return number

    def read_number(self, name: str) -> int:
        """The value of an integer object."""
        return int(self.read(name))

    def write(self, name: str, value: int, timeout_s: float | None = None) -> None:
        """Set an integer object."""
        entry = dictionary()[name]
        data = value.to_bytes(entry.size, "little", signed=entry.signed)
        self.client.download(entry.index, entry.sub, data, timeout_s)

    def status(self, *objects: str) -> Status:
        """All values of the named records and variables; those of a record are named `Record.Value`."""
        names = [name for name in dictionary() if name.split(".")[0] in objects]
        kept = [name for name in names if not name.endswith("Highest sub-index supported")]
        return Status({name: self.read(name) for name in kept})

    def greet(self) -> None:
        """End any transfer that an interrupted client left open, and check that the node is a compensator.

        Raises DeviceRefusedError if it is some other device.
        """
        usual_s = self.client.timeout_s
        for patience_s in (min(_FIRST_PATIENCE_S, usual_s), usual_s):
            self.client.timeout_s = patience_s
            try:
                return self._check_product()
            except CommunicationError:
                # A server in an abandoned block transfer takes a request for a segment of it; a server that is
                # committing another client's table is erasing flash.
                self.client.abort(0, 0)
            finally:
                self.client.timeout_s = usual_s
        self._check_product()

    def _check_product(self) -> None:
        product = self.read_number("Identity object.Product code")
        if product != _PRODUCT_CODE:
            name = self.read("Manufacturer device name")
            raise DeviceRefusedError(
                f"the node is a '{name}' (product code 0x{product:08X}), not a compensator"
            )

    def identify(self) -> Status:
        """Identity, table and state of the device; few enough values to read before every operation."""
        return self.status(
            "Manufacturer device name", "Manufacturer software version", "Identity object", "Robot serial",
            "Table status", "Compensator control", "Compensator status", "Start and supply",
        )  # fmt: skip

    def is_quiet(self) -> bool:
        """Whether no joint commands have arrived for the time that table commands need."""
        return bool(self.read_number("Compensator status.Status bits") & 1 << 3)

    def warnings(self) -> list[str]:
        """Reasons why a table would correct nothing, now or after a restart; one sentence each."""
        bits = self.read_number("Compensator status.Status bits")
        found = []
        if self.read_number("Compensator control.Mode") == MODES.index("forward"):
            found.append(
                "the device is in forward mode: nothing is corrected, whatever table it has (its mode is 0x2000 sub 1)"
            )
        else:
            if not bits & 1 << 0:
                found.append(
                    "nothing is corrected: valid RPDOs do not map the targets of all joints (0x1400, 0x1600), "
                    "or in offset mode valid TPDOs their offsets (0x1800, 0x1A00)"
                )
            if bits & 1 << 5:
                found.append(
                    "parameters were written and not saved ('armtrue device save'): a restart comes back without them"
                )
        if not self.read_number("Compensator control.Correction enable"):
            found.append("nothing is corrected: correction is disabled (0x2000 sub 2)")
        return found

    def save(self) -> None:
        """Store the present parameters for all later starts (0x1010). Raises DeviceRefusedError."""
        with _refused_for_its_state(_STILL_MOVING_AT_SAVE):
            self.write("Store parameters.Save all parameters", _SAVE, _COMMAND_TIMEOUT_S)

    def command(self, word: str) -> None:
        """One table command: vrfy, cmit, actv, cfrm, rvrt, dscd.

        Raises DeviceRefusedError with the device's own reason.
        """
        try:
            self.write("Table command", int.from_bytes(word.encode("ascii"), "little"), _COMMAND_TIMEOUT_S)
        except SdoAbortError as refusal:
            raise DeviceRefusedError(self._explain(word, refusal)) from None

    def stage(self, image: bytes, block: bool, progress: ByteProgress) -> None:
        """Transfer an image into the staging buffer."""
        entry = dictionary()["Table staging image"]
        transfer = self.client.download_block if block else self.client.download_segmented
        with _refused_for_its_state(STILL_MOVING):
            transfer(entry.index, entry.sub, image, progress)

    def dump(self, progress: ByteProgress) -> bytes:
        """The image in force. Empty if there is none. Raises CommunicationError if it arrived damaged."""
        entry = dictionary()["Table active image"]
        try:
            image = self.client.upload(entry.index, entry.sub, progress)
        except SdoAbortError as refusal:
            if refusal.code == 0x08000024:
                return b""
            raise
        # Segments carry no checksum, so the image's own and the one that the device reports are compared.
        found, own = checksum_of(image), own_checksum(image)
        active = self.read_number("Table status.Checksum of active image")
        if not found == own == active:
            raise CommunicationError(
                f"the table was damaged on its way: checksum 0x{found:08X}, its own is 0x{own:08X}, the device's "
                f"0x{active:08X}"
            )
        return image

    def self_test(self) -> dict[str, bool]:
        """Run the device's self-tests; returns by name whether each passed."""
        with _refused_for_its_state(STILL_MOVING):
            self.write("Self-test.Run", (1 << len(SELF_TESTS)) - 1, _COMMAND_TIMEOUT_S)
        failed = self.read_number("Self-test.Tests failed")
        return {name: not failed & 1 << bit for bit, name in enumerate(SELF_TESTS)}

    def _explain(self, word: str, refusal: SdoAbortError) -> str:
        if refusal.code == _DEVICE_STATE and not self.is_quiet():
            return STILL_MOVING
        reason = self.read_number("Table status.Refusal reason")
        refused = f"the device refused the table: {REFUSALS.get(reason, f'reason {reason}')}"
        if refusal.code == _DEVICE_STATE:
            return refused if reason == _OTHER_AXES else _NOTHING_TO_DO[word]
        if refusal.code == _INCOMPATIBLE:
            return f"{refused} (byte {self.read_number('Table status.Refusal byte offset')} of the image)"
        return f"the device could not do it: {refusal}"


@contextmanager
def _refused_for_its_state(why: str) -> Iterator[None]:
    """Raise DeviceRefusedError with `why` if the device refuses a request in the `with` block because of its state."""
    try:
        yield
    except SdoAbortError as refusal:
        if refusal.code == _DEVICE_STATE:
            raise DeviceRefusedError(why) from None
        raise


STILL_MOVING = "joint commands are arriving; stop the controller before tables are changed"
_STILL_MOVING_AT_SAVE = (
    "joint commands are arriving, or a drive is not disabled (an erase of flash stops forwarding): disable the drives "
    "and stop the controller before parameters are saved"
)
_NOTHING_TO_DO = {
    "vrfy": "nothing has been transferred that could be verified",
    "cmit": "a table cannot be committed now: a drive is not disabled (an erase of flash stops forwarding), "
    "the table is not verified, or a trial is running (confirm or revert it first)",
    "actv": "no committed table waits for activation",
    "cfrm": "no table is on trial",
    "rvrt": "no table is on trial or waiting",
    "dscd": "nothing has been transferred",
}


def name_of(names: tuple[str, ...], number: int) -> str:
    """The name at a place of one of the tuples above, or the number itself."""
    return names[number] if 0 <= number < len(names) else str(number)
