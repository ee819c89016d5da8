"""`armtrue device selftest` against a device whose tests fail: what it prints and its exit status."""

from __future__ import annotations

import json
from collections import deque

import can
import pytest
from armtrue.cli.app import app
from armtrue.device import connection
from armtrue.device.compensator import SELF_TESTS
from typer.testing import CliRunner

_RUN, _FAILED = b"\x30\x20\x01", b"\x30\x20\x03"
_PRODUCT = b"\x18\x10\x02"


class FakeDevice:
    """A compensator on a bus. `failed`: bits of the tests that fail; `refusal`: SDO abort code that refuses a run."""

    def __init__(self, failed: int, refusal: int = 0) -> None:
        self._values = {_PRODUCT: int.from_bytes(b"ARMT", "big"), _FAILED: 0}
        self._failed, self._refusal = failed, refusal
        self._answers: deque[bytes] = deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        command, place = msg.data[0], bytes(msg.data[1:4])
        if command == 0x40:
            self._answers.append(b"\x43" + place + self._values[place].to_bytes(4, "little"))
        elif self._refusal:
            self._answers.append(b"\x80" + place + self._refusal.to_bytes(4, "little"))
        else:
            assert (command, place, msg.data[4]) == (0x2F, _RUN, 0x1F)
            self._values[_FAILED] = self._failed
            self._answers.append(b"\x60" + place + bytes(4))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if not self._answers:
            return None
        return can.Message(arbitration_id=0x5A0, data=self._answers.popleft(), is_extended_id=False)

    def shutdown(self) -> None:
        """Nothing to close."""


def selftest(monkeypatch: pytest.MonkeyPatch, device: FakeDevice, *more: str) -> tuple[int, str]:
    monkeypatch.setattr(connection, "open_bus", lambda _: device)
    arguments = ["device", "selftest", "--interface", "virtual", "--channel", "none", *more]
    run = CliRunner().invoke(app, arguments)
    return run.exit_code, run.stdout


def test_selftest_exits_with_status_0_if_all_tests_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    status, printed = selftest(monkeypatch, FakeDevice(0))
    assert status == 0
    assert printed.count("passed") == len(SELF_TESTS)
    assert "FAILED" not in printed


@pytest.mark.parametrize("bit", range(len(SELF_TESTS)), ids=SELF_TESTS)
def test_selftest_names_the_failed_test_with_status_1(monkeypatch: pytest.MonkeyPatch, bit: int) -> None:
    status, printed = selftest(monkeypatch, FakeDevice(1 << bit))
    assert status == 1
    line = next(line for line in printed.splitlines() if SELF_TESTS[bit] in line)
    assert "FAILED" in line
    assert printed.count("FAILED") == 1

    status, printed = selftest(monkeypatch, FakeDevice(1 << bit), "--json", "-")
    assert status == 1
    assert [name for name, passed in json.loads(printed).items() if not passed] == [SELF_TESTS[bit]]


def test_selftest_refused_in_motion_exits_with_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    status, printed = selftest(monkeypatch, FakeDevice(0, refusal=0x08000022))
    assert status == 1
    assert "passed" not in printed
