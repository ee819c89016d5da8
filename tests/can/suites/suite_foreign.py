# ruff: noqa: D103 -- a test says what it checks in its name
"""PyPI canopen against any target: an independent client makes the requests that the other suites make with ours."""

from __future__ import annotations

import gc
import struct
import time
from collections.abc import Callable, Iterator

import can
import canopen
import pytest
from canopen import objectdictionary
from node_process import EDS
from patience import again_if_halted
from refusals import REFUSED
from small_table import small_table
from suite_tables import next_sequence
from target import ARRIVES_WITHIN_S, TARGET_IDS, Target

STATES = {"OPERATIONAL": 5, "STOPPED": 4, "PRE-OPERATIONAL": 127}
BOOT_UP = 0
WATCHED = 0x0A


@pytest.fixture
def foreign(target: Target) -> Iterator[canopen.RemoteNode]:
    """PyPI canopen's view of the device; meanwhile it alone reads the upstream bus."""
    network = canopen.Network(target.upstream)
    network.notifier = can.Notifier(target.upstream, network.listeners, timeout=0.05)
    node = network.add_node(target.node_id, str(EDS))
    node.sdo.RESPONSE_TIMEOUT = ARRIVES_WITHIN_S
    yield node
    gc.collect()  # the client ends a refused transfer when its object is deleted, by a request that waits for an answer
    network.notifier.stop()


def abort_code(ask: Callable[[], object]) -> int:
    """The abort code of a request that is expected to be refused."""
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        ask()
    return int(refusal.value.code)


def await_until(has_come: Callable[[], bool], what: str) -> None:
    give_up = time.monotonic() + ARRIVES_WITHIN_S
    while not has_come():
        assert time.monotonic() < give_up, f"{what} did not come within {ARRIVES_WITHIN_S:g} s"
        time.sleep(0.005)


def command(node: canopen.RemoteNode, word: str) -> None:
    node.sdo.download(0x2012, 0, word.encode())


def test_foreign_reads_by_eds_names_match_the_device(foreign: canopen.RemoteNode) -> None:
    assert foreign.sdo["Device type"].raw == 0xFFFF0192
    assert foreign.sdo["Manufacturer device name"].raw == "Armtrue compensator"
    assert foreign.sdo["Identity object"]["Product code"].raw == int.from_bytes(b"ARMT", "big")
    assert foreign.sdo["Compensator status"]["Joint count"].raw == 6


def test_foreign_reads_have_the_size_of_the_eds(foreign: canopen.RemoteNode) -> None:
    sizes = {0x2: 1, 0x3: 2, 0x4: 4, 0x5: 1, 0x6: 2, 0x7: 4}
    entries = [entry for index, entry in foreign.object_dictionary.items() if index >= 0x1000]
    leaves = [
        leaf
        for entry in entries
        for leaf in ([entry] if isinstance(entry, objectdictionary.ODVariable) else entry.values())
        if leaf.readable and leaf.data_type in sizes and leaf.index != 0x1003
    ]
    for leaf in leaves[::7]:  # every seventh; od_01 reads all of them with our own client
        value = foreign.sdo.upload(leaf.index, leaf.subindex)
        assert len(value) == sizes[leaf.data_type], f"{leaf.index:04X} sub {leaf.subindex}"


@pytest.mark.parametrize(
    ("index", "sub", "data", "code"),
    [
        *REFUSED,
        (0x2012, 0, b"cfrm", 0x08000022),
    ],
)
def test_foreign_requests_are_refused_as_the_standard_says(
    foreign: canopen.RemoteNode, index: int, sub: int, data: bytes | None, code: int
) -> None:
    if data is None:
        assert abort_code(lambda: foreign.sdo.upload(index, sub)) == code
    else:
        assert abort_code(lambda: foreign.sdo.download(index, sub, data)) == code


# This client cannot repeat the end of a block: no burst may be longer than the device can receive.
@pytest.mark.parametrize("size", [1, 7, 8, 434, 435])
def test_foreign_transfers_read_back(foreign: canopen.RemoteNode, size: int) -> None:
    segmented = bytes((7 * k + size) % 251 for k in range(size))
    again_if_halted(lambda: foreign.sdo.download(0x2010, 0, segmented))
    assert again_if_halted(lambda: foreign.sdo.upload(0x2010, 0)) == segmented
    block = bytes((k * k + size) % 253 for k in range(size))
    again_if_halted(lambda: write_block(foreign, block))
    assert again_if_halted(lambda: read_block(foreign)) == block


def write_block(node: canopen.RemoteNode, data: bytes) -> None:
    # The client's block writer wants chunks that are multiples of seven (its issue 618).
    with node.sdo.open(0x2010, 0, "wb", size=len(data), block_transfer=True, buffering=7 * 127) as stream:
        stream.write(data)


def read_block(node: canopen.RemoteNode) -> bytes:
    with node.sdo.open(0x2010, 0, "rb", block_transfer=True) as stream:
        return bytes(stream.read())


def test_foreign_download_above_the_capacity_is_refused(foreign: canopen.RemoteNode) -> None:
    capacity = foreign.sdo["Table status"]["Capacity (bytes)"].raw
    assert abort_code(lambda: foreign.sdo.download(0x2010, 0, bytes(capacity + 1))) == 0x05040005


