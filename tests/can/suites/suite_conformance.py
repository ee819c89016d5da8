# ruff: noqa: D103 -- a test says what it checks in its name
"""CiA 301 conformance, case by case, against any target.

The cases are those of the CiA conformance test as its published log lists them (CANopenNode's
CANopenDemo, test/test_report_CCT.md), written anew from the standard: request bytes and the abort codes
that are allowed; a test's name has the number of its case. Which are left out and why: docs/conformance.md.
"""

from __future__ import annotations

import binascii
import random
import time

import canopen
import pytest
from armtrue.device import SdoAbortError
from canopen import objectdictionary
from node_process import EDS
from target import (
    ARRIVES_WITHIN_S,
    NMT_PREOPERATIONAL,
    NMT_RESET_COMMUNICATION,
    NMT_RESET_NODE,
    NMT_START,
    NMT_STOP,
    Target,
)

GENERAL = 0x08000000
# CiA 301, table 41: identifiers that SYNC, EMCY and PDO must not be moved to (the ends of each range).
RESTRICTED_IDS = (
    0x000,
    0x001,
    0x07F,
    0x101,
    0x180,
    0x581,
    0x5FF,
    0x601,
    0x67F,
    0x6E0,
    0x6FF,
    0x701,
    0x77F,
    0x7FF,
)


MAPPABLE_RW, MAPPABLE_RO, NOT_MAPPABLE, DUMMY = 0x20210020, 0x10010008, 0x10000020, 0x00050008
# The last TPDO and the last RPDO: nothing else in these tests depends on them.
TPDO, TPDO_MAP, TPDO_ID = 0x1808, 0x1A08, 0x1F8
RPDO, RPDO_MAP, RPDO_ID = 0x1412, 0x1612, 0x1F1


@pytest.fixture(autouse=True)
def factory_state(target: Target) -> None:
    """Before each case: communication parameters as delivered, pre-operational."""
    target.reset(NMT_RESET_COMMUNICATION)


def test_sdo_01_expedited_read_of_1000h(target: Target) -> None:
    assert target.ask(0x40, 0x00, 0x10, 0, 0, 0, 0, 0)[:4] == bytes([0x43, 0x00, 0x10, 0])


def test_sdo_02_read_and_write_back_a_communication_object(target: Target) -> None:
    value = target.ask(0x40, 0x17, 0x10, 0, 0, 0, 0, 0)
    assert value[0] == 0x4B
    assert target.ask(0x2B, 0x17, 0x10, 0, *value[4:6], 0, 0) == bytes([0x60, 0x17, 0x10, 0, 0, 0, 0, 0])


def test_sdo_03_write_to_1000h(target: Target) -> None:
    allowed = (0x06010000, 0x06010002, GENERAL)
    assert target.abort_code(0x23, 0x00, 0x10, 0, 1, 2, 3, 4) in allowed


def test_sdo_04_read_of_a_write_only_object(target: Target) -> None:
    assert target.abort_code(0x40, 0x12, 0x20, 0, 0, 0, 0, 0) in (0x06010000, 0x06010001, GENERAL)


def test_sdo_05_absent_sub_index(target: Target) -> None:
    assert target.abort_code(0x40, 0x00, 0x10, 1, 0, 0, 0, 0) in (0x06090011, GENERAL)


def test_sdo_06_absent_object(target: Target) -> None:
    assert target.abort_code(0x40, 0x04, 0x10, 0, 0, 0, 0, 0) in (0x06020000, GENERAL)


def test_sdo_07_unknown_command(target: Target) -> None:
    assert target.abort_code(0xE0, 0x00, 0x10, 0, 0, 0, 0, 0) in (0x05040001, GENERAL)


def test_sdo_08_four_bytes_to_a_one_byte_object(target: Target) -> None:
    assert target.abort_code(0x23, 0x03, 0x10, 0, 0, 0, 0, 0) in (0x06070010, 0x06070012, GENERAL)


