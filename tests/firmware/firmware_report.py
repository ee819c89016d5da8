"""Bytes, stack and instructions a cycle of the firmware, also by function. `./dev firmware` prints them.

With the word `table`: the STM32F405's figures beside their budgets, as docs/results.md has them.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "sim"), str(ROOT)]

import budget  # noqa: E402
import image_facts  # noqa: E402
import recording  # noqa: E402
import test_cycles  # noqa: E402

from tests import qemu  # noqa: E402

CYCLES = 600
PROFILED_CYCLES = 10
IMAGES = (
    ("stm32f405", "armtrue_stm32f405", "STM32F405, the product"),
    ("cortex-m7", "cycle_replay", "Cortex-M7, the core alone (recorded cycles)"),
    ("r5f", "armtrue_r5f", "Cortex-R5F (Zynq UltraScale+), the product"),
)
# Parts of the firmware: a function belongs to the first one with a word that its C++ name contains (or is, after =).
PARTS = (
    ("1-D tables and grids", ("interpolate", "locate")),
    ("gravity", ("update_gravity",)),
    ("terms, nodes, harmonics", ("add_terms", "evaluate_", "add_harmonics", "begin_terms", "add_slow_waves")),
    ("solver", ("DampedSolver",)),
    ("real and nominal kinematics", ("real_tool", "apply_", "advance", "nominal_tool", "rotate", "joint_motions",
                                     "turn_motions", "link_positions", "tool_error")),
    ("Newton steps and secants", ("=solve",)),
    ("limits, blending, increments, direction", ("Compensator", "scale_into_limits")),
    ("copies", ("memcpy", "memset")),
)  # fmt: skip


def sizes() -> None:
    """Bytes of every image, and its files."""
    print(f"{'image':44} {'code':>7} {'static*':>8} {'stack**':>8}")
    for preset, name, what in IMAGES:
        elf = qemu.build_images(preset) / f"{name}.elf"
        stack = image_facts.stack(elf)
        print(f"{what:44} {image_facts.code_size(elf):7} {image_facts.static_memory(elf):8} {stack.total:8}")
    print(
        "*  bytes beside two table slots of 16 KiB   ** deepest chain of calls, one interrupt on top of it\n"
    )
    elf = qemu.build_images("stm32f405") / "armtrue_stm32f405.elf"
    stack = image_facts.stack(elf)
    memory = image_facts.static_memory(elf) + image_facts.reserved_stack(elf)
    print(
        f"STM32F405: code {image_facts.code_size(elf)} of {budget.CODE_BYTES} bytes; static memory and reserved stack "
        f"{memory} of {budget.MEMORY_BYTES} bytes"
    )
    print(f"deepest: {' → '.join(_short(name) for name in stack.program_chain)} ({stack.program} bytes)")
    print(
        f"on top:  {' → '.join(_short(name) for name in stack.interrupt_chain)} ({stack.interrupt} bytes)\n"
    )
    for preset, name, _ in IMAGES:
        stem = Path("build") / preset / "images" / name
        print("  " + "  ".join(f"{stem}{suffix}" for suffix in (".elf", ".bin", ".hex", ".map")))


def _short(name: str) -> str:
    plain = name.replace("(anonymous namespace)::", "").replace("armtrue::", "")
    return plain.split("(")[0].split("<")[0] or name


def instructions() -> None:
    """Exact counts of recorded cycles on the emulated STM32F405."""
    elf = qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"
    print(
        f"\nInstructions a cycle, worst of {CYCLES} recorded ones (six axes, every effect, 3° tables, 6×6×6 grid)"
    )
    print(f"{'arm':10} {'position':>9} {'full pose':>10}    budget {budget.INSTRUCTIONS_A_CYCLE} (position)")
    for name in ("kr30", "irb2400", "cobot"):
        worst = [int(test_cycles.on_chip(test_cycles.recorded(name, CYCLES, pose))["instructions"].max())
                 for pose in (False, True)]  # fmt: skip
        print(f"{name:10} {worst[0]:9} {worst[1]:10}")
    made = test_cycles.recorded("kr30", CYCLES)
    by_function = _profile(elf, made)
    total = sum(by_function.values())
    print(f"\nWhere they go (kr30, mean of {PROFILED_CYCLES} cycles with the grid)")
    _print_shares(_by_part(by_function), total)
    print("by function")
    _print_shares(dict(by_function.most_common(14)), total)


def _profile(elf: Path, made: recording.Recording) -> Counter[str]:
    """Instructions a cycle by C++ function: those of a run less those of one that stops PROFILED_CYCLES earlier."""
    end = 300  # the first table, the one with the grid, is in force
    counts = []
    for cycles in (end - PROFILED_CYCLES, end):
        cut = recording.Recording(made.joints, made.table_a, made.table_b, cycles=made.cycles[:cycles])
        counts.append(Counter(qemu.instructions_by_function(elf, cut.to_bytes())))
    counts[1].subtract(counts[0])
    names = image_facts.demangled(list(counts[1]))
    result: Counter[str] = Counter()
    for symbol, count in counts[1].items():
        if (
            "replay::" not in names[symbol]
            and "semihosting" not in names[symbol]
            and "main" not in names[symbol]
        ):
            result[_short(names[symbol].split("> armtrue::")[-1])] += round(count / PROFILED_CYCLES)
    return result


def _by_part(by_function: Counter[str]) -> dict[str, int]:
    parts: Counter[str] = Counter()
    for function, count in by_function.items():
        found = next((part for part, words in PARTS if any(_matches(w, function) for w in words)), "other")
        parts[found] += count
    return dict(parts.most_common())


def _matches(word: str, function: str) -> bool:
    return word[1:] == function if word.startswith("=") else word in function


def _print_shares(counts: dict[str, int], total: int) -> None:
    for name, count in counts.items():
        if count > 0:
            print(f"  {count:6} {100 * count / total:5.1f} %  {name}")


def table() -> str:
    """The STM32F405's figures, each measured now."""
    elf = qemu.build_images("stm32f405") / "armtrue_stm32f405.elf"
    qemu.build_images("stm32f405", "cycle_replay")
    cycles = test_cycles.CYCLES
    worst = [int(test_cycles.on_chip(test_cycles.recorded("kr30", cycles, pose))["instructions"].max())
             for pose in (False, True)]  # fmt: skip
    reserved = image_facts.reserved_stack(elf)
    rows = (
        (f"instructions of a cycle of the core, worst of {_grouped(cycles)}, six axes, every effect, 3° tables, "
         "6×6×6 grid",
         worst[0], budget.INSTRUCTIONS_A_CYCLE),
        ("the same with the attitude held too (`--full-pose`)", worst[1], test_cycles.POSE_BUDGET),
        ("code of the whole image [bytes]", image_facts.code_size(elf), budget.CODE_BYTES),
        ("static memory and reserved stack beside two table slots [bytes]",
         image_facts.static_memory(elf) + reserved, budget.MEMORY_BYTES),
        ("deepest stack, one interrupt on top of it [bytes]", image_facts.stack(elf).total, reserved),
    )  # fmt: skip
    lines = ["| STM32F405 | | budget |", "|---|---|---|"]
    return "\n".join(
        lines + [f"| {what} | {_grouped(value)} | {_grouped(most)} |" for what, value, most in rows]
    )


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def main() -> int:
    """Print everything; the budgets themselves are tests (test_image_gates.py, test_cycles.py)."""
    if sys.argv[1:] == ["table"]:
        print(table())
        return 0
    steps: tuple[Callable[[], None], ...] = (sizes, instructions)
    for step in steps:
        step()
    return 0


if __name__ == "__main__":
    sys.exit(main())
