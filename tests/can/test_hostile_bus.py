"""Attacks from the bus by tables and objects: all refused, all reported (docs/security.md)."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import canopen
import pytest
from armtrue.tables import layout, signing
from node_process import NODE_ID, NodeProcess, connect, disconnect
from small_table import small_table

OWNER, STRANGER = bytes(range(32)), bytes(range(1, 33))
SERIAL = "KR-0815"
FLAGS_AT, SEQUENCE_AT = 12, 16
UNSIGNED, WRONG_SIGNATURE, OTHER_ROBOT, OLDER, TOO_WIDE = 8, 9, 7, 0x100, 0x101


def signed(image: bytes, seed: bytes) -> bytes:
    """An image as `armtrue export --key` makes it: signed, then with its checksum."""
    body = bytearray(image[: -layout.CHECKSUM.size])
    length = len(image) + layout.SIGNATURE_LENGTH
    struct.pack_into("<I", body, 8, length)
    struct.pack_into("<I", body, FLAGS_AT, layout.FLAG_SIGNED)
    whole = bytes(body) + signing.sign(seed, bytes(body))
    return whole + struct.pack("<I", zlib.crc32(whole))


def table(sequence: int = 7, seed: bytes = OWNER, **changes: int | str) -> bytes:
    return signed(small_table(**{"sequence": sequence, "serial": SERIAL, **changes}), seed)


class Attack:
    """A client on the bus with everything at hand but the secret key."""

    def __init__(self, node: canopen.RemoteNode) -> None:
        self.node = node
        self.emergencies: list[canopen.emcy.EmcyError] = []
        node.emcy.add_callback(self.emergencies.append)

    def command(self, word: str) -> int:
        """A table command; its abort code, 0 if it was carried out."""
        try:
            self.node.sdo.download(0x2012, 0, word.encode())
        except canopen.SdoAbortedError as refusal:
            return int(refusal.code)
        return 0

    def upload(self, image: bytes) -> int:
        """Stage and verify; the refusal reason, 0 if it was verified."""
        self.node.sdo.download(0x2010, 0, image)
        return 0 if self.command("vrfy") == 0 else int(self.read("Table status", "Refusal reason"))

    def install(self, image: bytes) -> None:
        assert self.upload(image) == 0
        assert [self.command(word) for word in ("cmit", "actv", "cfrm")] == [0, 0, 0]

    def read(self, record: str, name: str) -> int:
        return int(self.node.sdo[record][name].raw)

    def active(self) -> bytes:
        return bytes(self.node.sdo.upload(0x2011, 0))


@pytest.fixture
def keyed_node(tmp_path: Path) -> Iterator[NodeProcess]:
    """A device that was built with the owner's key, for one robot."""
    key = tmp_path / "owner.pub"
    key.write_text(f"armtrue-ed25519-public {base64.b64encode(signing.public_key(OWNER)).decode()}\n")
    with NodeProcess(tmp_path / "state", "--public-key", str(key), "--robot-serial", SERIAL) as process:
        yield process


@pytest.fixture
def attack(keyed_node: NodeProcess) -> Iterator[Attack]:
    node = connect()
    attack = Attack(node)
    attack.install(table())
    yield attack
    disconnect(node)


def forged_signature(image: bytes) -> bytes:
    """A changed header with the owner's signature; the checksum is correct."""
    changed = bytearray(image)
    struct.pack_into("<I", changed, SEQUENCE_AT, 99)
    struct.pack_into("<I", changed, len(image) - 4, zlib.crc32(changed[:-4]))
    return bytes(changed)


def signature_cut_off(image: bytes) -> bytes:
    """Signature and signed flag removed, as if the table had never been signed."""
    body = bytearray(image[: -4 - layout.SIGNATURE_LENGTH])
    struct.pack_into("<I", body, 8, len(body) + 4)
    struct.pack_into("<I", body, FLAGS_AT, 0)
    return bytes(body) + struct.pack("<I", zlib.crc32(body))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: small_table(sequence=8, serial=SERIAL), UNSIGNED),
        (lambda: table(8, STRANGER), WRONG_SIGNATURE),
        (lambda: forged_signature(table(8)), WRONG_SIGNATURE),
        (lambda: signature_cut_off(table(8)), UNSIGNED),
        (lambda: table(8, serial="KR-0816"), OTHER_ROBOT),
        (lambda: table(6), OLDER),
        (lambda: table(7, amplitude=1 << 21), OLDER),
        (lambda: table(8, magnitude=1 << 30), TOO_WIDE),
        (lambda: table(8, rate=1 << 30), TOO_WIDE),
    ],
    ids=[
        "unsigned", "signed by a stranger", "altered after signing", "signature cut off", "another robot's",
        "replay of an older one", "another table under the same number", "wider magnitude", "faster rate",
    ],
)  # fmt: skip
def test_unacceptable_table_is_refused_and_reported(
    attack: Attack, make: Callable[[], bytes], reason: int
) -> None:
    before = attack.read("Compensator status", "Refused")
    assert attack.upload(make()) == reason
    for word in ("cmit", "actv", "cfrm"):
        assert attack.command(word) == 0x08000022, "and nothing of it goes on"
    assert attack.active() == table(), "the table in force is the same"
    assert [(error.code, error.data[0] | error.data[1] << 8) for error in attack.emergencies] == [
        (0xFF11, reason)
    ]
    assert attack.read("Compensator status", "Refused") > before
    assert attack.node.sdo[0x1003][1].raw & 0xFFFF == 0xFF11