def test_sdo_09_one_byte_to_a_four_byte_object(target: Target) -> None:
    assert target.abort_code(0x2F, 0x05, 0x10, 0, 0x80, 0, 0, 0) in (0x06070010, 0x06070013, GENERAL)


def test_sdo_10_value_too_high(target: Target) -> None:
    assert target.abort_code(0x2F, 0x03, 0x10, 0, 0xFF, 0, 0, 0) in (0x06090030, 0x06090031, GENERAL)


def test_sdo_11_value_too_low(target: Target) -> None:
    assert target.abort_code(0x23, 0x00, 0x20, 3, 1, 0, 0, 0) in (0x06090030, 0x06090032, GENERAL)


def test_sdo_12_server_parameters_are_the_predefined_ones(target: Target) -> None:
    assert target.read(0x1200, 1) == 0x600 + target.node_id
    assert target.read(0x1200, 2) == 0x580 + target.node_id


def test_sdo_13_read_of_1000h_needs_no_segments(target: Target) -> None:
    assert target.ask(0x40, 0x00, 0x10, 0, 0, 0, 0, 0)[0] == 0x43


def test_sdo_15_segmented_write_of_1017h(target: Target) -> None:
    assert target.ask(0x21, 0x17, 0x10, 0, 2, 0, 0, 0) == bytes([0x60, 0x17, 0x10, 0, 0, 0, 0, 0])
    assert target.ask(0x0B, 0, 0, 0, 0, 0, 0, 0) == bytes([0x20, 0, 0, 0, 0, 0, 0, 0])


def test_sdo_16_and_18_segmented_read(target: Target) -> None:
    first = target.ask(0x40, 0x08, 0x10, 0, 0, 0, 0, 0)
    assert first[0] == 0x41
    text = b""
    toggle = 0
    while True:
        segment = target.ask(0x60 | toggle, 0, 0, 0, 0, 0, 0, 0)
        assert segment[0] & 0x10 == toggle
        text += segment[1 : 8 - (segment[0] >> 1 & 7)]
        if segment[0] & 1:
            break
        toggle ^= 0x10
    assert len(text) == int.from_bytes(first[4:], "little")


def test_sdo_17_segmented_read_with_a_wrong_toggle_bit(target: Target) -> None:
    target.ask(0x40, 0x08, 0x10, 0, 0, 0, 0, 0)
    assert target.abort_code(0x70, 0, 0, 0, 0, 0, 0, 0) == 0x05030000


def _block_read(target: Target, index: int, crc: bool) -> bytes:
    answer = target.ask(0xA4 if crc else 0xA0, index & 0xFF, index >> 8, 0, 20, 0, 0, 0)
    assert answer[0] & 0xE3 == 0xC2 or answer[0] & 0xE0 == 0xC0
    size = int.from_bytes(answer[4:], "little")
    target.send(0x600 + target.node_id, [0xA3, 0, 0, 0, 0, 0, 0, 0])
    data, number = b"", 0
    while True:
        segment = target.expect(0x580 + target.node_id)
        number += 1
        assert segment[0] & 0x7F == number
        data += segment[1:]
        if segment[0] & 0x80:
            break
    target.send(0x600 + target.node_id, [0xA2, number, 20, 0, 0, 0, 0, 0])
    end = target.expect(0x580 + target.node_id)
    assert end[0] & 0xE3 == 0xC1
    data = data[: len(data) - (end[0] >> 2 & 7)]
    assert len(data) == size
    if crc:
        assert int.from_bytes(end[1:3], "little") == binascii.crc_hqx(data, 0)
    target.send(0x600 + target.node_id, [0xA1, 0, 0, 0, 0, 0, 0, 0])
    return data


@pytest.mark.parametrize("crc", [False, True], ids=["sdo_19", "sdo_19_with_crc"])
def test_sdo_19_block_read_of_1000h(target: Target, crc: bool) -> None:
    assert int.from_bytes(_block_read(target, 0x1000, crc), "little") == target.read(0x1000, 0)


