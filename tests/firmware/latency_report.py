"""Latency of SYNC and targets through the STM32F405's node, and its spread, per mode and frame layout.

python tests/firmware/latency_report.py [--cycles N]
"""

from __future__ import annotations

import argparse
import struct
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "sim"), str(ROOT / "tests" / "firmware")]

import arms  # noqa: E402
import flash_model  # noqa: E402
import recording  # noqa: E402
from armtrue.tables.export import ExportOptions, export  # noqa: E402

from tests import qemu  # noqa: E402

CORE_HZ = 168_000_000
_MEASURED = np.dtype(
    [("sync_given", "<u4"), ("sync_on_wire", "<u4"), ("output_given", "<u4"), ("output_on_wire", "<u4")]
)
_NEVER = 2**32 - 1
MODES = {"forward": 0, "inline": 1, "offset": 2}
LAYOUTS = {"1 axis a PDO": 1, "2 axes a PDO": 2, "FD, 6 axes": 6}
_BLENDED = 60  # cycles after which the correction is in force


@dataclass(frozen=True)
class Case:
    """A mode, a frame layout, and whether the targets wait for SYNC."""

    mode: str
    layout: str
    synchronous: bool

    def __str__(self) -> str:
        kind = "synchronous" if self.synchronous else "asynchronous"
        return f"{self.mode}, {self.layout}" + ("" if self.mode == "forward" else f", {kind}")


def cases() -> list[Case]:
    """All cases that the table has."""
    return [
        Case(mode, layout, synchronous)
        for mode in MODES
        for layout in LAYOUTS
        for synchronous in ((False,) if mode == "forward" else (False, True))
    ]


def motion(cycles_count: int) -> recording.Recording:
    """A six-axis arm with every effect, sweeping its limits."""
    arm = arms.full_arm("kr30", grid_nodes=6)
    cycles = recording.blank_cycles(cycles_count)
    path = recording.motion(arm.chain.limits, cycles_count, 1e-3, np.random.default_rng(1))
    cycles["target"][:, :6] = np.round(path * 2**20 / (2.0 * np.pi) * 100.0)
    return recording.Recording(6, bytes(export(arm, ExportOptions()).image), cycles=cycles)


def input_of(case: Case, motion: recording.Recording, clocks_per_instruction: float) -> bytes:
    """What latency_check reads."""
    instructions_per_ms = int(CORE_HZ / 1000 / clocks_per_instruction)
    setup = struct.pack(
        "<4I", MODES[case.mode], LAYOUTS[case.layout], int(case.synchronous), instructions_per_ms
    )
    return setup + motion.to_bytes()


def measure(elf: Path, case: Case, motion: recording.Recording, clocks_per_instruction: float) -> np.ndarray:
    """Microseconds in every cycle once the correction is in force; NaN where nothing came out."""
    run = qemu.run_image(elf, input_of(case, motion, clocks_per_instruction), timeout_s=300.0)
    if run.status != 0:
        raise RuntimeError(f"{elf.name}, {case}: status {run.status} {run.printed}")
    found = np.frombuffer(run.output, _MEASURED)[_BLENDED:]
    columns = [found[name].astype(float) for name in _MEASURED.names or ()]
    table = np.stack(columns, axis=1)
    table[table == _NEVER] = np.nan
    return table * clocks_per_instruction * 1e6 / CORE_HZ


def spread(values: np.ndarray) -> str:
    """Median (minimum–maximum) and the number of cycles without output; "never" if no cycle had one."""
    if np.isnan(values).all():
        return "never"
    missing = f", {np.isnan(values).sum()} missing" if np.isnan(values).any() else ""
    return f"{np.nanmedian(values):.0f} ({np.nanmin(values):.0f}–{np.nanmax(values):.0f}){missing}"


def model(elf: Path) -> float:
    """Clocks per instruction, from ten inline cycles."""
    return flash_model.clocks_per_instruction(
        elf, input_of(Case("inline", "2 axes a PDO", False), motion(10), 2.0)
    )


def table(elf: Path, cycles: int) -> list[str]:
    """One row a case: SYNC and the outputs."""
    recorded = motion(cycles)
    factor = model(elf)
    lines = [f"{factor:.2f} clocks an instruction", ""]
    lines += ["| case | SYNC given | SYNC on the wire | last output given |", "|---|---|---|---|"]
    for case in cases():
        found = measure(elf, case, recorded, factor)
        lines.append(f"| {case} | " + " | ".join(spread(found[:, column]) for column in range(3)) + " |")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cycles", type=int, default=1000)
    elf = qemu.build_images("stm32f405", "latency_check") / "latency_check.elf"
    print("\n".join(table(elf, parser.parse_args().cycles)))


if __name__ == "__main__":
    main()
