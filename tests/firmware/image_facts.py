"""What a linked ARM image holds: symbols, instructions, sizes, and the deepest stack its call graph allows."""

from __future__ import annotations

import re
import subprocess
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

_FUNCTION = re.compile(r"^[0-9a-f]+ <(.+)>:$")
_CALL = re.compile(r"\t(?:bl|blx|b|b\.n|b\.w|b\w\w|b\w\w\.n|b\w\w\.w)\t[0-9a-f]+ <([^+>]+)>")
_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]+)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_FRAME = re.compile(r"(\d+) bytes \((\w+(?:,\w+)*)\)")


def symbols(elf: Path) -> set[str]:
    """Names of all symbols."""
    text = subprocess.run(["arm-none-eabi-nm", str(elf)], capture_output=True, text=True, check=True).stdout
    return {line.split()[-1] for line in text.splitlines()}


def instructions(elf: Path) -> dict[str, list[str]]:
    """Disassembly by function. (Constants lie in the same section: they would read as code.)"""
    table = subprocess.run(
        ["arm-none-eabi-readelf", "-sW", str(elf)], capture_output=True, text=True, check=True
    ).stdout
    functions = {line.split()[-1] for line in table.splitlines() if " FUNC " in line}
    text = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(elf)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    result: dict[str, list[str]] = defaultdict(list)
    current = ""
    for line in text.splitlines():
        match = _FUNCTION.match(line)
        if match:
            current = match[1]
        elif "\t" in line and current in functions:
            result[current].append(line)
    return dict(result)


def calls(code: dict[str, list[str]]) -> dict[str, set[str]]:
    """Direct calls and tail calls, function to functions, as linked."""
    graph = {}
    for function, lines in code.items():
        targets = {match[1] for line in lines if (match := _CALL.search(line))}
        graph[function] = {target for target in targets if target in code and target != function} | (
            {function} if any("bl\t" in line and f"<{function}>" in line for line in lines) else set()
        )
    return graph


def reachable(graph: dict[str, set[str]], roots: list[str]) -> set[str]:
    """All functions that `roots` call, directly or not."""
    seen: set[str] = set()
    waiting = list(roots)
    while waiting:
        function = waiting.pop()
        if function not in seen:
            seen.add(function)
            waiting += graph.get(function, set())
    return seen


def recursive(graph: dict[str, set[str]], within: set[str]) -> list[str]:
    """Functions of `within` that call themselves, directly or not."""
    return sorted(f for f in within if f in reachable(graph, list(graph.get(f, set()))))


def frames(elf: Path) -> dict[str, int]:
    """Stack bytes of every compiled function that `elf` may hold (-fcallgraph-info=su), by linker name.

    Reads what the compiler left beside the objects of the image's own target and of all libraries. Errors on a frame
    without a bound.
    """
    build = elf.parent.parent
    others = {f"{image.stem}.dir" for image in elf.parent.glob("*.elf")} - {f"{elf.stem}.dir"}
    result: dict[str, int] = {}
    for path in build.rglob("*.ci"):
        if others & set(path.parts):
            continue
        for title, label in _NODE.findall(path.read_text(errors="replace")):
            match = _FRAME.search(label)
            if match is None:
                continue
            name = title.rsplit(":", 1)[-1]
            if "dynamic" in match[2] and "bounded" not in match[2]:
                raise AssertionError(f"{name}: its stack frame has no bound")
            result[name] = max(result.get(name, 0), int(match[1]))
    return result


# Assembly of the Cortex-R5F's startup.S: what it pushes before it calls, the return state included.
_ASSEMBLY = {"irq_entry": 44, "unexpected": 0, "reset_handler": 0}
# Assembly and libgcc: no stack information; what their prologues push, rounded up.
_LIBRARY = re.compile(
    r"^(__(popcountsi2|aeabi_\w+|udivmoddi4|divmoddi4)|strlen|strchr|mem(cpy|move|set|cmp))$"
)
LIBRARY_FRAME = 64


def frame_of(function: str, sizes: dict[str, int]) -> int:
    """Stack bytes of one linked function. Errors if the compiler recorded none."""
    # A constructor of a complete object is the same code as that of a base object, under another name.
    for name in (function, re.sub(r"C1(E|I|v|R)", r"C2\1", function)):
        if name in sizes:
            return sizes[name]
    if function in _ASSEMBLY:
        return _ASSEMBLY[function]
    if function.startswith("_ZThn"):  # a thunk adjusts `this` and jumps to the function itself
        return 0
    if _LIBRARY.match(function):
        return LIBRARY_FRAME
    raise AssertionError(f"{function}: no stack information")