@pytest.mark.parametrize("crc", [False, True], ids=["sdo_22", "sdo_23"])
def test_sdo_22_23_block_read_of_a_string(target: Target, crc: bool) -> None:
    assert _block_read(target, 0x1008, crc) == b"Armtrue compensator"


@pytest.mark.parametrize("crc", [False, True], ids=["sdo_21", "sdo_25"])
def test_sdo_21_25_block_write_of_1017h(target: Target, crc: bool) -> None:
    answer = target.ask(0xC6 if crc else 0xC2, 0x17, 0x10, 0, 2, 0, 0, 0)
    assert answer[0] & 0xE3 == 0xA0
    assert target.ask(0x81, 0, 0, 0, 0, 0, 0, 0)[:2] == bytes([0xA2, 1])
    check = binascii.crc_hqx(b"\0\0", 0) if crc else 0
    assert target.ask(0xD5, check & 0xFF, check >> 8, 0, 0, 0, 0, 0)[0] == 0xA1


def test_sdo_26_block_size_128(target: Target) -> None:
    assert target.abort_code(0xA0, 0x00, 0x10, 0, 128, 0, 0, 0) in (0x05040001, 0x05040002, GENERAL)


def test_sdo_27_block_sequence_number_128(target: Target) -> None:
    target.ask(0xA0, 0x08, 0x10, 0, 20, 0, 0, 0)
    target.send(0x600 + target.node_id, [0xA3, 0, 0, 0, 0, 0, 0, 0])
    while not target.expect(0x580 + target.node_id)[0] & 0x80:
        pass
    code = target.abort_code(0xA2, 128, 20, 0, 0, 0, 0, 0)
    assert code in (0x05040001, 0x05040003, GENERAL)


def test_sdo_28_no_further_servers(target: Target) -> None:
    for number in (1, 2, 63, 127):
        code = target.abort_code(0x40, number, 0x12, 1, 0, 0, 0, 0)
        assert code in (0x06020000, GENERAL)


def test_pdo_01_receive_pdos_have_identifiers(target: Target) -> None:
    for number in range(19):
        assert target.read(0x1400 + number, 1) & 0x7FF == (
            0x200 + 0x100 * number + target.node_id if number < 4 else 0
        )


def test_pdo_02_transmit_pdos_have_identifiers(target: Target) -> None:
    for number in range(9):
        cob_id = target.read(0x1800 + number, 1)
        assert cob_id & 0x40000000, "no answer to remote requests"
        assert cob_id & 0x7FF == (0x180 + 0x100 * number + target.node_id if number < 4 else 0)


def enable_tpdo(target: Target, transmission: int, timer_ms: int = 0) -> None:
    """The last TPDO on 0x1F8 with its default mapping."""
    assert target.write(TPDO, 2, transmission, 1) == 0
    assert target.write(TPDO, 5, timer_ms, 2) == 0
    assert target.write(TPDO, 1, 0x40000000 | TPDO_ID, 4) == 0


@pytest.mark.parametrize(
    ("command", "sends"),
    [(NMT_START, True), (NMT_STOP, False), (NMT_PREOPERATIONAL, False)],
    ids=["pdo_04_to_07_operational", "pdo_10_to_13_stopped", "pdo_16_to_19_pre_operational"],
)
@pytest.mark.parametrize(
    ("transmission", "timer_ms", "syncs"),
    [(254, 0, 0), (254, 60, 0), (1, 0, 1), (0, 0, 1)],
    ids=["event", "timer", "cyclic", "acyclic"],
)
def test_pdo_04_to_19_tpdos_by_kind_and_state(
    target: Target, command: int, sends: bool, transmission: int, timer_ms: int, syncs: int
) -> None:
    enable_tpdo(target, transmission, timer_ms)
    # Map an object that does not change by itself: only the trigger under test sends the PDO.
    assert target.write(TPDO, 1, 0xC0000000 | TPDO_ID, 4) == 0
    assert target.write(TPDO_MAP, 0, 0, 1) == 0
    assert target.write(TPDO_MAP, 1, MAPPABLE_RO, 4) == 0
    assert target.write(TPDO_MAP, 0, 1, 1) == 0
    assert target.write(TPDO, 1, 0x40000000 | TPDO_ID, 4) == 0
    target.nmt(command)
    for _ in range(syncs):
        target.send(0x80)
    if not sends:
        assert target.next_frame(TPDO_ID, timeout_s=0.15) is None
        return
    for _ in range(3 if timer_ms else 1):
        assert target.expect(TPDO_ID) == b"\0"


