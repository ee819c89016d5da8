"""Clocks of the STM32F405 at 168 MHz, from the emulator's trace and a model of the flash accelerator.

The model (RM0090, 3.5; Cortex-M4 technical reference manual, 3.3):
- Flash is read in lines of 128 bits, five wait states each.
- The instruction cache has 64 lines and replaces the least recently used one. Only lines that a jump leads to are kept.
- The next line in memory is read by the prefetch buffer while the present one is executed, in six clocks.
- An instruction takes one clock; two more where the next executed is not the next in memory.
- A load or store takes one more, a multiple one as many more as it has registers, a division five more.
- Constants in flash are as fast as RAM, RAM has no wait states, and there are no interrupts.
"""

from __future__ import annotations

import collections
import itertools
import re
import subprocess
import tempfile
from pathlib import Path

from tests import qemu

LINE_BYTES = 16
CACHE_LINES = 64
WAIT_STATES = 5
_REFILL = 2
_DIVISION = 5
_TRACED = re.compile(r"Trace 0: \S+ \[[0-9a-f]+/([0-9a-f]+)/")


def extra_clocks(elf: Path) -> dict[int, tuple[int, int]]:
    """By address: an instruction's size in bytes, and the clocks beyond one that its kind takes."""
    text = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(elf)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    found: dict[int, tuple[int, int]] = {}
    addresses = []
    for line in text.splitlines():
        match = re.match(r"\s*([0-9a-f]+):\t(\S+)\s*(.*)", line)
        if match is None:
            continue
        address, word, operands = int(match[1], 16), match[2], match[3]
        extra = 0
        if word.startswith(("ldm", "stm", "push", "pop")):
            names = re.findall(r"\{(.*?)\}", operands)
            extra = names[0].count(",") + 1 if names else 1
        elif word.startswith(("ldr", "str")):
            extra = 2 if word.startswith(("ldrd", "strd")) else 1
        elif word.startswith(("sdiv", "udiv")):
            extra = _DIVISION
        found[address] = (2, extra)
        addresses.append(address)
    for here, following in itertools.pairwise(addresses):
        if following - here in (2, 4):
            found[here] = (following - here, found[here][1])
    return found


def clocks(addresses: list[int], kinds: dict[int, tuple[int, int]]) -> int:
    """Clocks of a sequence of executed instructions."""
    cache: collections.OrderedDict[int, None] = collections.OrderedDict()
    time = 0
    line, prefetched_at, follows = -1, 0, -1
    for address in addresses:
        size, extra = kinds.get(address, (2, 1))
        jumped = address != follows
        if jumped:
            time += _REFILL
        for part in {address // LINE_BYTES, (address + size - 1) // LINE_BYTES}:
            if part == line:
                continue
            if part in cache:
                cache.move_to_end(part)
            elif part == line + 1 and not jumped:
                time = max(time, prefetched_at + WAIT_STATES + 1)
            else:
                time += WAIT_STATES
                cache[part] = None
                if len(cache) > CACHE_LINES:
                    cache.popitem(last=False)
            line, prefetched_at = part, time
        time += 1 + extra
        follows = address + size
    return time


def trace(elf: Path, recorded: bytes, timeout_s: float = 300.0) -> list[int]:
    """Addresses of a run's instructions, in order. For short runs: the trace file has about 80 bytes for each."""
    with tempfile.TemporaryDirectory() as folder:
        source, sink, log = (Path(folder, name) for name in ("in", "out", "log"))
        source.write_bytes(recorded)
        command = qemu._test_command(elf, "netduinoplus2", [str(source), str(sink)])
        command += ["-singlestep", "-d", "exec,nochain", "-D", str(log)]
        subprocess.run(command, capture_output=True, timeout=timeout_s, check=True)
        with log.open(encoding="ascii", errors="replace") as lines:
            return [int(match[1], 16) for match in map(_TRACED.match, lines) if match is not None]


def clocks_per_instruction(elf: Path, recorded: bytes) -> float:
    """The mean over the last third of a run: the beginning installs a table."""
    executed = trace(elf, recorded)
    executed = executed[2 * len(executed) // 3 :]
    return clocks(executed, extra_clocks(elf)) / len(executed)
