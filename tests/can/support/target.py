"""The device under test, whatever it is: a target file says how it is started and reached."""

from __future__ import annotations

import contextlib
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import can
from armtrue.device import Compensator, SdoAbortError, SdoClient
from node_process import NodeProcess

from tests import qemu

FOLDER = Path(__file__).with_name("targets")
NMT_START, NMT_STOP, NMT_PREOPERATIONAL, NMT_RESET_NODE, NMT_RESET_COMMUNICATION = 1, 2, 128, 129, 130
TARGET_IDS = (0x220, 0x320, 0x420)
FEEDBACK_IDS = (0x1C0, 0x1C1, 0x1C2)
# How long an expected frame is awaited. Only a failing test waits this long, however loaded the machine is.
ARRIVES_WITHIN_S = 30.0


# Shorter than the set window and the stale time-out that `configure` writes: after such a pause of this machine, or of
# the emulator on it, the device may rightly count the stream as interrupted.
HALT_S = 0.3
# Number of sets that may then be withheld: the interrupted one, and the next, which follows no complete set.
SETS_LOST_BY_A_HALT = 2
# Drives that are silent for a second on the device's clock count as disabled: a table can be committed then.
DRIVES_SILENT_MS = 1100


class Target:
    """One running device between two lines. Frames are sent and awaited raw; SDO goes through our own client."""

    def __init__(self, description: dict[str, Any], upstream: can.BusABC, downstream: can.BusABC) -> None:
        self.description = description
        self.node_id: int = description["node_id"]
        self.patience: float = description["patience"]
        self.has_fd: bool = description["fd"]
        self.upstream, self.downstream = upstream, downstream
        self.drives_spoke = False  # since the last wait for their silence
        self.at_work_s = time.monotonic()
        self.halts = 0
        self.sets_excused = 0
        # The drives are on the drives' side, or, in offset mode, beside the controller.
        self._note_drives(downstream, lambda _identifier: True)
        self._note_drives(upstream, FEEDBACK_IDS.__contains__)
        self.board: qemu.RealTimeBoard | None = None  # of kind "r5f"
        self.client = SdoClient(upstream, self.node_id, ARRIVES_WITHIN_S)
        self.device = Compensator(self.client)

    def _note_drives(self, line: can.BusABC, is_of_drives: Callable[[int], bool]) -> None:
        send = line.send

        def noted_send(message: can.Message, timeout: float | None = None) -> None:
            send(message, timeout)
            self.drives_spoke = self.drives_spoke or is_of_drives(message.arbitration_id)

        line.send = noted_send  # type: ignore[method-assign]

    def note_time(self) -> None:
        """Called at each send and receive: more than HALT_S between two calls is a halt of this machine."""
        now_s = time.monotonic()
        if now_s - self.at_work_s > HALT_S:
            self.halts += 1
            self.sets_excused = SETS_LOST_BY_A_HALT
        self.at_work_s = now_s

    def send(self, identifier: int, data: Sequence[int] | bytes = b"", *, extended: bool = False) -> None:
        """A frame from the controller's side."""
        self.note_time()
        self.upstream.send(
            can.Message(arbitration_id=identifier, data=bytes(data), is_extended_id=extended),
            timeout=self.patience,
        )

    def send_remote(self, identifier: int) -> None:
        """A remote request from the controller's side."""
        request = can.Message(arbitration_id=identifier, is_remote_frame=True, dlc=8, is_extended_id=False)
        self.upstream.send(request, timeout=self.patience)

    def send_from_drives(self, identifier: int, data: Sequence[int] | bytes) -> None:
        """A frame from the drives' side."""
        self.downstream.send(
            can.Message(arbitration_id=identifier, data=bytes(data), is_extended_id=False),
            timeout=self.patience,
        )

    def expect(self, identifier: int, bus: can.BusABC | None = None) -> bytes:
        """The data of the next frame with this identifier; fails where none comes."""
        got = self.next_frame(identifier, bus, ARRIVES_WITHIN_S / self.patience)
        assert got is not None, f"no frame 0x{identifier:X} within {ARRIVES_WITHIN_S:g} s"
        return got

    def next_frame(
        self, identifier: int, bus: can.BusABC | None = None, timeout_s: float = 1.0
    ) -> bytes | None:
        """As `expect`, but None if no frame comes within `timeout_s` times the device's patience."""
        bus = bus or self.upstream
        give_up = time.monotonic() + timeout_s * self.patience
        while (rest := give_up - time.monotonic()) > 0:
            frame = bus.recv(rest)
            if frame is not None and frame.arbitration_id == identifier:
                return bytes(frame.data)
        return None

    def passed_on(self, bus: can.BusABC) -> can.Message | None:
        """The next frame except the device's emergency messages (commands stop when this machine halts)."""
        while (frame := bus.recv(ARRIVES_WITHIN_S)) is not None:
            if frame.arbitration_id != 0x80 + self.node_id or frame.is_extended_id:
                return frame
        return None

    def quiet(self, bus: can.BusABC | None = None, timeout_s: float = 0.05) -> list[can.Message]:
        """All frames until none has come for `timeout_s` times the patience, or 20 times that is over (heartbeats)."""
        bus = bus or self.upstream
        frames = []
        give_up = time.monotonic() + 20 * timeout_s * self.patience
        while (frame := bus.recv(timeout_s * self.patience)) is not None:
            frames.append(frame)
            if time.monotonic() > give_up and timeout_s > 0:
                break
        return frames

    def until_answered(self) -> list[can.Message]:
        """All frames in transit on the controller's line: those that come before the answer to an SDO request."""
        frames = []
        self.send(0x600 + self.node_id, [0x40, 0x00, 0x10, 0, 0, 0, 0, 0])
        while (frame := self.upstream.recv(ARRIVES_WITHIN_S)) is not None:
            if frame.arbitration_id == 0x580 + self.node_id:
                return frames
            frames.append(frame)
        raise AssertionError(f"no answer within {ARRIVES_WITHIN_S:g} s")

    def expect_state(self, state: int) -> None:
        """Wait until heartbeats report this NMT state; fails if they do not."""
        give_up = time.monotonic() + ARRIVES_WITHIN_S
        last = None
        while time.monotonic() < give_up:
            last = self.expect(0x700 + self.node_id)
            if last == bytes([state]):
                return
        raise AssertionError(f"heartbeat says {last!r}, expected state {state}")

    def ask(self, *request: int) -> bytes:
        """A raw SDO request and the answer's eight bytes."""
        self.quiet(timeout_s=0.0)
        self.send(0x600 + self.node_id, bytes(request))
        return self.expect(0x580 + self.node_id)

    def abort_code(self, *request: int) -> int:
        """The abort code of a raw SDO request that is expected to be refused."""
        answer = self.ask(*request)
        assert answer[0] == 0x80, f"not refused: {answer.hex(' ')}"
        return int.from_bytes(answer[4:], "little")

    def nmt(self, command: int) -> None:
        """An NMT command to this node."""
        self.send(0, [command, self.node_id])

    def reset(self, command: int = NMT_RESET_NODE) -> None:
        """Reset and wait for the boot-up message.

        Unread frames of both lines are discarded first: a socket that holds 277 frames drops all later ones.
        """
        self.quiet(timeout_s=0.0)
        self.quiet(self.downstream, timeout_s=0.0)
        self.nmt(command)
        while self.expect(0x700 + self.node_id) != b"\0":
            pass  # a heartbeat that was under way

    def write(self, index: int, sub: int, value: int, size: int) -> int:
        """Expedited download; the abort code, 0 if it was taken."""
        try:
            self.client.download(index, sub, value.to_bytes(size, "little"), 5.0 * self.patience)
        except SdoAbortError as refusal:
            return refusal.code
        return 0

    def read(self, index: int, sub: int) -> int:
        """Expedited upload."""
        return int.from_bytes(self.client.upload(index, sub), "little")

    def wait_until_quiet(self) -> None:
        """Wait until the device accepts table commands again; sets its quiet time to the shortest that it allows."""
        assert self.write(0x2000, 5, 100, 4) == 0
        give_up = time.monotonic() + ARRIVES_WITHIN_S
        while not self.device.is_quiet():
            assert time.monotonic() < give_up, "joint commands seem to arrive for ever"
            time.sleep(0.02)
        if self.drives_spoke:
            self.pass_time(DRIVES_SILENT_MS)
            self.drives_spoke = False

    def pass_time(self, milliseconds: int) -> None:
        """Wait until that much time has passed on the device's own clock (0x2001 sub 13).

        An emulated chip counts the interrupts of its timer and loses some on a busy machine: its seconds are longer.
        """
        begin = self.read(0x2001, 13)
        give_up = time.monotonic() + ARRIVES_WITHIN_S
        while (passed := self.read(0x2001, 13) - begin) < milliseconds:
            assert time.monotonic() < give_up, f"{passed} ms on the device's clock, expected {milliseconds}"
            time.sleep(0.02)

    def configure(self, mode: int) -> None:
        """Target pairs on 0x220 …, actual positions on 0x1C0 …, mode 1 (inline) or 0, and operational."""
        self.nmt(NMT_PREOPERATIONAL)
        for pair in range(3):
            assert self.write(0x1400 + pair, 1, TARGET_IDS[pair], 4) == 0
            assert self.write(0x1408 + pair, 1, FEEDBACK_IDS[pair], 4) == 0
        assert self.write(0x2000, 3, 1_000_000, 4) == 0
        assert self.write(0x2000, 4, 500_000, 4) == 0
        assert self.write(0x2000, 1, mode, 1) == 0
        self.nmt(NMT_START)
        self.quiet()
        self.quiet(self.downstream)