def test_refused_table_is_refused_after_a_restart_too(attack: Attack, keyed_node: NodeProcess) -> None:
    keyed_node.stop()
    keyed_node.start()
    assert attack.active() == table()
    assert attack.upload(table(6)) == OLDER
    assert attack.upload(table(8, STRANGER)) == WRONG_SIGNATURE


def test_another_robots_image_in_the_flash_is_not_activated(attack: Attack, keyed_node: NodeProcess) -> None:
    """The slots of another robot, complete and signed, with correct checksums."""
    keyed_node.stop()
    state = Path(keyed_node.command[keyed_node.command.index("--state") + 1])
    slots = (state / "slots.bin").read_bytes()
    keyed_node.command += ["--robot-serial", "KR-0816"]
    keyed_node.start()
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        attack.active()
    assert refusal.value.code == 0x08000024, "none: pass-through"
    assert attack.read("Table status", "Slot A state") == 2
    slot = len(slots) // 2
    assert (state / "slots.bin").read_bytes()[:slot] == slots[:slot], "and what is there stays as it is"


def test_table_and_store_requests_are_refused_in_motion(attack: Attack) -> None:
    node = attack.node
    for number in range(3):
        node.sdo[0x1400 + number][1].raw = 0x220 + 0x100 * number
    node.sdo[0x2000][1].raw = 2
    node.sdo[0x2000][5].raw = 60_000  # one minute, so that no pause of this machine counts as quiet
    node.nmt.state = "OPERATIONAL"
    before = attack.read("Compensator status", "Refused")
    for number in range(3):
        node.network.send_message(0x220 + 0x100 * number, bytes(8))
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo.download(0x2010, 0, table(8))
    assert refusal.value.code == 0x08000022
    for word in ("vrfy", "cmit", "actv", "cfrm", "rvrt"):
        assert attack.command(word) == 0x08000022
    for index, sub, value, size in (
        (0x2000, 1, 0, 1),
        (0x1010, 1, 0x65766173, 4),
        (0x1011, 1, 0x64616F6C, 4),
    ):
        with pytest.raises(canopen.SdoAbortedError) as refusal:
            node.sdo.download(index, sub, value.to_bytes(size, "little"))
        assert refusal.value.code == 0x08000022
    assert attack.read("Compensator status", "Refused") == before + 6
    assert attack.active() == table()


def test_write_to_a_read_only_object_is_refused_and_counted(attack: Attack) -> None:
    before = attack.read("Compensator status", "Refused")
    tried = 0
    for entry in attack.node.object_dictionary.values():
        leaves = [entry] if isinstance(entry, canopen.objectdictionary.ODVariable) else list(entry.values())
        for leaf in leaves:
            if leaf.index < 0x1000 or leaf.writable:
                continue
            tried += 1
            with pytest.raises(canopen.SdoAbortedError) as refusal:
                attack.node.sdo.download(leaf.index, leaf.subindex, bytes(max(1, len(leaf) // 8)))
            assert refusal.value.code == 0x06010002, f"{leaf.index:04X}sub{leaf.subindex}"
    assert tried > 150
    assert attack.read("Compensator status", "Refused") == before + tried


def test_control_values_outside_their_ranges_are_refused(attack: Attack) -> None:
    """Time-outs cannot be set so long that stale input counts as fresh."""
    for sub, value in ((3, 499), (3, 1_000_001), (4, 99), (5, 99), (6, 99), (1, 3), (2, 2), (7, 9)):
        size = 1 if sub in (1, 2, 7) else 4
        with pytest.raises(canopen.SdoAbortedError) as refusal:
            attack.node.sdo.download(0x2000, sub, value.to_bytes(size, "little"))
        assert refusal.value.code in (0x06090031, 0x06090032)


def test_extended_and_remote_nmt_and_sdo_frames_are_ignored(attack: Attack) -> None:
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        bus.send(can.Message(arbitration_id=0, data=[0x81, NODE_ID], is_extended_id=True))
        bus.send(can.Message(arbitration_id=0, dlc=2, is_remote_frame=True, is_extended_id=False))
        request = [0x2F, 0x00, 0x20, 2, 0, 0, 0, 0]
        bus.send(can.Message(arbitration_id=0x600 + NODE_ID, data=request, is_extended_id=True))
    assert attack.read("Compensator control", "Correction enable") == 1
    assert attack.read("Table status", "Active table sequence") == 7
