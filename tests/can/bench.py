"""Frames, bus time and instructions of the CAN side, for docs/results.md: `./dev bench can` prints and writes them.

python tests/can/bench.py transfer RESULT.json  inside the rig
python tests/can/bench.py report RESULT.json    outside; counts instructions too
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import can
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [
    str(ROOT),
    str(ROOT / "sim"),
    str(ROOT / "tests" / "can" / "support"),
    str(ROOT / "tests" / "firmware"),
]

from armtrue.device import Compensator, SdoClient, upload_image  # noqa: E402
from armtrue.device.bus_load import classic_frame_bits  # noqa: E402
from armtrue.device.image import read_image  # noqa: E402
from node_process import NODE_ID, NodeProcess  # noqa: E402
from small_table import small_table  # noqa: E402

BITRATE = 1_000_000
SEGMENT = 7
BLOCK_SEGMENTS = 127
_NODE_RESULT = np.dtype([("instructions", "<u4"), ("read", "<u4"), ("corrected", "<i4", 6)])
PADDING = {"small": 0, "16 KiB": 15_500}


class Counted:
    """A bus that records the SDO frames that a client sends and receives."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.frames: list[tuple[int, bytes]] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """As can.BusABC.send."""
        self._bus.send(msg, timeout)
        self._keep(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As can.BusABC.recv."""
        message = self._bus.recv(timeout)
        if message is not None:
            self._keep(message)
        return message

    def _keep(self, message: can.Message) -> None:
        if message.arbitration_id in (0x600 + NODE_ID, 0x580 + NODE_ID):
            self.frames.append((message.arbitration_id, bytes(message.data)))


def frames_of_image(frames: list[tuple[int, bytes]], block: bool) -> list[tuple[int, bytes]]:
    """The frames that move the image: from the request that opens the staging object to the answer that ends it."""
    opens = 0xC6 if block else 0x21
    begin = next(k for k, (_, data) in enumerate(frames) if data[0] == opens and data[1:4] == b"\x10\x20\x00")
    end = begin
    while True:
        identifier, data = frames[end]
        end += 1
        if identifier == 0x580 + NODE_ID:
            if block and data[0] == 0xA1:
                break
            last = frames[end - 2][1]
            if not block and end - begin > 2 and data[0] & 0xE0 == 0x20 and last[0] & 1:
                break
    return frames[begin:end]


