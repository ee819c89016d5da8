"""Gates on linked images: no heap, no floating point, no recursion, bounded stack, sizes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import budget
import image_facts
import pytest

from tests import qemu

# The joint path: what runs in every control cycle.
JOINT_PATH = ["_ZN7armtrue11Compensator5cycleERKNS_10CycleInputE"]
HEAP = re.compile(r"^(_?_?malloc.*|_?calloc.*|_?realloc.*|_?free_r|free|_sbrk.*|_Zn[wa].*|_Zd[la].*)$")
FLOAT_HELPER = re.compile(
    r"^__aeabi_[fd].*|^__(add|sub|mul|div|fix|float|eq|ne|lt|gt|le|ge|extend|trunc)\w*[sd]f\w*$"
)
FLOAT_INSTRUCTION = re.compile(r"\tv[a-z]+(\.\w+)?\t.*|\t(vldr|vstr|vpush|vpop|vmrs|vmsr)\b")


@pytest.fixture(scope="module")
def elf() -> Path:
    """The compensator with everything it needs to take a table and run cycles."""
    return qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"


@pytest.fixture(scope="module")
def product() -> Path:
    return qemu.build_images("stm32f405") / "armtrue_stm32f405.elf"


@pytest.fixture(scope="module")
def code(elf: Path) -> dict[str, list[str]]:
    return image_facts.instructions(elf)


def joint_path(code: dict[str, list[str]]) -> list[str]:
    roots = [name for name in code if any(name.startswith(root) for root in JOINT_PATH)]
    assert any("Compensator5cycle" in root for root in roots)
    return roots


@pytest.mark.parametrize("image", ["elf", "product"])
def test_no_heap_and_no_floating_point_helpers(image: str, request: pytest.FixtureRequest) -> None:
    names = image_facts.symbols(request.getfixturevalue(image))
    assert not [name for name in names if HEAP.match(name)]
    assert not [name for name in names if FLOAT_HELPER.match(name)]


@pytest.mark.parametrize("image", ["elf", "product"])
def test_no_floating_point_instruction(image: str, request: pytest.FixtureRequest) -> None:
    found = [
        line
        for lines in image_facts.instructions(request.getfixturevalue(image)).values()
        for line in lines
        if FLOAT_INSTRUCTION.search(line)
    ]
    assert not found


def test_gates_detect_deliberate_violations() -> None:
    """A gate that cannot fail would check nothing."""
    assert all(HEAP.match(name) for name in ("malloc", "_Znwj", "_ZdlPv", "_sbrk"))
    assert not HEAP.match("_ZN7armtrue5solveE")
    assert FLOAT_HELPER.match("__aeabi_dadd")
    assert FLOAT_HELPER.match("__muldf3")
    assert not FLOAT_HELPER.match("__muldi3")
    assert FLOAT_INSTRUCTION.search(" 80:\tvadd.f32\ts0, s1")
    assert FLOAT_INSTRUCTION.search(" 80:\tvmov\tr0, s0")
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": set()}
    assert image_facts.recursive(graph, {"a", "d"}) == ["a"]


@pytest.mark.parametrize("image", ["elf", "product"])
def test_no_recursion(image: str, request: pytest.FixtureRequest) -> None:
    code = image_facts.instructions(request.getfixturevalue(image))
    graph = image_facts.with_indirect_calls(code, image_facts.calls(code))
    everything = image_facts.reachable(graph, ["reset_handler", *joint_path(code)])
    assert len(everything) > 40
    assert image_facts.recursive(graph, everything) == []


def test_stack_of_the_joint_path_is_bounded(elf: Path, code: dict[str, list[str]]) -> None:
    graph = image_facts.calls(code)
    sizes = image_facts.frames(elf)
    for root in joint_path(code):
        # No call through a pointer: the graph is complete.
        for function in image_facts.reachable(graph, [root]):
            assert not [line for line in code[function] if re.search(r"\tblx\tr|\tbx\tr(?!14)", line)], (
                function
            )
        depth, chain = image_facts.deepest(graph, sizes, root)
        print(f"{root}: {depth} bytes, {' → '.join(chain)}")
        assert depth <= 2048


@pytest.mark.parametrize(
    ("preset", "name"),
    [("stm32f405", "armtrue_stm32f405"), ("stm32f405", "cycle_replay"), ("r5f", "armtrue_r5f"),
     pytest.param("cortex-m7", "cycle_replay", marks=pytest.mark.full)],
)  # fmt: skip
def test_the_reserved_stack_is_enough(preset: str, name: str) -> None:
    """The deepest chain of calls from reset, and the deepest interrupt on top of it."""
    image = qemu.build_images(preset, name) / f"{name}.elf"
    stack = image_facts.stack(image)
    print(
        f"{preset} {name}: {stack.program} + {stack.interrupt} bytes of {image_facts.reserved_stack(image)}"
    )
    assert stack.program > 500
    assert stack.total <= image_facts.reserved_stack(image)


def test_the_image_is_within_its_budget(product: Path) -> None:
    code, memory = image_facts.code_size(product), image_facts.static_memory(product)
    stack = image_facts.stack(product).total
    assert code <= budget.CODE_BYTES
    assert memory + image_facts.reserved_stack(product) <= budget.MEMORY_BYTES
    budget.check("STM32F405 image: code", code)
    budget.check("STM32F405 image: static memory beside two table slots", memory)
    budget.check("STM32F405 image: stack with one interrupt", stack)


def test_budget_check_fails_above_two_percent() -> None:
    on_record = json.loads(budget.FILE.read_text())["STM32F405 image: code"]
    budget.check("STM32F405 image: code", int(1.02 * on_record))
    with pytest.raises(AssertionError, match="2 %"):
        budget.check("STM32F405 image: code", int(1.02 * on_record) + 2)


def test_a_call_through_a_pointer_must_be_listed() -> None:
    code = {"_Z7unknownv": ["8000000:\tblx\tr3"]}
    with pytest.raises(AssertionError, match="INDIRECT_CALLS"):
        image_facts.with_indirect_calls(code, image_facts.calls(code))
    with pytest.raises(AssertionError, match="no stack information"):
        image_facts.frame_of("_Z7unknownv", {})
