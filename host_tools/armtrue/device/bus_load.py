"""Time that frames occupy a bus (ISO 11898-1); stuff bits of classic frames are counted, not estimated."""

from __future__ import annotations

import can

# After the CRC sequence: delimiter, acknowledge slot and delimiter, end of frame, interframe space.
_TAIL_BITS = 1 + 2 + 7 + 3
_CRC15 = 0x4599


def classic_frame_bits(identifier: int, data: bytes, extended: bool = False, remote: bool = False) -> int:
    """Bit times of one classic frame on the bus, interframe space included.

    Args:
      identifier: 11 or 29 bits.
      data: the payload; of a remote frame only its length is used (DLC).
    """
    arbitration = (
        f"{identifier >> 18:011b}11{identifier & 0x3FFFF:018b}" if extended else f"{identifier:011b}"
    )
    payload = "" if remote else "".join(f"{byte:08b}" for byte in data)
    bits = [int(bit) for bit in f"0{arbitration}{remote:b}00{len(data):04b}{payload}"]
    crc = 0
    for bit in bits:
        crc = (crc << 1) & 0x7FFF ^ (_CRC15 if bit ^ crc >> 14 else 0)
    stuffed = 0
    run, last = 0, -1
    for bit in [*bits, *(crc >> shift & 1 for shift in range(14, -1, -1))]:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            # The stuff bit is of the other value and begins the next run.
            stuffed += 1
            run, last = 1, 1 - bit
    return len(bits) + 15 + stuffed + _TAIL_BITS


def frame_seconds(message: can.Message, bitrate: int, data_bitrate: int) -> float:
    """Time on the bus. FD frames: arbitration at `bitrate`, payload and CRC at `data_bitrate`.

    FD frames are counted with 30 arbitration-phase bits and 28 + 8 n data-phase bits with stuffing at a
    fifth (ISO 11898-1:2015, 10.4.2): within 10 % of the truth.
    """
    if not message.is_fd:
        bits = classic_frame_bits(
            message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame
        )
        return bits / bitrate
    fast = data_bitrate if message.bitrate_switch else bitrate
    return 30 / bitrate + 1.2 * (28 + 8 * len(message.data)) / fast
