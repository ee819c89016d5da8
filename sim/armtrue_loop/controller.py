"""A robot controller made of parts nobody here wrote: PyPI canopen and its CiA 402 profile.

It configures the compensator, brings six drives to "operation enabled" in cyclic synchronous position
and moves the arm along synchronised trajectories, one SYNC and three target frames a cycle. In offset mode
it takes the offsets that it hears off the drives' actual positions; in inline mode the compensator has.

Nothing here depends on how fast the machine is. A cycle ends when everybody has answered; what became of a
set of targets is asked of the compensator itself, by SDO, behind the targets on the same bus; a move during
which the compensator missed anything is made again.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from canopen.profiles.p402 import BaseNode402

from armtrue_loop.drive import EDS as DRIVE_EDS
from armtrue_loop.network import open_network
from armtrue_loop.wiring import (
    ACTUAL_AT,
    COMPENSATOR_ID,
    CONTROLLER_BUS,
    DRIVE_IDS,
    FEEDBACK_IDS,
    INCREMENTS_PER_RADIAN,
    JOINTS,
    OFFSET_IDS,
    TARGET_IDS,
    TEMPERATURE_ID,
)

Array = np.ndarray[Any, np.dtype[np.float64]]
Increments = np.ndarray[Any, np.dtype[np.int64]]
COMPENSATOR_EDS = Path(__file__).resolve().parents[2] / "firmware" / "canopen" / "od" / "armtrue.eds"
MODES = {"forward": 0, "inline": 1, "offset": 2}

# Nobody on the bus needs this long, however loaded the machine is: who is silent for longer is not there.
ANSWER_TIMEOUT_S = 30.0
# The longest that the compensator can be set to wait (0x2000 sub 3 and 4): a machine that halts for longer than
# this in the middle of a cycle interrupts the stream of targets.
_LONGEST_WAIT_US = 1_000_000
# Sets that the compensator may withhold before the first of a stream goes out; two by its design (a stream begins
# with its second set, and the interval before may have been spoilt), and in offset mode after a start those of the
# 0.1 s that it wants the arm to stand.
_STREAM_BEGINS_WITHIN = 200
_MOVE_ATTEMPTS = 5
_SETTLES_WITHIN = 1000
_BLENDING = 1
_RATE_LIMITED_BIT = 1 << 1
_QUIET_BIT = 1 << 3
_REST_BETWEEN_SYNCS_S = 0.005
_EVERYONE = (1 << JOINTS) - 1
_EVERY_PAIR = (1 << len(OFFSET_IDS)) - 1
_PDO_OFF = 1 << 31
_NO_RTR = 1 << 30


class ControllerError(RuntimeError):
    """The arm did not do what it was told."""


def _patient_drive(node_id: int) -> BaseNode402:
    """A 402 drive whose answers may take as long as a loaded machine makes them."""
    drive = BaseNode402(node_id, str(DRIVE_EDS))
    drive.sdo.RESPONSE_TIMEOUT = ANSWER_TIMEOUT_S
    drive.TIMEOUT_RESET_FAULT = drive.TIMEOUT_SWITCH_OP_MODE = ANSWER_TIMEOUT_S
    drive.TIMEOUT_SWITCH_STATE_FINAL = drive.TIMEOUT_SWITCH_STATE_SINGLE = ANSWER_TIMEOUT_S
    drive.TIMEOUT_CHECK_TPDO = ANSWER_TIMEOUT_S
    return drive


class Controller:
    """One controller on the upstream bus."""

    def __init__(self, channel: str = CONTROLLER_BUS) -> None:
        self.network = open_network(channel)
        self.compensator = self.network.add_node(COMPENSATOR_ID, str(COMPENSATOR_EDS))
        self.compensator.sdo.RESPONSE_TIMEOUT = ANSWER_TIMEOUT_S
        self.drives = [_patient_drive(node_id) for node_id in DRIVE_IDS]
        self.temperatures_centi: tuple[int, ...] = ()
        self.emergencies: list[tuple[int, int]] = []
        self.cycles = 0
        self.repeated_moves = 0  # because the machine halted for longer than the compensator waits
        self.worst_following = 0  # largest difference of actual from commanded position, increments
        self._commanded = np.zeros(JOINTS, dtype=np.int64)
        self._actual = [0] * JOINTS
        self._following = 0
        self._arrived = 0
        self._offsets_arrived = 0
        self._expects_offsets = False
        self._changed = threading.Condition()
        for drive in self.drives:
            self.network.add_node(drive)
        self._offset = [0] * JOINTS  # what the drives add in offset mode, as heard on the bus
        for joint, identifier in enumerate(FEEDBACK_IDS):
            self.network.subscribe(identifier, self._feedback_handler(joint))
        for pair, identifier in enumerate(OFFSET_IDS):
            self.network.subscribe(identifier, self._offset_handler(pair))
        self.network.subscribe(TEMPERATURE_ID, self._on_temperature)
        self.compensator.emcy.add_callback(
            lambda error: self.emergencies.append((error.code, error.register))
        )

    def _feedback_handler(self, joint: int) -> Any:
        def handle(_cob_id: int, data: bytearray, _timestamp: float) -> None:
            with self._changed:
                self._actual[joint] = struct.unpack_from("<i", data, ACTUAL_AT)[0] - self._offset[joint]
                self._arrived |= 1 << joint
                if self._arrived == _EVERYONE:
                    self._changed.notify()

        return handle

    def _offset_handler(self, pair: int) -> Any:
        def handle(_cob_id: int, data: bytearray, _timestamp: float) -> None:
            with self._changed:
                self._offset[2 * pair : 2 * pair + 2] = struct.unpack_from("<2i", data)
                self._offsets_arrived |= 1 << pair
                if self._offsets_arrived == _EVERY_PAIR:
                    self._changed.notify()

        return handle

    def _on_temperature(self, _cob_id: int, data: bytearray, _timestamp: float) -> None:
        self.temperatures_centi = struct.unpack_from("<4h", data)

    def configure_compensator(self, mode: str) -> None:
        """Map targets, feedback, offsets and temperatures, and choose the mode; the node is pre-operational."""
        sdo = self.compensator.sdo
        self.compensator.nmt.state = "PRE-OPERATIONAL"
        for pair, identifier in enumerate(TARGET_IDS):
            sdo[0x1400 + pair][1].raw = identifier
            if mode == "offset":
                sdo[0x1800 + pair][1].raw = OFFSET_IDS[pair] | _NO_RTR
        for joint, identifier in enumerate(FEEDBACK_IDS):
            self._map(0x1408 + joint, 0x1608 + joint, identifier, [
                (0x6041 + 0x800 * joint) << 16 | 16,
                (0x6064 + 0x800 * joint) << 16 | 32,
                (0x6061 + 0x800 * joint) << 16 | 8,
            ])  # fmt: skip
        sdo[0x1410][1].raw = TEMPERATURE_ID
        # Here a cycle takes as long as it takes.
        sdo[0x2000][3].raw = _LONGEST_WAIT_US
        sdo[0x2000][4].raw = _LONGEST_WAIT_US
        sdo[0x2000][1].raw = MODES[mode]
        self._expects_offsets = mode == "offset"

    def _map(self, communication: int, mapping: int, identifier: int, entries: list[int]) -> None:
        sdo = self.compensator.sdo
        sdo[communication][1].raw = identifier | _PDO_OFF
        sdo[mapping][0].raw = 0
        for number, entry in enumerate(entries, 1):
            sdo[mapping][number].raw = entry
        sdo[mapping][0].raw = len(entries)
        sdo[communication][1].raw = identifier

    def enable(self) -> None:
        """Bring all drives to operation enabled through the 402 state machine, standing where they are."""
        for drive in self.drives:
            drive.nmt.state = "PRE-OPERATIONAL"
            drive.setup_402_state_machine()
        self.network.nmt.state = "OPERATIONAL"
        for _ in range(2):
            # The profile goes by the last statusword that it heard, and a drive may have lost power since.
            self._sync()
        with self._synchronised():
            for drive in self.drives:
                drive.op_mode = "CYCLIC SYNCHRONOUS POSITION"
                drive.state = "OPERATION ENABLED"
        self._sync()
        self._commanded = np.array(self._actual, dtype=np.int64)

    def disable(self) -> None:
        """Power off the drives."""
        with self._synchronised():
            for drive in self.drives:
                drive.state = "SWITCH ON DISABLED"

    @contextlib.contextmanager
    def _synchronised(self) -> Iterator[None]:
        """SYNC goes out again and again, each once the feedback of the one before is here: no backlog can grow."""
        leaving = threading.Event()

        def pump() -> None:
            while not leaving.wait(_REST_BETWEEN_SYNCS_S):
                self._sync()

        pumping = threading.Thread(target=pump)
        pumping.start()
        try:
            yield
        finally:
            leaving.set()
            pumping.join()

    @property
    def joints(self) -> Array:
        """Commanded joints, rad."""
        return np.asarray(self._commanded, dtype=float) / INCREMENTS_PER_RADIAN

    def move(self, joints_rad: Array, cycles: int, settle: int) -> None:
        """Move to joint angles along a straight line in joint space with smooth ends, then stand for `settle` cycles.

        Stands on until the compensator's correction has settled: a table that was just activated is blended over,
        and the rate of correction is limited. A move that the compensator could not follow (the machine halted) is
        taken back and made again, so that every joint arrives from the side it was told to.

        Raises ControllerError if a drive stops answering or does not stand where it was told.
        """
        begin = self._commanded.copy()
        end = np.rint(np.asarray(joints_rad) * INCREMENTS_PER_RADIAN).astype(np.int64)
        for _ in range(_MOVE_ATTEMPTS):
            if self._travel(begin, end, cycles, settle):
                return
            self.repeated_moves += 1
            self._travel(end, begin, cycles, 0)
        raise ControllerError(f"the compensator lost targets in {_MOVE_ATTEMPTS} moves one after the other")

    def _travel(self, begin: Increments, end: Increments, cycles: int, settle: int) -> bool:
        """One attempt at a move; whether the compensator had every set of targets in time."""
        self._begin_stream()
        lost = self._lost()
        self._following = 0
        for k in range(1, cycles + 1):
            share = k / cycles
            smooth = share * share * (3.0 - 2.0 * share)
            if not self.cycle(np.rint(begin + smooth * (end - begin)).astype(np.int64)):
                return False
        stood = 0
        while stood < settle or not self._has_settled():
            if stood > settle + _SETTLES_WITHIN:
                raise ControllerError(f"the correction still changes after {stood} cycles at a standstill")
            if not self.cycle(end):
                return False
            stood += 1
        self._sync()
        if self._lost() != lost:
            return False
        self.worst_following = max(self.worst_following, self._following)
        off = int(np.abs(np.array(self._actual) - end).max())
        if off:
            raise ControllerError(f"a drive says it stands {off} increments from where it was told")
        return True

    def _begin_stream(self) -> None:
        """Stand until a set of targets has gone out: of a stream that begins, the compensator withholds the first."""
        for _ in range(_STREAM_BEGINS_WITHIN):
            before = self._sets()
            self._sync()
            self._send_targets(self._commanded)
            if self._sets() != before:
                return
        raise ControllerError(f"the compensator withheld {_STREAM_BEGINS_WITHIN} whole sets of targets")

    def _has_settled(self) -> bool:
        """Whether the correction is the whole one: not on its way from another table, nor limited in its rate."""
        status = self.compensator.sdo["Compensator status"]
        blends = status["State"].raw == _BLENDING
        return not blends and not status["Correction clamp bits"].raw & _RATE_LIMITED_BIT

    def _sets(self) -> int:
        """How many sets have gone out; answered behind everything that was sent before."""
        return int(self.compensator.sdo["Compensator status"]["Cycles"].raw)

    def _lost(self) -> tuple[int, int]:
        """Counters of what the compensator missed so far: withheld sets, interrupted streams."""
        status = self.compensator.sdo["Compensator status"]
        return int(status["Sets withheld"].raw), int(status["Stale"].raw)

    def cycle(self, targets: Increments) -> bool:
        """One control cycle: SYNC, feedback of the targets before, new targets.

        Returns False if the compensator withheld the set, in offset mode, where the controller sees that.
        """
        self._sync()
        self._following = max(self._following, int(np.abs(np.array(self._actual) - self._commanded).max()))
        with self._changed:
            self._offsets_arrived = 0
        self._send_targets(targets)
        self._commanded = targets
        if self._expects_offsets and not self._offsets_have_come():
            return False
        self.cycles += 1
        return True

    def _send_targets(self, targets: Increments) -> None:
        for pair, identifier in enumerate(TARGET_IDS):
            self.network.send_message(identifier, struct.pack("<2i", *targets[2 * pair : 2 * pair + 2]))

    def _offsets_have_come(self) -> bool:
        """Wait for the offsets of the targets just sent: the drives must have them before the next SYNC.

        A real cycle leaves them a millisecond. None come for a set that was withheld.
        """
        with self._changed:
            if self._changed.wait_for(lambda: self._offsets_arrived == _EVERY_PAIR, 1.0):
                return True
        self._sets()  # behind its answer nothing of this set is still to come
        return self._offsets_arrived == _EVERY_PAIR

    def _sync(self) -> None:
        """SYNC, and wait for all drives' feedback."""
        with self._changed:
            self._arrived = 0
        self.network.sync.transmit()
        with self._changed:
            if not self._changed.wait_for(lambda: self._arrived == _EVERYONE, ANSWER_TIMEOUT_S):
                silent = [drive for joint, drive in enumerate(DRIVE_IDS) if not self._arrived & 1 << joint]
                raise ControllerError(f"no feedback of drives {silent} within {ANSWER_TIMEOUT_S:g} s")

    def catch_up(self) -> None:
        """Take everything off the bus that was sent before now.

        Once another SDO client has talked with the compensator its last answers are not mistaken for ours: every drive
        answers behind them.
        """
        for drive in self.drives:
            drive.sdo[0x6041].raw  # noqa: B018

    def wait_until_quiet(self) -> None:
        """Wait until the compensator takes tables: no joint command has come for the time that it wants."""
        give_up = time.monotonic() + ANSWER_TIMEOUT_S
        while not self.compensator.sdo["Compensator status"]["Status bits"].raw & _QUIET_BIT:
            if time.monotonic() > give_up:
                raise ControllerError(f"the compensator still hears targets after {ANSWER_TIMEOUT_S:g} s")
            time.sleep(0.05)

    def set_payload(self, kilogram: float) -> None:
        """Tell the compensator what is mounted."""
        self.compensator.sdo["Payload mass (g)"].raw = round(1000 * kilogram)

    def close(self) -> None:
        """Leave the bus."""
        self.network.disconnect()
