"""Upload of a table: compare, transfer, verify, commit, put on trial, read back. Every step can be repeated."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from armtrue.device.compensator import NO_SLOT, STILL_MOVING, Compensator, DeviceRefusedError, Status
from armtrue.device.image import ImageInfo
from armtrue.device.sdo import CommunicationError, SdoAbortError
from armtrue.errors import InputError
from armtrue.units import plural

TRANSFER_ATTEMPTS = 3
STAGING = (0x2010, 0)  # the object that a table is transferred into
_VERIFIED, _COMMITTED = 3, 5
_RECEIVED = 2


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


# tell(step just finished), transfer(bytes done, bytes in all)
StepListener = Callable[[Step], None]


def compare(image: ImageInfo, device: Status) -> None:
    """Refuse an image that this device would refuse, before a byte is sent.

    Raises InputError naming what was found and what the device expects.
    """

    def refuse(found: str, expected: str) -> None:
        raise InputError(f"{image.path}: {found}, the device expects {expected}")

    if image.format_version > device["Table status.Format version read"]:
        refuse(f"table format {image.format_version}", str(device["Table status.Format version read"]))
    if image.joint_count != device["Compensator status.Joint count"]:
        refuse(
            f"a table for {plural(image.joint_count, 'joint')}", str(device["Compensator status.Joint count"])
        )
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
    transfer_progress: Callable[[int, int], None],
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
    result = UploadResult()

    def done(name: str, note: str = "") -> None:
        step = Step(name, note)
        result.steps.append(step)
        tell(step)

    status = device.identify()
    compare(image, status)
    done("compared", "the image is for this device")
    in_force = (
        status["Table status.Active slot"] != NO_SLOT
        and status["Table status.Checksum of active image"] == image.checksum
    )
    result.on_trial = bool(status["Table status.Trial"])
    if in_force:
        done("already in force", "on trial" if result.on_trial else "confirmed")
    else:
        if result.on_trial:
            raise DeviceRefusedError("another table is on trial: 'armtrue device confirm' or 'revert' first")
        _bring_into_force(device, image, status, done, transfer_progress, block, result)
    if confirm and result.on_trial:
        device.command("cfrm")
        result.on_trial = False
        done("confirmed", "active after every start")
    return result


def _bring_into_force(
    device: Compensator,
    image: ImageInfo,
    status: Status,
    done: Callable[..., None],
    transfer_progress: Callable[[int, int], None],
    block: bool,
    result: UploadResult,
) -> None:
    staging = status["Table status.Staging state"]
    is_there = (
        staging in (_RECEIVED, _VERIFIED, _COMMITTED)
        and status["Table status.Checksum of staged image"] == image.checksum
    )
    if is_there:
        done("transferred", "by an earlier attempt")
    else:
        if not device.is_quiet():
            raise DeviceRefusedError(STILL_MOVING)
        _transfer(device, image, transfer_progress, block, result)
        rate = result.bytes_sent / result.seconds if result.seconds > 0 else 0.0
        done("transferred", f"{result.bytes_sent} bytes in {result.seconds:.2f} s ({rate / 1000:.1f} kB/s)")
    device.command("vrfy")
    done("verified", "length, checksum, signature, robot, contents")
    device.command("cmit")
    done("committed", "in the spare slot")
    device.command("actv")
    active = device.read_number("Table status.Checksum of active image")
    if active != image.checksum:
        raise DeviceRefusedError(
            f"the device reports checksum 0x{active:08X} of the active table, expected 0x{image.checksum:08X}"
        )
    result.on_trial = True
    done("activated", "on trial until confirmed: a reset goes back to the one before")


def _transfer(
    device: Compensator,
    image: ImageInfo,
    progress: Callable[[int, int], None],
    block: bool,
    result: UploadResult,
) -> None:
    """Transfer an image, and start again from the beginning if the transfer fails."""
    begin = time.monotonic()
    frames = device.client.frames
    for attempt in range(1, TRANSFER_ATTEMPTS + 1):
        try:
            device.stage(image.data, block, progress)
            break
        except (CommunicationError, SdoAbortError):
            if attempt == TRANSFER_ATTEMPTS:
                raise
            # The device may still be waiting for segments of the attempt that failed.
            device.client.abort(*STAGING)
        except KeyboardInterrupt:
            device.client.abort(*STAGING)
            raise
    staged = device.read_number("Table status.Checksum of staged image")
    if staged != image.checksum:
        raise CommunicationError("what arrived is not what was sent (checksum of the staged image)")
    result.bytes_sent = len(image.data)
    result.seconds = time.monotonic() - begin
    result.frames = device.client.frames - frames