def deepest(graph: dict[str, set[str]], sizes: dict[str, int], root: str) -> tuple[int, list[str]]:
    """The most stack that `root` can take, and the chain of calls that takes it."""
    best: dict[str, tuple[int, list[str]]] = {}

    def visit(function: str, above: tuple[str, ...]) -> tuple[int, list[str]]:
        if function in above:
            raise AssertionError(f"recursion: {' → '.join([*above, function])}")
        if function not in best:
            own = frame_of(function, sizes)
            below = [visit(callee, (*above, function)) for callee in sorted(graph.get(function, set()))]
            most = max(below, default=(0, []), key=lambda entry: entry[0])
            best[function] = (own + most[0], [function, *most[1]])
        return best[function]

    return visit(root, ())


def demangled(names: list[str]) -> dict[str, str]:
    """C++ names of linker symbols."""
    text = subprocess.run(
        ["c++filt"], input="\n".join(names), capture_output=True, text=True, check=True
    ).stdout
    return dict(zip(names, text.splitlines(), strict=True))


# Calls through pointers: the calling functions (by C++ name), and those that they can call. The stack test fails on an
# unlisted function with such a call, and on an entry that names nothing in the image.
_PORT = r"(BxCan<.*>|SlcanPort|ZynqMpCan<.*>)::"
_FLASH = r"(GuardedFlash<.*>|PatientFlash|RamFlash|FlashDriver<.*>)::"
_VERIFY = r"(IdentityVerifier|AcceptAll)::verify\("
INDIRECT_CALLS: dict[str, str] = {
    r"^reset_handler$": r"^(_GLOBAL__sub_I_|global constructors keyed to )",
    r"^main$|make_device": r"(stm32f405|r5f)::clock_us\(",
    r"^irq_entry$": r"^irq_handler$",  # startup.S
    r"^unexpected$": r"^fault_handler$",
    r"^armtrue::replay::(\(anonymous namespace\)::)?play(_all)?\(": (
        r"^\(anonymous namespace\)::(read_file|write_file|between)\(|InstructionCounter::read\("
    ),
    r"SlcanPort::(send|reply)\(": r"::Usart<.*>::write\(|::Usart<.*>::writable\(",
    r"SlcanPort::receive\(": r"::Usart<.*>::read\(",
    r"canopen::Node::process\(": _PORT + r"receive\(",
    r"canopen::(Node::run_self_test|.*refresh_bus)\(": _PORT + r"(bus_state|counters)\(",
    r"canopen::BusWatch::BusWatch\(": _PORT + r"counters\(",
    r"canopen::BusWatch::process\(": _PORT + r"(bus_state|counters|recover)\(",
    r"canopen::(Node::forward|SdoServer::transmit|TpdoProducer::transmit|Emcy::process|JointPath::(release|send_set)|"
    r"Nmt::send_state)\(": _PORT + r"send\(",
    r"canopen::SdoServer::send_block_segment\(": r"(BxCan<.*>|CanPort)::has_backlog\(",
    r"canopen::SdoServer::initiate_block_download\(": r"(ZynqMpCan<.*>|CanPort)::longest_burst\(",
    r"canopen::Node::Node\(": r"CanPort::supports_fd\(",
    r"canopen::Node::(before_write|check_write|check_communication_write)\(": (
        r"SlotParameters::erase\(|(stm32f405|r5f)::clock_us\("
    ),
    r"canopen::Node::(serve|handle_upstream|process)\(": r"note_long_request\(|(stm32f405|r5f)::clock_us\(",
    r"canopen::save_parameters\(": r"SlotParameters::save\(",
    r"canopen::load_parameters\(": r"SlotParameters::(load|holds_something)\(",
    r"canopen::DictionaryAccess::append\(": r"TableTransfer::append\(",
    r"canopen::DictionaryAccess::cancel\(": r"TableTransfer::cancel_download\(",
    r"canopen::DictionaryAccess::begin_write\(": r"TableTransfer::begin_download\(",
    r"canopen::DictionaryAccess::begin_read\(": r"TableTransfer::begin_upload\(|Node::before_read\(",
    r"canopen::DictionaryAccess::finish_write\(": (
        r"TableTransfer::finish_download\(|Node::(before_write|after_write)\("
    ),
    r"canopen::TpdoProducer::sample\(": r"Node::before_read\(",
    r"canopen::TableTransfer::(command|commit|check_axes)\(": r"Node::may_(erase|change_axes)\(",
    r"canopen::JointPath::(compute|take_target)\(": r"(stm32f405|r5f)::clock_us\(|" + _PORT + r"send\(",
    r"canopen::Node::handle_(sync|upstream)\(": r"(stm32f405|r5f)::clock_us\(|" + _PORT + r"send\(",
    r"(storage::SlotStore|canopen::TableTransfer)::capacity\(": _FLASH + r"slot_size\(",
    r"storage::SlotStore::(read_header|is_blank|load|classify|load_pending|activate|commit|load_active)\(": _FLASH
    + r"(read|slot_size)\(",
    r"storage::SlotStore::program\(": _FLASH + r"(program|read)\(",
    r"storage::SlotStore::erase\(": _FLASH + r"erase\(",
    r"storage::SlotStore::(classify|load_active|commit|load_pending|activate)\(": _VERIFY,
}
_BY_POINTER = re.compile(r"\tblx\t(r\d+|ip|lr)|\tbx\t(r\d+|ip)\b")


