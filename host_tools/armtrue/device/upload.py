"""Upload of a table: compare, transfer, verify, commit, put on trial, read back. Every step can be repeated."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from armtrue.device.compensator import NO_SLOT, STILL_MOVING, Compensator, DeviceRefusedError, Status
from armtrue.device.image import ImageInfo
from armtrue.device.sdo import ByteProgress, CommunicationError, SdoAbortError
from armtrue.errors import InputError
from armtrue.units import plural

TRANSFER_ATTEMPTS = 3
STAGING = (0x2010, 0)  # the object that a table is transferred into
# Staging states of a whole image: received, verified, committed.
_TRANSFERRED = (2, 3, 5)


@dataclass(frozen=True)
class Step:
    """One completed step, for people and programs."""

    name: str
    note: str = ""


@dataclass
class UploadResult:
    """Result of an upload."""

    steps: list[Step] = field(default_factory=list)
    bytes_sent: int = 0
    seconds: float = 0.0
    frames: int = 0
    on_trial: bool = False


# tell(step just finished)
StepListener = Callable[[Step], None]


def compare(image: ImageInfo, device: Status) -> None:
    """Refuse an image that this device would refuse, before a byte is sent.

    Raises InputError naming what was found and what the device expects.
    """

    def refuse(found: str, expected: int | str) -> None:
        raise InputError(f"{image.path}: {found}, the device expects {expected}")

    if image.format_version > device["Table status.Format version read"]:
        refuse(f"table format {image.format_version}", device["Table status.Format version read"])
    if image.joint_count != device["Compensator status.Joint count"]:
        refuse(f"a table for {plural(image.joint_count, 'joint')}", device["Compensator status.Joint count"])
    serial = device.text("Robot serial")
    if serial and image.robot_serial != serial:
        refuse(f"a table for robot '{image.robot_serial}'", f"robot '{serial}'")
    if len(image.data) > device["Table status.Capacity (bytes)"]:
        refuse(f"{len(image.data)} bytes", f"at most {device['Table status.Capacity (bytes)']}")
    if device["Table status.Signature required"] and not image.is_signed:
        refuse("an unsigned table", "a signed one (armtrue export --sign)")
    active = device["Table status.Active table sequence"]
    has_table = device["Table status.Active slot"] != NO_SLOT
    same = device["Table status.Checksum of active image"] == image.checksum
    if has_table and not same and image.sequence <= active:
        refuse(
            f"export number {image.sequence}",
            f"one above {active}, that of the table in force; export again with --sequence {active + 1}",
        )


def upload_image(
    device: Compensator,
    image: ImageInfo,
    tell: StepListener,
    transfer_progress: ByteProgress,
    block: bool = True,
    confirm: bool = False,
) -> UploadResult:
    """Bring an image into force on a device; an attempt that was interrupted is continued.

    Args:
      device: the compensator.
      image: what to upload.
      tell: called after each step.
      transfer_progress: called during the transfer with bytes done and in all.
      block: SDO block transfer; otherwise segmented.
      confirm: end the trial at once.

    Raises InputError (the image is not for this device), DeviceRefusedError, CommunicationError.
    """
    upload = _Upload(device, image, tell, transfer_progress, block)
    status = device.identify()
    compare(image, status)
    upload.done("compared", "the image is for this device")
    upload.result.on_trial = bool(status["Table status.Trial"])
    if (
        status["Table status.Active slot"] != NO_SLOT
        and status["Table status.Checksum of active image"] == image.checksum
    ):
        upload.done("already in force", "on trial" if upload.result.on_trial else "confirmed")
    elif upload.result.on_trial:
        raise DeviceRefusedError("another table is on trial: 'armtrue device confirm' or 'revert' first")
    else:
        upload.bring_into_force(status)
    if confirm and upload.result.on_trial:
        device.command("cfrm")
        upload.result.on_trial = False
        upload.done("confirmed", "active after every start")
    return upload.result


@dataclass
class _Upload:
    device: Compensator
    image: ImageInfo
    tell: StepListener
    progress: ByteProgress
    block: bool
    result: UploadResult = field(default_factory=UploadResult)

    def done(self, name: str, note: str = "") -> None:
        self.result.steps.append(Step(name, note))
        self.tell(self.result.steps[-1])

    def bring_into_force(self, status: Status) -> None:
        device, result = self.device, self.result
        if (
            status["Table status.Staging state"] in _TRANSFERRED
            and status["Table status.Checksum of staged image"] == self.image.checksum
        ):
            self.done("transferred", "by an earlier attempt")
        else:
            if not device.is_quiet():
                raise DeviceRefusedError(STILL_MOVING)
            self._transfer()
            rate = result.bytes_sent / result.seconds if result.seconds > 0 else 0.0
            words = f"{result.bytes_sent} bytes in {result.seconds:.2f} s ({rate / 1000:.1f} kB/s)"
            self.done("transferred", words)
        device.command("vrfy")
        self.done("verified", "length, checksum, signature, robot, contents")
        device.command("cmit")
        self.done("committed", "in the spare slot")
        device.command("actv")
        active = device.read_number("Table status.Checksum of active image")
        if active != self.image.checksum:
            raise DeviceRefusedError(
                f"the device reports checksum 0x{active:08X} of the active table, "
                f"expected 0x{self.image.checksum:08X}"
            )
        result.on_trial = True
        self.done("activated", "on trial until confirmed: a reset goes back to the one before")

    def _transfer(self) -> None:
        """Transfer the image, and start again from the beginning if the transfer fails."""
        device, begin, frames = self.device, time.monotonic(), self.device.client.frames
        for attempt in range(1, TRANSFER_ATTEMPTS + 1):
            try:
                device.stage(self.image.data, self.block, self.progress)
                break
            except (CommunicationError, SdoAbortError):
                if attempt == TRANSFER_ATTEMPTS:
                    raise
                # The device may still be waiting for segments of the attempt that failed.
                device.client.abort(*STAGING)
            except KeyboardInterrupt:
                device.client.abort(*STAGING)
                raise
        if device.read_number("Table status.Checksum of staged image") != self.image.checksum:
            raise CommunicationError("what arrived is not what was sent (checksum of the staged image)")
        self.result.bytes_sent = len(self.image.data)
        self.result.seconds = time.monotonic() - begin
        self.result.frames = device.client.frames - frames
