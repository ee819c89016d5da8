"""The loop's controller keeps to the compensator's rules, however slowly the machine runs."""

from __future__ import annotations

import os
import signal
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np
import pytest
from armtrue_loop.controller import ANSWER_TIMEOUT_S, Controller
from armtrue_loop.operator import Operator
from armtrue_loop.processes import CellProcess, NodeUnderTest
from armtrue_loop.wiring import CONTROLLER_BUS, DRIVE_BUS, OFFSET_IDS, TARGET_IDS
from small_table import small_table

SCENARIO = Path(__file__).resolve().parents[2] / "sim/armtrue_loop/scenarios/warm-eccentric-gear.yaml"
STALE_S = 1.0  # the longest stale time-out that the compensator can be set to
HERE = np.array([0.1, -1.0, 0.5, 0.2, 0.4, -0.3])
THERE = np.array([0.4, -1.3, 0.2, 0.6, 0.7, 0.5])


@dataclass
class Loop:
    """The running controller, node and operator of the cell."""

    controller: Controller
    node: NodeUnderTest
    operator: Operator


@pytest.fixture(params=["offset", "inline"])
def loop(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Loop]:
    node = NodeUnderTest(tmp_path / "state", "loop", request.param)
    cell = CellProcess(SCENARIO, tmp_path, DRIVE_BUS if request.param == "inline" else CONTROLLER_BUS)
    try:
        node.start()
        operator = cell.operator()
        controller = Controller()
        controller.configure_compensator(request.param)
        controller.enable()
        yield Loop(controller, node, operator)
        controller.close()
        operator.close()
    finally:
        cell.kill()
        node.stop()


@pytest.mark.quick("offset")
def test_move_succeeds_after_the_targets_became_stale(loop: Loop) -> None:
    loop.controller.move(HERE, cycles=6, settle=2)
    time.sleep(1.5 * STALE_S)
    stale = loop.controller.compensator.sdo["Compensator status"]["Stale"].raw
    assert stale >= 1
    loop.controller.move(THERE, cycles=6, settle=2)
    assert loop.controller.joints == pytest.approx(THERE, abs=1e-6)
    assert loop.controller.worst_following == 0


def in_the_middle_of_a_move(
    loop: Loop, monkeypatch: pytest.MonkeyPatch, happen: Callable[[], None]
) -> list[int]:
    """Call `happen` once, before the 20th cycle from now; the returned list then holds that cycle's number."""
    cycle, begin, done = loop.controller.cycle, loop.controller.cycles, []

    def cycle_with_incident(targets: np.ndarray) -> bool:
        if not done and loop.controller.cycles == begin + 20:
            done.append(loop.controller.cycles)
            happen()
        return cycle(targets)

    monkeypatch.setattr(loop.controller, "cycle", cycle_with_incident)
    return done


@pytest.mark.full
def test_move_completes_although_the_node_halts_for_seconds(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop.controller.move(HERE, cycles=6, settle=2)
    process = loop.node.process_id
    going_on = threading.Timer(2.0 * STALE_S, os.kill, [process, signal.SIGCONT])

    def halt() -> None:
        os.kill(process, signal.SIGSTOP)
        going_on.start()

    halted = in_the_middle_of_a_move(loop, monkeypatch, halt)
    loop.controller.move(THERE, cycles=40, settle=2)
    assert halted
    going_on.join()
    assert loop.controller.joints == pytest.approx(THERE, abs=1e-6)
    assert loop.controller.worst_following == 0


@pytest.mark.full
def test_move_with_withheld_targets_is_repeated(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    loop.controller.move(HERE, cycles=6, settle=2)
    stranger = can.Message(arbitration_id=TARGET_IDS[0], data=bytes(8), is_extended_id=False)
    with can.Bus(interface="socketcan", channel=CONTROLLER_BUS) as bus:
        contradicted = in_the_middle_of_a_move(loop, monkeypatch, lambda: bus.send(stranger))
        loop.controller.move(THERE, cycles=40, settle=2)
    assert contradicted
    assert loop.controller.repeated_moves >= 1
    assert loop.controller.joints == pytest.approx(THERE, abs=1e-6)
    assert loop.controller.worst_following == 0


@pytest.mark.quick("offset")
def test_temperature_arrives_at_compensator_and_controller(loop: Loop) -> None:
    loop.operator.ask(wait=500.0)
    told = loop.operator.ask(wait=1.0)["temp_arm"]
    loop.controller.move(HERE, cycles=6, settle=2)
    heard = loop.controller.compensator.sdo[0x2020][1].raw
    assert heard == round(100 * told)
    assert loop.controller.temperatures_centi[0] == heard


@pytest.mark.quick("inline")
def test_drives_are_enabled_again_after_a_loss_of_power(loop: Loop) -> None:
    loop.controller.move(HERE, cycles=6, settle=2)
    loop.operator.ask(fault="power")
    loop.controller.enable()
    assert loop.controller.joints == pytest.approx(HERE, abs=1e-6), "they stand where they stood"
    loop.controller.move(THERE, cycles=6, settle=2)
    assert loop.controller.joints == pytest.approx(THERE, abs=1e-6)
    for drive in loop.controller.drives:
        assert drive.state == "OPERATION ENABLED"
        assert drive.sdo[0x6061].raw == 8, "cyclic synchronous position"
    loop.controller.disable()
    assert {drive.state for drive in loop.controller.drives} == {"SWITCH ON DISABLED"}


def held(loop: Loop) -> list[int]:
    """The offsets that the drives hold."""
    return [drive.sdo[0x60B0].raw for drive in loop.controller.drives]


@pytest.mark.full
@pytest.mark.parametrize("loop", ["offset"], indirect=True)
def test_offsets_survive_a_stopped_node_and_end_on_pre_operational(loop: Loop) -> None:
    compensator = loop.controller.compensator
    loop.controller.disable()
    loop.controller.wait_until_quiet()
    compensator.sdo.download(0x2010, 0, small_table(serial="loop", rate=200 << 12))  # 20 increments a cycle
    for word in (b"vrfy", b"cmit", b"actv", b"cfrm"):
        compensator.sdo.download(0x2012, 0, word)
    loop.controller.enable()
    loop.controller.move(HERE, cycles=6, settle=2)
    before = held(loop)
    assert max(map(abs, before)) > 50

    loop.node.stop()
    loop.controller.disable()
    assert held(loop) == before, "absolute, and nobody told the drives anything else"

    loop.node.start()
    loop.controller.configure_compensator("offset")
    loop.controller.enable()
    assert loop.controller.joints == pytest.approx(HERE, abs=1e-6)
    assert held(loop) == before, "nothing goes out before a set of targets"
    begun: list[tuple[int, ...]] = []
    loop.controller.network.subscribe(
        OFFSET_IDS[0], lambda _cob_id, data, _timestamp: begun.append(struct.unpack("<2i", data))
    )
    loop.controller.move(HERE, cycles=1, settle=0)
    assert begun
    assert np.abs(np.subtract(begun[0], before[:2])).max() <= 2, "it began with what the drives held"

    compensator.nmt.state = "PRE-OPERATIONAL"
    give_up = time.monotonic() + ANSWER_TIMEOUT_S
    while any(held(loop)) and time.monotonic() < give_up:
        loop.controller.catch_up()
    assert held(loop) == [0] * 6