def with_indirect_calls(code: dict[str, list[str]], graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """`graph` with what can be reached through pointers (INDIRECT_CALLS)."""
    names = demangled(list(code))
    functions = [name for name in code if name in graph]
    result = {function: set(callees) for function, callees in graph.items()}
    for function in functions:
        if not any(_BY_POINTER.search(line) for line in code[function]):
            continue
        patterns = [
            targets for callers, targets in INDIRECT_CALLS.items() if re.search(callers, names[function])
        ]
        if not patterns:
            raise AssertionError(
                f"{names[function]}: a call through a pointer that INDIRECT_CALLS does not name"
            )
        targets = {
            other for other in functions if any(re.search(pattern, names[other]) for pattern in patterns)
        } - {function}
        if not targets and function != "reset_handler":  # not every image has constructors
            raise AssertionError(f"{names[function]}: INDIRECT_CALLS names nothing in the image")
        result[function] |= targets
    return result


# Bytes that an exception pushes, with the alignment word (Arm DDI 0403, B1.5.6).
EXCEPTION_FRAME = 36


@dataclass(frozen=True)
class Stack:
    """The most stack an image can take: in its program, and on top of that in one interrupt (they do not nest)."""

    program: int
    program_chain: list[str]
    interrupt: int
    interrupt_chain: list[str]

    @property
    def total(self) -> int:
        """Bytes of both together."""
        return self.program + self.interrupt


def stack(elf: Path) -> Stack:
    """The deepest stack of an image, from reset and from every interrupt handler."""
    code = instructions(elf)
    graph = with_indirect_calls(code, calls(code))
    sizes_ = frames(elf)
    program = max(
        (deepest(graph, sizes_, root) for root in ("reset_handler", "main") if root in graph),
        key=lambda e: e[0],
    )
    handlers = [
        name for name in code if name.endswith("_handler") and name not in ("reset_handler", "fault_handler")
    ]
    interrupt = max((deepest(graph, sizes_, name) for name in handlers), default=(0, []), key=lambda e: e[0])
    readable = demangled([*program[1], *interrupt[1]])
    return Stack(
        program[0],
        [readable[name] for name in program[1]],
        interrupt[0] + EXCEPTION_FRAME,
        [readable[name] for name in interrupt[1]],
    )


def size_of(elf: Path, name: str) -> int:
    """Bytes of the object whose demangled symbol is `name`."""
    text = subprocess.run(
        ["arm-none-eabi-nm", "-S", "-C", str(elf)], capture_output=True, text=True, check=True
    ).stdout
    for line in text.splitlines():
        parts = line.split(maxsplit=3)
        if len(parts) == 4 and parts[3] == name:
            return int(parts[1], 16)
    raise AssertionError(f"{elf.name} has no {name}")


def reserved_stack(elf: Path) -> int:
    """Bytes that the linker script keeps for the stack."""
    return section_sizes(elf).get(".stack", 0)


def section_sizes(elf: Path) -> dict[str, int]:
    """Bytes of every section."""
    text = subprocess.run(
        ["arm-none-eabi-size", "-A", str(elf)], capture_output=True, text=True, check=True
    ).stdout
    fields = [line.split() for line in text.splitlines() if line.startswith(".")]
    return {name: int(size) for name, size, *_ in fields}


# Every image that accepts tables has two buffers of this size for them.
TABLE_SLOT = 16 * 1024


def static_memory(elf: Path) -> int:
    """Bytes of initialised and cleared memory beside the two table slots, without the stack."""
    sections = section_sizes(elf)
    return sections.get(".data", 0) + sections.get(".bss", 0) - 2 * TABLE_SLOT


def code_size(elf: Path) -> int:
    """Bytes in flash: vectors, program, constants, and what initialises memory."""
    sections = section_sizes(elf)
    return sum(
        sections.get(name, 0)
        for name in (".isr_vector", ".vectors", ".text", ".init_array", ".ARM.exidx", ".data")
    )