def test_foreign_nmt_commands_take_effect_and_show_in_heartbeats(foreign: canopen.RemoteNode) -> None:
    heard: list[int] = []
    foreign.nmt.add_heartbeat_callback(heard.append)
    foreign.sdo["Producer heartbeat time"].raw = 50
    for name, number in STATES.items():
        foreign.nmt.state = name
        heard.clear()
        await_until(lambda number=number: number in heard, name)
    for reset in ("RESET COMMUNICATION", "RESET"):
        heard.clear()
        foreign.nmt.state = reset
        await_until(lambda: BOOT_UP in heard, f"boot-up after {reset}")
        assert foreign.sdo["Producer heartbeat time"].raw == 0, "as delivered"
        foreign.sdo["Producer heartbeat time"].raw = 50


def test_foreign_heartbeat_loss_and_return_are_reported(foreign: canopen.RemoteNode, target: Target) -> None:
    emergencies: list[canopen.emcy.EmcyError] = []
    foreign.emcy.add_callback(emergencies.append)
    foreign.sdo["Consumer heartbeat time"][1].raw = WATCHED << 16 | int(100 * target.patience)
    foreign.network.send_message(0x700 + WATCHED, b"\5")
    await_until(lambda: bool(emergencies), "the emergency message")
    assert (emergencies[0].code, emergencies[0].data[0]) == (0x8130, WATCHED)
    foreign.network.send_message(0x700 + WATCHED, b"\5")
    await_until(lambda: len(emergencies) > 1, "its end")
    assert emergencies[1].code == 0


def test_foreign_pdo_mapping_by_the_clients_procedure(foreign: canopen.RemoteNode) -> None:
    tpdo = foreign.tpdo[9]
    tpdo.read()
    tpdo.clear()
    tpdo.add_variable(0x2001, 12)
    tpdo.cob_id, tpdo.trans_type, tpdo.event_timer, tpdo.enabled = 0x1F8, 254, 20, True
    came: list[int] = []
    tpdo.add_callback(lambda message: came.append(message[0].raw))
    tpdo.save()
    foreign.nmt.state = "OPERATIONAL"
    await_until(lambda: len(came) >= 3, "the PDO")
    assert set(came) == {6}


def test_foreign_upload_installs_a_table_and_refuses_wrong_ones(
    foreign: canopen.RemoteNode, target: Target
) -> None:
    emergencies: list[canopen.emcy.EmcyError] = []
    foreign.emcy.add_callback(emergencies.append)
    image = small_table(sequence=next_sequence(target))
    again_if_halted(lambda: foreign.sdo.download(0x2010, 0, image))
    for word in ("vrfy", "cmit", "actv", "cfrm"):
        command(foreign, word)
    assert again_if_halted(lambda: foreign.sdo.upload(0x2011, 0)) == image

    damaged = bytearray(small_table(sequence=next_sequence(target)))
    damaged[333] ^= 4
    wrong = [
        (bytes(damaged), 5),
        (small_table(sequence=1), 0x100),
        (small_table(sequence=next_sequence(target), joints=5), 6),
        (small_table(sequence=next_sequence(target), magnitude=1 << 30), 0x101),
    ]
    for number, (other, reason) in enumerate(wrong):
        again_if_halted(lambda other=other: foreign.sdo.download(0x2010, 0, other))
        assert abort_code(lambda: command(foreign, "vrfy")) == 0x06040043
        assert foreign.sdo["Table status"]["Refusal reason"].raw == reason
        assert abort_code(lambda: command(foreign, "cmit")) == 0x08000022
        if number == 0:
            await_until(lambda: bool(emergencies), "the emergency message")
            assert (emergencies[0].code, emergencies[0].data[0] | emergencies[0].data[1] << 8) == (0xFF11, 5)
    assert again_if_halted(lambda: foreign.sdo.upload(0x2011, 0)) == image, "the table in force is the same"


def test_foreign_writes_are_refused_while_joints_are_commanded(foreign: canopen.RemoteNode) -> None:
    for pair in range(3):
        foreign.sdo[0x1400 + pair][1].raw = TARGET_IDS[pair]
    foreign.sdo["Compensator control"]["Mode"].raw = 1
    # Longer than any pause of an emulator on a busy machine.
    foreign.sdo["Compensator control"]["Quiet time before commit (ms)"].raw = 60_000
    foreign.nmt.state = "OPERATIONAL"
    for pair in range(3):
        foreign.network.send_message(TARGET_IDS[pair], struct.pack("<2i", 0, 0))
    sdo = foreign.sdo
    assert abort_code(lambda: sdo.download(0x2010, 0, small_table())) == 0x08000022
    assert abort_code(lambda: command(foreign, "rvrt")) == 0x08000022
    assert abort_code(lambda: sdo.download(0x2000, 1, b"\0")) == 0x08000022
    assert abort_code(lambda: sdo.download(0x1010, 1, b"save")) == 0x08000022
    assert abort_code(lambda: sdo.download(0x1400, 1, b"\x21\2\0\0")) == 0x08000022