def describe(file: str) -> dict[str, Any]:
    """A target file's content."""
    return tomllib.loads((FOLDER / file).read_text(encoding="utf-8"))


@contextlib.contextmanager
def start_target(file: str, state: Path) -> Iterator[Target]:
    """Start the device of a target file, reach both of its lines, end it with the block."""
    description = describe(file)
    with contextlib.ExitStack() as stack:
        lines = [dict(description[line]) for line in ("upstream", "downstream")]
        if description["kind"] == "stm32f405":
            image = qemu.build_images("stm32f405", "armtrue_stm32f405") / "armtrue_stm32f405.elf"
            board = stack.enter_context(qemu.board(image))
            for number, line in enumerate(lines):
                line["channel"] = board.slcan_url(number)
        buses = [can.Bus(**line) for line in lines]
        for bus in buses:
            stack.callback(bus.shutdown)
        real_time_board = None
        if description["kind"] == "posix":
            stack.enter_context(NodeProcess(state, upstream="vcan0", downstream="vcan1"))
        elif description["kind"] == "r5f":
            image = qemu.build_images("r5f", "armtrue_r5f") / "armtrue_r5f.elf"
            real_time_board = stack.enter_context(qemu.real_time_board(image, ["vcan0", "vcan1"]))
            real_time_board.wait_for_text("ready")
        target = Target(description, *buses)
        target.board = real_time_board
        target.quiet()
        yield target
