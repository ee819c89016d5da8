"""What is on record for instructions and bytes (budget.json), and the 2 % that it may be exceeded by."""

from __future__ import annotations

import json
from pathlib import Path

FILE = Path(__file__).with_name("budget.json")
# 1 kHz at 168 MHz leaves 168 000; wait states and the CAN path have the rest.
INSTRUCTIONS_A_CYCLE = 25_000
CODE_BYTES = 128 * 1024  # of 1 MiB; what is measured is held to what is on record, too
MEMORY_BYTES = 24 * 1024  # static memory and stack beside two table slots
REGRESSION = 1.02


def check(what: str, value: int) -> None:
    """Fail where `value` is more than 2 % above what budget.json has under `what`."""
    on_record = json.loads(FILE.read_text())[what]
    print(f"{what}: {value} (on record {on_record})")
    assert value <= REGRESSION * on_record, (
        f"{what}: {value} is more than 2 % above tests/firmware/budget.json"
    )
