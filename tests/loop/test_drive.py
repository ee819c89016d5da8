"""The simulated drive's power state machine against the transitions of CiA 402-2, figure 6 and table 27."""

from __future__ import annotations

import pytest
from armtrue_loop.drive import STATUS, next_state
from canopen.profiles.p402 import State402

pytestmark = pytest.mark.without_bus

SHUTDOWN, SWITCH_ON, ENABLE, DISABLE_VOLTAGE, QUICK_STOP = 0x06, 0x07, 0x0F, 0x00, 0x02


@pytest.mark.parametrize(
    ("state", "controlword", "expected"),
    [
        ("switch on disabled", SHUTDOWN, "ready to switch on"),  # transition 2
        ("switch on disabled", SWITCH_ON, "switch on disabled"),
        ("switch on disabled", ENABLE, "switch on disabled"),
        ("ready to switch on", SWITCH_ON, "switched on"),  # 3
        ("switched on", ENABLE, "operation enabled"),  # 4
        ("operation enabled", SWITCH_ON, "switched on"),  # 5
        ("switched on", SHUTDOWN, "ready to switch on"),  # 6
        ("ready to switch on", DISABLE_VOLTAGE, "switch on disabled"),  # 7
        ("operation enabled", SHUTDOWN, "ready to switch on"),  # 8
        ("operation enabled", DISABLE_VOLTAGE, "switch on disabled"),  # 9
        ("switched on", QUICK_STOP, "switch on disabled"),  # 10
        ("operation enabled", QUICK_STOP, "quick stop active"),  # 11
        ("quick stop active", DISABLE_VOLTAGE, "switch on disabled"),  # 12
        ("quick stop active", ENABLE, "operation enabled"),  # 16
        ("fault", ENABLE, "fault"),
    ],
)
def test_controlwords_move_the_power_state(state: str, controlword: int, expected: str) -> None:
    assert next_state(state, controlword, fault_reset_edge=False) == expected


def test_fault_ends_only_with_a_rising_edge_of_fault_reset() -> None:
    assert next_state("fault", 0x80, fault_reset_edge=True) == "switch on disabled"
    assert next_state("fault", 0x80, fault_reset_edge=False) == "fault"


def test_statuswords_match_the_state_masks_of_canopen() -> None:
    for state, word in STATUS.items():
        read = [name for name, (mask, bits) in State402.SW_MASK.items() if word & mask == bits]
        assert read == [state.upper()]
