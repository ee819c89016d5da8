# ruff: noqa: D103 -- a test says what it checks in its name
"""Tables on any target: their upload and activation, and all that is refused on the way."""

from __future__ import annotations

import struct

import pytest
from armtrue.device import DeviceRefusedError, SdoAbortError
from small_table import small_table
from target import NMT_PREOPERATIONAL, NMT_RESET_NODE, TARGET_IDS, Target


def no_progress(_done: int, _total: int) -> None:
    """Report no progress."""


def next_sequence(target: Target) -> int:
    """A sequence number above those of all earlier tables."""
    target.description["sequence"] = target.description.setdefault("sequence", 100) + 1
    return int(target.description["sequence"])


@pytest.fixture(autouse=True)
def at_rest(target: Target) -> None:
    target.nmt(NMT_PREOPERATIONAL)
    target.wait_until_quiet()


def install(target: Target, image: bytes, *, block: bool = True, confirm: bool = True) -> None:
    target.device.stage(image, block, no_progress)
    for word in ("vrfy", "cmit", "actv", "cfrm") if confirm else ("vrfy", "cmit", "actv"):
        target.device.command(word)


@pytest.mark.parametrize("block", [True, False], ids=["block", "segmented"])
def test_a_table_reads_back_as_it_was_sent(target: Target, block: bool) -> None:
    image = small_table(sequence=next_sequence(target))
    install(target, image, block=block)
    assert target.device.dump(no_progress) == image


@pytest.mark.parametrize("size", [1, 6, 7, 8, 20, 889, 890, 2000])
def test_transfers_of_any_size_arrive(target: Target, size: int) -> None:
    data = bytes((k * 37 + size) % 251 for k in range(size))
    for transfer in (target.client.download_segmented, target.client.download_block):
        transfer(0x2010, 0, data)
        assert target.client.upload(0x2010, 0) == data


def test_reset_ends_an_unconfirmed_trial(target: Target) -> None:
    confirmed = small_table(sequence=next_sequence(target))
    install(target, confirmed)
    install(target, small_table(sequence=next_sequence(target), amplitude=1 << 21), confirm=False)
    assert target.read(0x2013, 14) == 1
    target.reset(NMT_RESET_NODE)
    assert target.read(0x2013, 14) == 0
    expected = confirmed if target.description["persistent"] else b""
    held = target.device.dump(no_progress)
    assert held in (expected, confirmed)


def test_revert_returns_to_the_previous_table(target: Target) -> None:
    confirmed = small_table(sequence=next_sequence(target))
    install(target, confirmed)
    install(target, small_table(sequence=next_sequence(target), amplitude=1 << 21), confirm=False)
    target.device.command("rvrt")
    assert target.device.dump(no_progress) == confirmed


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"joints": 5}, 6),
        ({"magnitude": 1 << 30}, 0x101),
        ({"rate": 1 << 30}, 0x101),
    ],
)
def test_table_unfit_for_this_device_is_refused(target: Target, changes: dict[str, int], reason: int) -> None:
    target.device.stage(small_table(sequence=next_sequence(target), **changes), True, no_progress)
    with pytest.raises(DeviceRefusedError):
        target.device.command("vrfy")
    assert target.read(0x2013, 2) == reason
    assert int.from_bytes(target.client.upload(0x1003, 1)[:2], "little") == 0xFF11
    with pytest.raises(DeviceRefusedError):
        target.device.command("cmit")


def test_a_damaged_table_is_refused(target: Target) -> None:
    image = bytearray(small_table(sequence=next_sequence(target)))
    image[333] ^= 4
    target.device.stage(bytes(image), True, no_progress)
    with pytest.raises(DeviceRefusedError, match="checksum"):
        target.device.command("vrfy")


def test_an_older_export_is_refused(target: Target) -> None:
    older, newer = next_sequence(target), next_sequence(target)
    install(target, small_table(sequence=newer))
    target.device.stage(small_table(sequence=older), True, no_progress)
    with pytest.raises(DeviceRefusedError, match="older export"):
        target.device.command("vrfy")


def test_table_upload_is_refused_while_joints_are_commanded(target: Target) -> None:
    target.configure(1)
    # Longer than any pause of an emulator on a busy machine.
    assert target.write(0x2000, 5, 60_000, 4) == 0
    image = small_table(sequence=next_sequence(target))
    for pair in range(3):
        target.send(TARGET_IDS[pair], struct.pack("<2i", 0, 0))
    with pytest.raises((DeviceRefusedError, SdoAbortError)):
        target.device.stage(image, True, no_progress)
    for pair in range(3):
        target.send(TARGET_IDS[pair], struct.pack("<2i", 0, 0))
    with pytest.raises(DeviceRefusedError):
        target.device.command("vrfy")


def test_the_device_finds_itself_in_order(target: Target) -> None:
    assert all(target.device.self_test().values())
