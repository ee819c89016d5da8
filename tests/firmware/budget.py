"""Recorded instructions and bytes (budget.json), which a measurement may exceed by 2 %."""

from __future__ import annotations

import json
from pathlib import Path

FILE = Path(__file__).with_name("budget.json")
# A cycle of 1 kHz has 168 000 clocks at 168 MHz; the rest is for wait states and the CAN path.
INSTRUCTIONS_A_CYCLE = 25_000
CODE_BYTES = 128 * 1024  # of 1 MiB; the measured size is held to the recorded one, too
MEMORY_BYTES = 24 * 1024  # static memory and stack beside two table slots
REGRESSION = 1.02


def check(what: str, value: int) -> None:
    """Fail if `value` is more than 2 % above the entry `what` of budget.json."""
    on_record = json.loads(FILE.read_text())[what]
    print(f"{what}: {value} (on record {on_record})")
    assert value <= REGRESSION * on_record, (
        f"{what}: {value} is more than 2 % above tests/firmware/budget.json"
    )