def test_pdo_06_cyclic_types_count_syncs_and_reserved_types_are_refused(target: Target) -> None:
    for accepted in (0, 1, 240, 254, 255):
        assert target.write(TPDO, 2, accepted, 1) == 0
    for reserved in (241, 251, 252, 253):
        assert target.write(TPDO, 2, reserved, 1) == 0x06090030
    enable_tpdo(target, 2)
    target.nmt(NMT_START)
    target.until_answered()
    for _ in range(8):
        target.send(0x80)
    assert [frame.arbitration_id for frame in target.until_answered()].count(TPDO_ID) == 4


@pytest.mark.parametrize(
    ("command", "sends"),
    [(NMT_START, True), (NMT_STOP, False), (NMT_PREOPERATIONAL, False)],
    ids=["pdo_08", "pdo_14", "pdo_20"],
)
def test_pdo_08_14_20_sync_start_value(target: Target, command: int, sends: bool) -> None:
    assert target.write(0x1019, 0, 10, 1) == 0
    assert target.write(TPDO, 6, 3, 1) == 0
    enable_tpdo(target, 1)
    target.nmt(command)
    target.quiet()
    for counter in (1, 2):
        target.send(0x80, [counter])
    assert target.next_frame(TPDO_ID, timeout_s=0.15) is None
    target.send(0x80, [3])
    if sends:
        target.expect(TPDO_ID)
    else:
        assert target.next_frame(TPDO_ID, timeout_s=0.15) is None


def test_pdo_03_remote_requests_are_not_answered(target: Target) -> None:
    enable_tpdo(target, 1)
    target.nmt(NMT_START)
    target.quiet()
    target.send_remote(TPDO_ID)
    assert target.next_frame(TPDO_ID, timeout_s=0.15) is None


def test_pdo_21_default_mappings_name_objects_of_that_size(target: Target) -> None:
    for base, count in ((0x1600, 19), (0x1A00, 9)):
        for number in range(count):
            for sub in range(1, target.read(base + number, 0) + 1):
                word = target.read(base + number, sub)
                value = target.client.upload(word >> 16, word >> 8 & 0xFF)
                assert len(value) * 8 == word & 0xFF, f"{base + number:04X} sub {sub}"


def disable_pdo(target: Target, communication: int) -> None:
    bit, identifier = (0xC0000000, TPDO_ID) if communication >= 0x1800 else (0x80000000, RPDO_ID)
    assert target.write(communication, 1, bit | identifier, 4) == 0


def test_pdo_22_mapping_by_the_procedure_of_the_standard(target: Target) -> None:
    for communication, mapping, word in ((RPDO, RPDO_MAP, MAPPABLE_RW), (TPDO, TPDO_MAP, MAPPABLE_RO)):
        disable_pdo(target, communication)
        assert target.write(mapping, 0, 0, 1) == 0
        assert target.write(mapping, 1, word, 4) == 0
        assert target.write(mapping, 0, 1, 1) == 0
        assert target.read(mapping, 1) == word


def test_pdo_23_write_to_a_mapping_in_use_is_refused(target: Target) -> None:
    for communication, mapping, word in ((RPDO, RPDO_MAP, MAPPABLE_RW), (TPDO, TPDO_MAP, MAPPABLE_RO)):
        disable_pdo(target, communication)
        assert target.write(mapping, 1, word, 4) in (0x06010000, 0x06040041, GENERAL)


