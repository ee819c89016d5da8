"""The SDO server, driven by an independent client (PyPI canopen)."""

from __future__ import annotations

import canopen
import pytest
from patience import again_if_halted
from refusals import REFUSED


def test_identity_and_names_come_from_the_eds(remote: canopen.RemoteNode) -> None:
    assert remote.sdo["Device type"].raw == 0xFFFF0192
    assert remote.sdo["Manufacturer device name"].raw == "Armtrue compensator"
    assert remote.sdo["Identity object"]["Product code"].raw == int.from_bytes(b"ARMT", "big")
    assert remote.sdo["Identity object"]["Serial number"].raw == 1


def test_every_readable_object_of_the_eds_reads_with_its_own_size(remote: canopen.RemoteNode) -> None:
    sizes = {0x2: 1, 0x3: 2, 0x4: 4, 0x5: 1, 0x6: 2, 0x7: 4}
    read = 0
    objects = [entry for index, entry in remote.object_dictionary.items() if index >= 0x1000]
    for entry in objects:
        leaves = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        for leaf in leaves:
            if "r" not in leaf.access_type and leaf.access_type != "const":
                with pytest.raises(canopen.SdoAbortedError) as refusal:
                    remote.sdo.upload(leaf.index, leaf.subindex)
                assert refusal.value.code == 0x06010001
                continue
            if leaf.data_type == canopen.objectdictionary.DOMAIN:
                continue
            if leaf.index == 0x1003 and leaf.subindex > 0:
                with pytest.raises(canopen.SdoAbortedError) as refusal:
                    remote.sdo.upload(leaf.index, leaf.subindex)
                assert refusal.value.code == 0x08000024, "no error is held there"
                continue
            value = remote.sdo.upload(leaf.index, leaf.subindex)
            assert len(value) == sizes.get(leaf.data_type, len(value)), f"{leaf.index:04X}sub{leaf.subindex}"
            read += 1
    assert read > 500


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        *REFUSED,
        (0x1005, 0, b"\x80\0\0\x40", 0x06090030),
        (0x6064, 0, b"\0\0\0\0", 0x06010002),
        (0x1A00, 1, b"\x20\0\x64\x60", 0x06010000),
    ],
)
def test_refusals_carry_the_code_of_the_standard(
    remote: canopen.RemoteNode, index: int, sub: int, data: bytes | None, code: int
) -> None:
    if index == 0x1A00:
        remote.sdo[0x1800][1].raw = 0xC00001A0
        remote.sdo[0x1A00][0].raw = 2
    transfer = [index, sub] if data is None else [index, sub, data]
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        (remote.sdo.upload if data is None else remote.sdo.download)(*transfer)
    assert refusal.value.code == code


# All sizes up to 128, with every length of the last segment; then sizes around one and several blocks of 127 segments
# and the largest table. All 16384 sizes, by this client and the same server, go through tests/can/every_size.py
# (tools/bench.d/62-sizes.sh), and by our own through firmware/testing/sizes_main.cc.
EVERY_SIZE_UP_TO = 128
SAMPLES = (
    888,
    889,
    890,
    1777,
    1778,
    1779,
    4096,
    *(pytest.param(size, marks=pytest.mark.full) for size in (16383, 16384)),
)


def test_segmented_transfers_of_every_small_size_read_back(remote: canopen.RemoteNode) -> None:
    for size in range(1, EVERY_SIZE_UP_TO + 1):
        image = bytes((7 * k + size) % 251 for k in range(size))
        again_if_halted(lambda image=image: remote.sdo.download(0x2010, 0, image))
        assert again_if_halted(lambda: remote.sdo.upload(0x2010, 0)) == image, size


@pytest.mark.parametrize("size", SAMPLES)
def test_segmented_download_reads_back(remote: canopen.RemoteNode, size: int) -> None:
    image = bytes((7 * k + size) % 251 for k in range(size))
    again_if_halted(lambda: remote.sdo.download(0x2010, 0, image))
    assert remote.sdo["Table status"]["Bytes staged"].raw == size
    assert again_if_halted(lambda: remote.sdo.upload(0x2010, 0)) == image


def test_staging_more_than_a_slot_is_refused(remote: canopen.RemoteNode) -> None:
    capacity = remote.sdo["Table status"]["Capacity (bytes)"].raw
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        remote.sdo.download(0x2010, 0, bytes(capacity + 1))
    assert refusal.value.code == 0x05040005


@pytest.mark.parametrize("size", [7, 14, 889, 896, 16380])
def test_block_download_and_upload(remote: canopen.RemoteNode, size: int) -> None:
    # The client's block writer wants chunks that are multiples of seven (its issue 618).
    image = bytes((k * k + size) % 253 for k in range(size))

    def write() -> None:
        with remote.sdo.open(0x2010, 0, "wb", size=size, block_transfer=True, buffering=7 * 127) as stream:
            stream.write(image)

    def read() -> bytes:
        with remote.sdo.open(0x2010, 0, "rb", block_transfer=True) as stream:
            return bytes(stream.read())

    again_if_halted(write)
    assert again_if_halted(read) == image
