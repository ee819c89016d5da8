"""A CiA 402 servo drive as a CANopen node: power state machine and cyclic synchronous position.

The drive is ideal: it stands where its last synchronous target (plus position offset 0x60B0) is. Nothing but a loss
of power or another value takes the offset from it: CiA 402 asks for no more.
"""

from __future__ import annotations

import struct
from pathlib import Path

import canopen

from armtrue_loop.wiring import OFFSET_IDS, SYNC_ID, TARGET_IDS

EDS = Path(__file__).with_name("drive.eds")
CYCLIC_SYNCHRONOUS_POSITION = 8

# Statusword bits 0–3, 5, 6 by state (CiA 402-2, table 30).
STATUS = {
    "switch on disabled": 0x0240,
    "ready to switch on": 0x0221,
    "switched on": 0x0223,
    "operation enabled": 0x0227,
    "quick stop active": 0x0207,
    "fault": 0x0208,
}
_TARGET_REACHED = 0x0400
_FOLLOWS_COMMAND = 0x1000


def next_state(state: str, controlword: int, fault_reset_edge: bool) -> str:
    """The power state after a controlword (CiA 402-2, 6.2)."""
    if state == "fault":
        return "switch on disabled" if fault_reset_edge else state
    command = controlword & 0x0F
    if not command & 0x02:
        return "switch on disabled"
    if not command & 0x04:
        return "quick stop active" if state == "operation enabled" else "switch on disabled"
    if command & 0x07 == 0x06:
        return "ready to switch on"
    if state == "switch on disabled":
        return state  # from here only shutdown leads on
    if command == 0x07:
        return "switched on"
    if state in ("switched on", "operation enabled", "quick stop active", "ready to switch on"):
        return "operation enabled" if state != "ready to switch on" else "switched on"
    return state


class Drive:
    """One drive on a network. `position` is where its motor stands, in increments."""

    def __init__(self, network: canopen.Network, node_id: int, position: int = 0) -> None:
        self.node = canopen.LocalNode(node_id, str(EDS))
        network.add_node(self.node)
        self._network = network
        self._number = node_id - 1
        self._state = "switch on disabled"
        self._target: int | None = None
        self._offset = 0
        self._last_controlword = 0
        self._mode = 0
        self.position = position
        pair, self._place = divmod(self._number, 2)
        network.subscribe(0x200 + node_id, self._on_control)
        network.subscribe(TARGET_IDS[pair], self._on_target)
        network.subscribe(OFFSET_IDS[pair], self._on_offset)
        network.subscribe(SYNC_ID, self._on_sync)
        self.node.add_write_callback(self._on_sdo_write)
        self._publish()

    def boot(self) -> None:
        """Come out of a loss of power: without torque, boot-up message sent, pre-operational. The brake held it."""
        self._state = "switch on disabled"
        self._mode = 0
        self._offset = 0
        self._last_controlword = 0
        self._publish()
        self.node.nmt.send_command(0x80)

    @property
    def is_enabled(self) -> bool:
        """Whether the drive follows targets."""
        return self._state == "operation enabled" and self._mode == CYCLIC_SYNCHRONOUS_POSITION

    def _operational(self) -> bool:
        return bool(self.node.nmt.state == "OPERATIONAL")

    def _on_control(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if self._operational() and len(data) >= 3:
            self._mode = data[2]
            self._obey(int.from_bytes(data[:2], "little"))

    def _on_sdo_write(self, *, index: int, subindex: int, od: object, data: bytes) -> None:
        if index == 0x6040:
            self._obey(int.from_bytes(data, "little"))
        elif index == 0x6060:
            self._mode = data[0]
            self._publish()
        elif index == 0x607A:
            self._target = int.from_bytes(data, "little", signed=True)
        elif index == 0x60B0:
            self._offset = int.from_bytes(data, "little", signed=True)

    def _obey(self, controlword: int) -> None:
        edge = bool(controlword & 0x80) and not self._last_controlword & 0x80
        self._last_controlword = controlword
        state = next_state(self._state, controlword, edge)
        if state == "operation enabled" and self._state != state:
            self._target = None  # stand still until the first target
        self._state = state
        self._publish()

    def _on_target(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if self._operational() and len(data) == 8:
            self._target = struct.unpack_from("<i", data, 4 * self._place)[0]

    def _on_offset(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        if self._operational() and len(data) == 8:
            self._offset = struct.unpack_from("<i", data, 4 * self._place)[0]
            self._publish()

    def _on_sync(self, _cob_id: int, _data: bytearray, _timestamp: float) -> None:
        if not self._operational():
            return
        if self.is_enabled and self._target is not None:
            self.position = self._target + self._offset
        status = self._publish()
        self._network.send_message(
            0x180 + self.node.id, struct.pack("<HiB", status, self.position, self._mode)
        )

    def _publish(self) -> int:
        """Bring the objects that SDO reads up to date; the statusword."""
        status = STATUS[self._state] | _TARGET_REACHED
        if self.is_enabled:
            status |= _FOLLOWS_COMMAND
        values = {
            0x6041: (status, 2),
            0x6061: (self._mode, 1),
            0x6064: (self.position, 4),
            0x60B0: (self._offset, 4),
        }
        for index, (value, size) in values.items():
            self.node.data_store.setdefault(index, {})[0] = value.to_bytes(
                size, "little", signed=index in (0x6064, 0x60B0)
            )
        return status