def test_pdo_24_mapping_change_of_a_valid_pdo_is_refused(target: Target) -> None:
    assert target.write(RPDO, 1, RPDO_ID, 4) == 0
    assert target.write(TPDO, 1, 0x40000000 | TPDO_ID, 4) == 0
    for mapping in (RPDO_MAP, TPDO_MAP):
        assert target.write(mapping, 0, 0, 1) in (0x06010000, 0x06040041, GENERAL)


@pytest.mark.parametrize("case", ["pdo_25_too_many", "pdo_26_too_long"])
def test_pdo_25_26_mapping_beyond_the_pdo_size_is_refused(target: Target, case: str) -> None:
    allowed = (0x06020000, 0x06040041, 0x06040042)
    word = MAPPABLE_RO if case == "pdo_25_too_many" else 0x60640020
    disable_pdo(target, TPDO)
    assert target.write(TPDO_MAP, 0, 0, 1) == 0
    for sub in range(1, 9):
        assert target.write(TPDO_MAP, sub, word, 4) == 0
    if case == "pdo_25_too_many":
        assert target.write(TPDO_MAP, 0, 9, 1) in allowed
    else:
        # Thirty-two bytes: on a bus with FD frames they fit.
        assert (target.write(TPDO_MAP, 0, 8, 1) == 0) == target.has_fd
        if not target.has_fd:
            assert target.write(TPDO_MAP, 0, 8, 1) in allowed


@pytest.mark.parametrize(
    ("mapping", "word", "allowed"),
    [
        (RPDO_MAP, MAPPABLE_RW, (0,)),
        (RPDO_MAP, MAPPABLE_RO, (0x06020000, 0x06040041)),
        (RPDO_MAP, NOT_MAPPABLE, (0x06020000, 0x06040041)),
        (TPDO_MAP, MAPPABLE_RO, (0,)),
        (TPDO_MAP, NOT_MAPPABLE, (0x06020000, 0x06040041)),
        (RPDO_MAP, DUMMY, (0,)),
    ],
    ids=["pdo_27", "pdo_28", "pdo_29", "pdo_30", "pdo_32", "pdo_33"],
)
def test_pdo_27_to_33_only_mappable_objects_can_be_mapped(
    target: Target, mapping: int, word: int, allowed: tuple[int, ...]
) -> None:
    disable_pdo(target, RPDO if mapping == RPDO_MAP else TPDO)
    assert target.write(mapping, 0, 0, 1) == 0
    assert target.write(mapping, 1, word, 4) in allowed


def leaves(od: objectdictionary.ObjectDictionary) -> list[objectdictionary.ODVariable]:
    """Every variable of the EDS but the DOMAINs."""
    found: list[objectdictionary.ODVariable] = []
    for entry in od.values():
        found += [entry] if isinstance(entry, objectdictionary.ODVariable) else list(entry.values())
    return [leaf for leaf in found if leaf.index >= 0x1000 and leaf.data_type != objectdictionary.DOMAIN]


def test_od_01_every_object_by_its_access_type(target: Target) -> None:
    for leaf in leaves(canopen.import_od(str(EDS), target.node_id)):
        place = (leaf.index, leaf.subindex)
        if leaf.index == 0x1003 and leaf.subindex > 0:
            continue  # emergency_03
        if leaf.access_type == "wo":
            with pytest.raises(SdoAbortError) as refusal:
                target.client.upload(*place)
            assert refusal.value.code == 0x06010001
            continue
        value = target.client.upload(*place)
        # Not written back: mappings in use, and 0x1010 and 0x1011, which expect "save" and "load".
        is_mapping = 0x1600 <= leaf.index < 0x1800 or 0x1A00 <= leaf.index < 0x1C00
        is_command = leaf.index in (0x1010, 0x1011)
        if leaf.access_type == "rw" and not is_command and not (is_mapping and leaf.subindex > 0):
            target.client.download(*place, value, 5.0 * target.patience)
        elif leaf.access_type in ("ro", "const") and 1 <= len(value) <= 4:
            with pytest.raises(SdoAbortError) as refusal:
                target.client.download(*place, value)
            assert refusal.value.code == 0x06010002