def least_frames(length: int, block: bool) -> int:
    """The fewest frames in which CiA 301 can move `length` bytes."""
    segments = -(-length // SEGMENT)
    return 2 + segments + -(-segments // BLOCK_SEGMENTS) + 2 if block else 2 + 2 * segments


def bus_seconds(frames: list[tuple[int, bytes]]) -> float:
    """Time of the frames at 1 Mbit/s, sent back to back."""
    return sum(classic_frame_bits(identifier, data) for identifier, data in frames) / BITRATE


def transfers() -> list[dict[str, Any]]:
    """Upload tables of two sizes to a node by both SDO transfers; frames and bus time of each upload."""
    rows = []
    with tempfile.TemporaryDirectory() as folder, NodeProcess(Path(folder) / "state"):
        file = Path(folder) / "tables.bin"
        for sequence, (size, block) in enumerate(
            ((size, block) for size in PADDING for block in (False, True)), 1
        ):
            file.write_bytes(small_table(sequence=sequence, padding=PADDING[size]))
            image = read_image(file)
            with can.Bus(interface="socketcan", channel="vcan0") as bus:
                counted = Counted(bus)
                device = Compensator(SdoClient(counted, NODE_ID, 10.0))
                upload_image(device, image, lambda _: None, lambda _done, _total: None, block, confirm=True)
            moving = frames_of_image(counted.frames, block)
            rows.append(
                {
                    "bytes": len(image.data), "transfer": "block" if block else "segmented", "frames": len(moving),
                    "least": least_frames(len(image.data), block), "seconds": bus_seconds(moving),
                    "all_frames": len(counted.frames), "all_seconds": bus_seconds(counted.frames),
                }
            )  # fmt: skip
    return rows


@dataclasses.dataclass(frozen=True)
class Budget:
    """Instructions of one control cycle on the M4."""

    mean: float
    worst: int

    @classmethod
    def of(cls, cycles: np.ndarray) -> Budget:
        """Mean and worst of counted cycles."""
        return cls(float(cycles["instructions"].mean()), int(cycles["instructions"].max()))


def budgets() -> dict[str, Budget]:
    """Of the core alone and of the whole node between two buses, for a recorded motion of an arm with every effect."""
    import arms
    import recording
    from armtrue.tables.export import ExportOptions, export

    from tests import qemu

    cycles_count = 1000
    arm = arms.full_arm("kr30", grid_nodes=6)
    cycles = recording.blank_cycles(cycles_count)
    path = recording.motion(arm.chain.limits, cycles_count, 1e-3, np.random.default_rng(1))
    cycles["target"][:, :6] = np.round(path * 2**20 / (2.0 * np.pi) * 100.0)
    cycles["request"][0] = recording.ACTIVATE_A
    cycles["time_ms"] = np.arange(cycles_count) + 1
    motion = recording.Recording(6, bytes(export(arm, ExportOptions()).image), cycles=cycles)
    found = {}
    for image in ("cycle_replay", "node_budget"):
        elf = qemu.build_images("stm32f405", image) / f"{image}.elf"
        run = qemu.run_image(elf, motion.to_bytes(), timeout_s=300.0)
        if run.status != 0:
            raise RuntimeError(f"{elf}: status {run.status}")
        # The first cycle activates the table: not counted.
        if image == "node_budget":
            counts = np.frombuffer(run.output, _NODE_RESULT)[1:]
            dump = counts["read"] == 0x2011 << 8
            found["with the node's CAN path"] = Budget.of(counts[counts["read"] == 0])
            found["the same, and an SDO read of a status value"] = Budget.of(
                counts[(counts["read"] != 0) & ~dump]
            )
            found["the same, and an SDO block upload of the table"] = Budget.of(counts[dump])
        else:
            found["compensator alone"] = Budget.of(recording.played(run.output)[1:])
    return found


def report(transferred: Path) -> str:
    """The section of docs/results.md."""
    rows = json.loads(transferred.read_text(encoding="utf-8"))
    if any(row["frames"] != row["least"] for row in rows):
        raise RuntimeError(f"more frames than CiA 301 needs: {rows}")
    lines = [
        "Upload of a table over SDO, frames counted on the bus, the fewest that CiA 301 does it with; bus time at 1 "
        "Mbit/s with counted stuff bits, frame behind frame. The whole command also asks, verifies, commits, activates "
        "and confirms:",
        "",
        "| bytes | transfer | frames | bus time [s] | kB/s | whole command: frames | bus time [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['bytes']} | {row['transfer']} | {row['frames']} | {row['seconds']:.3f} | "
            f"{row['bytes'] / row['seconds'] / 1000:.1f} | {row['all_frames']} | {row['all_seconds']:.3f} |"
        )
    lines += [
        "",
        "Instructions of a control cycle on the Cortex-M4 (QEMU, `-icount`), a six-axis arm with every effect and a "
        "grid, the tool's position held; a millisecond at 168 MHz has 168 000 clocks. *The node's CAN path*: SYNC, "
        "three target and three feedback frames through the whole node, between queues in memory; not in it: the bxCAN "
        "driver and its interrupts, flash wait states, temperatures, payload, the full pose:",
        "",
        "| | mean | worst |",
        "|---|---|---|",
    ]
    lines += [f"| {name} | {budget.mean:.0f} | {budget.worst} |" for name, budget in budgets().items()]
    return "\n".join(lines)


def main() -> None:
    """Measure, or report."""
    parser = argparse.ArgumentParser()
    parser.add_argument("part", choices=("transfer", "report"))
    parser.add_argument("place", type=Path)
    arguments = parser.parse_args()
    if arguments.part == "report":
        print(report(arguments.place))
        return
    arguments.place.write_text(json.dumps(transfers(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
