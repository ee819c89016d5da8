"""The SDO client with a scripted server: foreign answers, open transfers, sizes, and tables that do not fit."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from armtrue.device import sdo
from armtrue.device.compensator import MODES, Compensator, DeviceRefusedError, Status, name_of
from armtrue.device.image import ImageInfo
from armtrue.device.sdo import CommunicationError, SdoAbortError, SdoClient
from armtrue.device.upload import Step, compare, upload_image
from armtrue.errors import InputError

NODE = 32
ARMT = int.from_bytes(b"ARMT", "big")


class Scripted:
    """A bus on which `answer` gives the answers to each request."""

    def __init__(self, answer: Callable[[bytes], list[bytes]]) -> None:
        self._answer = answer
        self._waiting: deque[can.Message] = deque()
        self.requests: list[bytes] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert len(msg.data) == 8, "an SDO frame always has eight bytes (CiA 301)"
        self.requests.append(bytes(msg.data))
        for data in self._answer(bytes(msg.data)):
            self._waiting.append(can.Message(arbitration_id=0x580 + NODE, data=data, is_extended_id=False))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return self._waiting.popleft() if self._waiting else None


def expedited(request: bytes, value: int) -> bytes:
    return b"\x43" + request[1:4] + value.to_bytes(4, "little")


def test_answers_about_other_objects_are_ignored() -> None:
    def answer(request: bytes) -> list[bytes]:
        foreign = b"\x43\x41\x60\x00" + bytes(4)
        abort = b"\x80\x10\x20\x00" + (0x05040000).to_bytes(4, "little")
        return [foreign, abort, expedited(request, 77)]

    assert SdoClient(Scripted(answer), NODE).upload(0x2001, 1) == (77).to_bytes(4, "little")


def test_abort_of_the_requested_object_raises() -> None:
    def answer(request: bytes) -> list[bytes]:
        return [b"\x80" + request[1:4] + (0x06020000).to_bytes(4, "little")]

    with pytest.raises(SdoAbortError, match="object 0x2001 sub 1: refused with 0x06020000"):
        SdoClient(Scripted(answer), NODE).upload(0x2001, 1)


@pytest.mark.parametrize("announced", [0, 10])
def test_endless_upload_is_aborted(announced: int) -> None:
    def answer(request: bytes) -> list[bytes]:
        if request[0] == 0x40:
            begin = bytes([0x41 if announced else 0x40]) + request[1:4]
            return [begin + announced.to_bytes(4, "little")]
        return [bytes([request[0] & 0x10]) + bytes(7)] if request[0] & 0xE0 == 0x60 else []

    bus = Scripted(answer)
    with pytest.raises(CommunicationError, match=f"more than {announced or 65536} bytes"):
        SdoClient(bus, NODE).upload(0x2011, 0)
    assert bus.requests[-1][0] == 0x80  # the node is told that the transfer is over


@pytest.mark.parametrize("announced", [64 * 1024 + 1, 2**32 - 1])
def test_upload_announced_above_65536_bytes_is_aborted_at_once(announced: int) -> None:
    """A device of another kind announced 4 GB, and was read until the user stopped the command."""

    def answer(request: bytes) -> list[bytes]:
        if request[0] == 0x40:
            return [b"\x41" + request[1:4] + announced.to_bytes(4, "little")]
        assert request[0] == 0x80, "no segment is asked for"
        return []

    bus = Scripted(answer)
    words = (
        rf"^node 32 announced {announced} bytes, expected at most 65536 \(object 0x2011 sub 0\): given up$"
    )
    with pytest.raises(CommunicationError, match=words):
        SdoClient(bus, NODE).upload(0x2011, 0)
    assert [request[0] for request in bus.requests] == [0x40, 0x80]


def test_upload_of_exactly_65536_bytes_is_accepted() -> None:
    whole = bytes(range(256)) * 256
    sent = 0

    def answer(request: bytes) -> list[bytes]:
        nonlocal sent
        if request[0] == 0x40:
            return [b"\x41" + request[1:4] + len(whole).to_bytes(4, "little")]
        piece = whole[sent : sent + 7]
        sent += len(piece)
        command = request[0] & 0x10 | (7 - len(piece)) << 1 | (sent == len(whole))
        return [bytes([command]) + piece.ljust(7, b"\0")]

    assert SdoClient(Scripted(answer), NODE).upload(0x2011, 0) == whole


@pytest.mark.parametrize("size", [0, 128, 255])
@pytest.mark.parametrize("later", [False, True])
def test_block_size_outside_1_to_127_is_refused(size: int, later: bool) -> None:
    def answer(request: bytes) -> list[bytes]:
        if request[0] == 0xC6:
            return [b"\xa4" + request[1:4] + bytes([2 if later else size, 0, 0, 0])]
        return [bytes([0xA2, 2, size]) + bytes(5)] if request[0] & 0x7F == 2 else []

    bus = Scripted(answer)
    with pytest.raises(CommunicationError, match="expected a block of 1 to 127 segments"):
        SdoClient(bus, NODE).download_block(0x1F50, 1, bytes(2000))
    assert len(bus.requests) <= 4


def test_segmented_download_delivers_every_byte() -> None:
    arrived = bytearray()

    def answer(request: bytes) -> list[bytes]:
        if request[0] == 0x21:
            return [b"\x60" + request[1:4] + bytes(4)]
        arrived.extend(request[1 : 8 - (request[0] >> 1 & 7)])
        return [bytes([0x20 | request[0] & 0x10]) + bytes(7)]

    SdoClient(Scripted(answer), NODE).download_segmented(0x1F50, 1, b"123456789")
    assert arrived == b"123456789"


def test_block_download_ends_with_unused_bytes_and_checksum() -> None:
    """The checksum is the published check value of this CRC: 0x31C3 for the text 123456789."""
    answers = {0xC6: b"\xa4\x50\x1f\x01\x7f", 0x82: b"\xa2\x02\x7f", 0xD5: b"\xa1"}
    bus = Scripted(lambda request: [answers[request[0]].ljust(8, b"\0")] if request[0] in answers else [])
    SdoClient(bus, NODE).download_block(0x1F50, 1, b"123456789")
    assert bus.requests[-1] == b"\xd5\xc3\x31" + bytes(5), "5 of the last segment's 7 bytes are unused"


def test_request_is_sent_on_a_bus_that_is_never_idle() -> None:
    class Busy(Scripted):
        def recv(self, timeout: float | None = None) -> can.Message | None:
            return super().recv(timeout) or can.Message(
                arbitration_id=0x181, data=bytes(8), is_extended_id=False
            )

    client = SdoClient(Busy(lambda request: [expedited(request, 5)]), NODE, 0.1)
    assert client.upload(0x2001, 1) == (5).to_bytes(4, "little")


def test_transfer_left_open_by_another_client_is_aborted_first() -> None:
    open_block = True

    def answer(request: bytes) -> list[bytes]:
        nonlocal open_block
        if request[0] == 0x80:
            open_block = False
            return []
        return [] if open_block else [expedited(request, ARMT)]

    bus = Scripted(answer)
    Compensator(SdoClient(bus, NODE, 0.05)).greet()
    assert [request[0] for request in bus.requests] == [0x40, 0x80, 0x40]


def test_silent_node_is_reported_after_three_requests() -> None:
    bus = Scripted(lambda _: [])
    with pytest.raises(CommunicationError, match="node 32 did not answer within 0.05 s"):
        Compensator(SdoClient(bus, NODE, 0.05)).greet()
    assert [request[0] for request in bus.requests] == [0x40, 0x80, 0x40, 0x80, 0x40]


def test_device_that_is_no_compensator_is_refused_by_name() -> None:
    def answer(request: bytes) -> list[bytes]:
        if request[1:3] == b"\x18\x10":
            return [expedited(request, 0x1234)]
        return [b"\x43" + request[1:4] + b"Lift"]

    with pytest.raises(DeviceRefusedError, match=r"'Lift' \(product code 0x00001234\), not a compensator"):
        Compensator(SdoClient(Scripted(answer), NODE)).greet()


DEVICE: dict[str, int | str] = {
    "Table status.Format version read": 1,
    "Compensator status.Joint count": 6,
    "Robot serial": "mine",
    "Table status.Capacity (bytes)": 1000,
    "Table status.Signature required": 1,
    "Table status.Active table sequence": 5,
    "Table status.Active slot": 0,
    "Table status.Checksum of active image": 0xAA,
}


def image(**changes: object) -> ImageInfo:
    fields: dict[str, object] = {
        "path": Path("tables.bin"), "data": bytes(500), "format_version": 1, "joint_count": 6, "sequence": 6,
        "robot_serial": "mine", "is_signed": True, "checksum": 0xBB,
    }  # fmt: skip
    return ImageInfo(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format_version": 2}, "tables.bin: table format 2, the device expects 1"),
        ({"joint_count": 7}, "a table for 7 joints, the device expects 6"),
        ({"robot_serial": "other"}, "a table for robot 'other', the device expects robot 'mine'"),
        ({"data": bytes(1001)}, "1001 bytes, the device expects at most 1000"),
        ({"is_signed": False}, "an unsigned table, the device expects a signed one"),
        (
            {"sequence": 5},
            "export number 5, the device expects one above 5, that of the table in force; "
            "export again with --sequence 6",
        ),
    ],
)
def test_table_that_does_not_fit_the_device_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        compare(image(**changes), Status(DEVICE))


def test_table_for_the_device_or_already_active_is_accepted() -> None:
    compare(image(), Status(DEVICE))
    compare(image(sequence=5, checksum=0xAA), Status(DEVICE))
    compare(image(sequence=1), Status(DEVICE | {"Table status.Active slot": 0xFF}))
    compare(image(robot_serial="other"), Status(DEVICE | {"Robot serial": ""}))


def test_image_transferred_by_an_earlier_attempt_is_not_sent_again() -> None:
    class Received:
        def identify(self) -> Status:
            staged = {"Table status.Staging state": 2, "Table status.Checksum of staged image": 0xBB}
            return Status(DEVICE | staged | {"Table status.Trial": 0})

        def command(self, name: str) -> None: ...

        def read_number(self, name: str) -> int:
            return 0xBB

    told: list[Step] = []
    upload_image(Received(), image(), told.append, lambda done, total: None)  # type: ignore[arg-type]
    assert told[1] == Step("transferred", "by an earlier attempt")


def test_every_abort_code_of_the_firmware_has_a_message() -> None:
    (header,) = (Path(__file__).resolve().parents[3] / "firmware").rglob("sdo_abort.h")
    codes = {int(code, 16) for code in re.findall(r"= 0x([0-9A-F]{8}),", header.read_text(encoding="utf-8"))}
    assert len(codes) > 20
    assert codes <= sdo._ABORT_TEXT.keys()


@pytest.mark.parametrize(("number", "name"), [(0, "forward"), (2, "offset"), (3, "3"), (-1, "-1")])
def test_number_without_a_name_is_shown_as_it_is(number: int, name: str) -> None:
    assert name_of(MODES, number) == name