def test_od_05_no_object_has_a_sub_index_255(target: Target) -> None:
    """Sub-index 255 would tell the object's type; the EDS lists none."""
    for index in (0x1000, 0x1018, 0x1600, 0x2013):
        assert target.abort_code(0x40, index & 0xFF, index >> 8, 255, 0, 0, 0, 0) == 0x06090011


def test_od_06_value_beyond_an_objects_limits_is_refused(target: Target) -> None:
    limited = [
        leaf
        for leaf in leaves(canopen.import_od(str(EDS), target.node_id))
        if leaf.access_type == "rw" and leaf.min is not None and leaf.max is not None
    ]
    assert len(limited) >= 10
    for leaf in limited:
        size = len(leaf) // 8
        before = target.client.upload(leaf.index, leaf.subindex)
        for value in (leaf.min - 1, leaf.max + 1):
            if 0 <= value < 1 << len(leaf):
                refusal = target.write(leaf.index, leaf.subindex, value, size)
                assert refusal in (0x06090030, 0x06090031, 0x06090032, GENERAL), f"{leaf.index:04X} {value}"
        assert target.client.upload(leaf.index, leaf.subindex) == before


def test_od_02_communication_objects_hold_their_defaults(target: Target) -> None:
    """Not compared: 0x1001 to 0x1003, which hold this device's state, and 0x1018 sub 4, its serial number."""
    for leaf in leaves(canopen.import_od(str(EDS), target.node_id)):
        place = (leaf.index, leaf.subindex)
        is_own = leaf.index in (0x1001, 0x1002, 0x1003) or place == (0x1018, 4)
        if leaf.index >= 0x2000 or is_own or leaf.default is None:
            continue
        value = target.client.upload(*place)
        assert leaf.decode_raw(value) == leaf.default, f"{leaf.index:04X} sub {leaf.subindex}"


def test_emergency_01_02_03_no_error_at_rest(target: Target) -> None:
    # After a test that sent a temperature, the device reports 0xFF12 (no further one came) until it is reset.
    target.reset()
    assert target.read(0x1014, 0) == 0x80 + target.node_id
    assert target.read(0x1001, 0) == 0
    assert target.read(0x1003, 0) == 0
    assert target.abort_code(0x40, 0x03, 0x10, 1, 0, 0, 0, 0) in (0x08000024, GENERAL)


def test_emergency_04_05_06_pdo_without_data_is_reported(target: Target) -> None:
    assert target.write(RPDO, 1, RPDO_ID, 4) == 0
    target.nmt(NMT_START)
    target.quiet()
    target.send(RPDO_ID)
    message = target.expect(0x80 + target.node_id)
    assert int.from_bytes(message[:2], "little") == 0x8210
    assert target.read(0x1001, 0) == message[2] == 0x11
    assert target.read(0x1003, 0) == 1
    # The history entry: error code, then the first two manufacturer-specific bytes.
    assert target.read(0x1003, 1) == int.from_bytes(message[:2] + message[3:5], "little")
    target.send(RPDO_ID, bytes(8))
    assert target.expect(0x80 + target.node_id)[:3] == bytes(3), "over with the next whole one"


def test_synchronization_01_default_identifier(target: Target) -> None:
    assert target.read(0x1005, 0) == 0x80


def test_synchronization_05_reserved_counter_overflow_is_refused(target: Target) -> None:
    """CiA 301, 7.5.2.22: 1 and 241 to 255 are reserved."""
    for value in (1, 241, 255):
        assert target.write(0x1019, 0, value, 1) in (0x06090030, 0x06090031, GENERAL)
    assert target.read(0x1019, 0) == 0


def test_synchronization_without_a_producer(target: Target) -> None:
    """This node produces no SYNC, and says so: no 0x1006, and the producer bit is refused."""
    assert target.abort_code(0x40, 0x06, 0x10, 0, 0, 0, 0, 0) == 0x06020000
    assert target.write(0x1005, 0, 0x40000080, 4) == 0x06090030


