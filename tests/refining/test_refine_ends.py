"""`armtrue refine` beside busy processors, with a terminal and without; callbacks; and Ctrl-C at any moment."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import armtrue
import numpy as np
import pytest
from armtrue import _core
from armtrue_sim.campaign import Campaign, simulate
from armtrue_sim.cases import hidden_cases
from armtrue_sim.kinds import ARMS

TIME_LIMIT_S = 300.0  # a refinement takes seconds; beside other tests on two processors ten times that
ANSWER_S = 1.0
# A campaign that takes many seconds to refine.
LARGE = {
    "name": "large",
    "arm": "kr30",
    "poses": 1500,
    "instrument": {"sigma": 8e-6},
    "believed": ["base_frame", "tool_offset", "joint_offset", "link_geometry"],
    "hidden": ["joint_compliance", {"effect": "gear_harmonics", "joints": [3]}, "thermal_expansion"],
}


@pytest.fixture
def busy_processors():
    """Two busy loops, so that the command's threads are preempted at any point."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


def write_fit(folder: Path, campaign: Campaign) -> None:
    """Write a campaign and fit.json of its believed model."""
    campaign.write(folder)
    robot = armtrue.load_robot(folder / "robot.yaml")
    data = armtrue.load_data(folder / "data.csv", robot)
    armtrue.fit(data, robot, armtrue.load_model(folder / "model.yaml", robot)).save(folder / "fit.json")


def start_refine(folder: Path, out: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "armtrue", "refine", "fit.json", "--out", "best.json"]
    # Tests started in the background may inherit an ignored SIGINT.
    return subprocess.Popen(
        command,
        cwd=folder,
        stdout=out,
        stderr=out,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def refine(folder: Path, terminal: bool) -> int:
    """Exit status of the command; raises if it does not end within the time limit."""
    read, write = pty.openpty() if terminal else os.pipe()

    def drain() -> None:
        try:
            while os.read(read, 65536):
                pass
        except OSError:  # the terminal's other side is closed
            pass

    process = start_refine(folder, write)
    os.close(write)
    reader = threading.Thread(target=drain)
    reader.start()
    try:
        return process.wait(TIME_LIMIT_S)
    finally:
        process.kill()
        process.wait()
        reader.join()
        os.close(read)


def refine_campaigns(folder: Path, seeds: range, kind: str) -> None:
    for seed in seeds:
        made = folder / str(seed)
        write_fit(made, hidden_cases(kind, ARMS[seed % len(ARMS)], 40000 + seed).campaign)
        assert refine(made, terminal=seed % 2 == 0) == 0
        assert (made / "best.json").exists()


def test_refine_beside_busy_processors_ends(tmp_path, busy_processors):
    refine_campaigns(tmp_path, range(1), "three_at_sixty_poses")


@pytest.mark.full
def test_fifty_refinements_beside_busy_processors_end(tmp_path, busy_processors):
    refine_campaigns(tmp_path, range(1, 51), "three_hidden")


def arguments(kind: str, seed: int) -> tuple[str, dict[str, np.ndarray], str]:
    case = hidden_cases(kind, "cobot", seed)
    columns = {name: np.ascontiguousarray(values, dtype=float) for name, values in case.campaign.data.items()}
    return json.dumps(case.campaign.robot), columns, json.dumps({"effects": case.believed})


@pytest.mark.full
def test_progress_calls_end_and_run_on_the_callers_thread():
    callers = set()

    def tell(share: float, stage: str) -> None:
        callers.add(threading.get_ident())

    fit = _core.fit(*arguments("three_hidden", 3), "{}", tell)
    assert json.loads(_core.diagnose(fit, tell))["verdict"] == "missing_effect"
    _core.refine(fit, None, tell)
    assert callers == {threading.get_ident()}


class CallbackError(Exception):
    pass


def test_callback_error_ends_the_call_and_reaches_the_caller():
    def fail(*_: object) -> None:
        raise CallbackError

    fit = _core.fit(*arguments("three_hidden", 3))
    for call in (
        lambda: _core.fit(*arguments("three_hidden", 3), "{}", fail),
        lambda: _core.diagnose(fit, fail),
        lambda: _core.refine(fit, None, fail),
        lambda: _core.refine(fit, fail),
    ):
        with pytest.raises(CallbackError):
            call()


def test_other_threads_run_during_a_call():
    """The binding releases the interpreter lock (GIL) while it computes."""
    given = arguments("three_hidden", 3)
    counted, stop = 0, threading.Event()

    def count() -> None:
        nonlocal counted
        while not stop.wait(0.001):
            counted += 1

    counter = threading.Thread(target=count)
    counter.start()
    started = time.monotonic()
    _core.diagnose(_core.fit(*given))
    took = time.monotonic() - started
    stop.set()
    counter.join()
    assert counted > 20 * took


def processor_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.full
def test_interrupt_at_any_moment_is_answered_within_a_second(tmp_path):
    """A second of processor time, so that other load on this machine makes no difference."""
    write_fit(tmp_path, simulate({**LARGE, "seed": 1}))
    process = start_refine(tmp_path, subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0
    whole = usage.ru_utime + usage.ru_stime
    answered_in = []
    for share in (0.2, 0.35, 0.5, 0.65, 0.8):
        after = share * whole
        process = start_refine(tmp_path, subprocess.DEVNULL)
        while processor_seconds(process.pid) < after:
            assert process.poll() is None
            time.sleep(0.01)
        used = processor_seconds(process.pid)
        process.send_signal(signal.SIGINT)
        _, status, usage = os.wait4(process.pid, 0)
        assert os.waitstatus_to_exitcode(status) == 130
        answered_in.append(usage.ru_utime + usage.ru_stime - used)
    assert max(answered_in) < ANSWER_S