@pytest.mark.parametrize("identifier", RESTRICTED_IDS)
def test_restricted_identifiers_are_refused_everywhere(target: Target, identifier: int) -> None:
    for index, sub, bits in ((0x1005, 0, 0), (0x1014, 0, 0), (0x1410, 1, 0), (0x1808, 1, 0x40000000)):
        assert target.write(index, sub, identifier | bits, 4) == 0x06090030, f"{index:04X}"


def test_emcy_history_is_cleared_by_zero_only(target: Target) -> None:
    assert target.write(0x1003, 0, 1, 1) in (0x06090030, 0x06090031)
    assert target.write(0x1003, 0, 0, 1) == 0
    assert target.read(0x1003, 0) == 0


def test_heartbeat_01_02_03_producer(target: Target) -> None:
    assert target.write(0x1017, 0, 100, 2) == 0
    for _ in range(3):
        assert target.expect(0x700 + target.node_id) == bytes([127])
    assert target.write(0x1017, 0, 0, 2) == 0
    target.quiet()
    assert target.next_frame(0x700 + target.node_id, timeout_s=0.3) is None


def test_heartbeat_05_received_heartbeats_cause_no_error(target: Target) -> None:
    for slot in (1, 8):
        # One minute, so that no pause of this machine counts as a missing heartbeat.
        assert target.write(0x1016, slot, 0x00010000 * slot | 60_000, 4) == 0
        target.nmt(NMT_START)
        for _ in range(5):
            target.send(0x700 + slot, [0x7F])
        assert target.read(0x1001, 0) == 0
        assert target.write(0x1016, slot, 0, 4) == 0


def first_emergency(target: Target, within_s: float) -> int | None:
    """Wait for an emergency message, for `within_s` times the target's patience; its code, None if none comes.

    0xFF12 is ignored: an earlier test sent a temperature, and the device reports that no further one came.
    """
    give_up = time.monotonic() + within_s * target.patience
    while (rest := give_up - time.monotonic()) > 0:
        message = target.next_frame(0x80 + target.node_id, timeout_s=rest / target.patience)
        code = int.from_bytes(message[:2], "little") if message is not None else None
        if code not in (None, 0xFF12):
            return code
    return None


def test_heartbeat_06_supervision_starts_with_the_first_heartbeat(target: Target) -> None:
    time_s = 0.1 * target.patience
    assert target.write(0x1016, 1, 0x000A0000 | int(1000 * time_s), 4) == 0
    assert first_emergency(target, within_s=3.0 * time_s) is None
    target.send(0x70A, [0x7F])
    assert first_emergency(target, within_s=3.0 * time_s) == 0x8130


def test_heartbeat_07_loss_leaves_operational_return_is_reported(target: Target) -> None:
    time_ms = int(100 * target.patience)
    assert target.write(0x1016, 1, 0x000A0000 | time_ms, 4) == 0
    target.nmt(NMT_START)
    assert target.write(0x1017, 0, 50, 2) == 0
    target.expect_state(5)
    target.send(0x70A, [5])
    message = target.expect(0x80 + target.node_id)
    assert int.from_bytes(message[:2], "little") == 0x8130
    assert message[3] == 0x0A, "whose heartbeat it was"
    target.expect_state(127)
    target.send(0x70A, [5])
    assert target.expect(0x80 + target.node_id)[:2] == b"\0\0"


def test_heartbeat_04_second_consumer_entry_of_a_node_is_refused(target: Target) -> None:
    assert target.write(0x1016, 1, 0x000A0064, 4) == 0
    assert target.write(0x1016, 2, 0x000A00C8, 4) == 0x06040043


def test_state_01_pre_operational_has_sdo_and_no_pdo(target: Target) -> None:
    assert target.write(0x1808, 2, 1, 1) == 0
    assert target.write(0x1808, 1, 0x400001F8, 4) == 0
    target.send(0x80)
    assert target.next_frame(0x1F8, timeout_s=0.2) is None
    assert target.read(0x1000, 0)


def test_state_02_operational_has_sdo_and_pdo(target: Target) -> None:
    assert target.write(0x1808, 2, 1, 1) == 0
    assert target.write(0x1808, 1, 0x400001F8, 4) == 0
    target.nmt(NMT_START)
    target.quiet()
    target.send(0x80)
    assert len(target.expect(0x1F8)) == 6
    assert target.read(0x1000, 0)


def test_state_03_and_04_stopped_node_obeys_only_nmt(target: Target) -> None:
    assert target.write(0x1017, 0, 100, 2) == 0
    assert target.write(0x1808, 2, 1, 1) == 0
    assert target.write(0x1808, 1, 0x400001F8, 4) == 0
    target.nmt(NMT_STOP)
    target.expect_state(4)
    target.send(0x600 + target.node_id, [0x40, 0, 0x10, 0, 0, 0, 0, 0])
    target.send(0x80)
    seen = [target.upstream.recv(ARRIVES_WITHIN_S) for _ in range(4)]
    assert {frame.arbitration_id for frame in seen if frame} == {0x700 + target.node_id}
    target.nmt(NMT_PREOPERATIONAL)
    assert target.read(0x1000, 0)


_STATES = {NMT_START: 5, NMT_STOP: 4, NMT_PREOPERATIONAL: 127}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_transitions_01_to_04_every_command_from_every_state(target: Target, seed: int) -> None:
    assert target.write(0x1017, 0, 50, 2) == 0
    order = random.Random(seed)
    for _ in range(12):
        command = order.choice(list(_STATES))
        target.nmt(command)
        target.expect_state(_STATES[command])


@pytest.mark.parametrize("command", [NMT_RESET_NODE, NMT_RESET_COMMUNICATION])
@pytest.mark.parametrize("before", list(_STATES))
def test_resets_boot_from_every_state_into_the_defaults(target: Target, before: int, command: int) -> None:
    assert target.write(0x1017, 0, 1000, 2) == 0
    assert target.write(0x1410, 1, 0x1F1, 4) == 0
    target.nmt(before)
    target.reset(command)
    assert target.read(0x1017, 0) == 0
    assert target.read(0x1410, 1) == 0x80000000


def test_od_stored_parameters_are_loaded_at_every_start(target: Target) -> None:
    """CiA 301, 7.5.2.13 and 14: only the word "save" stores, only "load" restores."""
    assert target.write(0x1010, 1, 0x65766174, 4) == 0x08000020
    assert target.write(0x1011, 1, 0x65766173, 4) == 0x08000020
    assert target.write(0x1014, 0, 0x80000000 | (0x80 + target.node_id), 4) == 0
    assert target.write(0x1014, 0, 0xA1, 4) == 0
    assert target.write(0x1410, 1, 0x1F1, 4) == 0
    try:
        assert target.write(0x1010, 1, 0x65766173, 4) == 0
        target.reset(NMT_RESET_NODE)
        assert (target.read(0x1014, 0), target.read(0x1410, 1)) == (0xA1, 0x1F1)
        assert target.write(0x1014, 0, 0x80000000 | 0xA1, 4) == 0
        target.reset(NMT_RESET_COMMUNICATION)
        assert target.read(0x1014, 0) == 0xA1
    finally:
        assert target.write(0x1011, 1, 0x64616F6C, 4) == 0
        target.reset(NMT_RESET_NODE)
    assert (target.read(0x1014, 0), target.read(0x1410, 1)) == (0x80 + target.node_id, 0x80000000)


def test_nmt_for_another_node_is_ignored_broadcast_is_obeyed(target: Target) -> None:
    target.send(0, [NMT_STOP, target.node_id + 1])
    assert target.read(0x1000, 0)
    target.send(0, [NMT_STOP, 0])
    target.send(0x600 + target.node_id, [0x40, 0, 0x10, 0, 0, 0, 0, 0])
    assert target.next_frame(0x580 + target.node_id, timeout_s=0.2) is None
    target.send(0, [NMT_PREOPERATIONAL, 0])
    assert target.read(0x1000, 0)
