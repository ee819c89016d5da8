"""The rig returns status and output of its command; an unavailable bus is an error."""

from __future__ import annotations

import math
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import rig
from rig import CanUnavailableError, buses, has_native_can, run_on_bus, uml


def test_exit_status_and_environment_are_passed_through(tmp_path: Path) -> None:
    seen = tmp_path / "seen"
    script = f'ip -br link show vcan1 > {seen} && [ "$FLAVOUR" = sour ] && exit 7'
    assert run_on_bus(["bash", "-c", script], 120.0, {"FLAVOUR": "sour"}) == 7
    assert "UP" in seen.read_text()


def test_all_printed_and_written_output_arrives(tmp_path: Path) -> None:
    written = tmp_path / "written"
    script = f"seq 1 20000 | tee {written}; echo the end"
    command = [sys.executable, "-m", "rig", "--timeout", "120", "--", "bash", "-c", script]
    done = subprocess.run(
        command, cwd=Path(rig.__file__).parents[1], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [*map(str, range(1, 20001)), "the", "end"]
    assert written.read_text().split() == [*map(str, range(1, 20001))]


def test_machines_are_spread_over_the_allowed_processors() -> None:
    ours = [str(number) for number in sorted(os.sched_getaffinity(0))]
    assert sorted(uml._one_processor() for _ in ours) == sorted(ours)


@pytest.mark.full
def test_wide_registers_workaround_keeps_results_correct(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """On a processor with AMX the first process inside died; elsewhere the workaround must do no harm."""
    monkeypatch.setattr(uml, "_has_wide_registers", lambda: True)
    sums = tmp_path / "sums"
    # Two processes of floating-point work whose registers are saved and restored against each other.
    work = shlex.join(["awk", 'BEGIN { for (i = 1; i < 400000; ++i) s += 1 / i; printf "%.12f\\n", s }'])
    script = f"({work} & {work}; wait) > {sums}"
    assert uml.run_in_uml(["bash", "-c", script], 120.0) == 0
    first, second = sums.read_text().split()
    assert first == second
    assert float(first) == pytest.approx(math.log(400000) + 0.5772156649, abs=1e-5)


def test_wide_registers_without_a_compiler_are_an_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(uml, "_has_wide_registers", lambda: True)
    monkeypatch.setattr(uml, "KERNEL", sys.executable)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CanUnavailableError, match="install gcc"):
        uml.run_in_uml(["true"], 10.0)


@pytest.mark.full
def test_hanging_command_is_ended() -> None:
    with pytest.raises(TimeoutError, match="sleep 600"):
        run_on_bus(["sleep", "600"], 4.0)


def test_absent_kernel_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nonexistent")
    with pytest.raises(CanUnavailableError, match="user-mode-linux"):
        uml.run_in_uml(["true"], 5.0)


def test_absent_modules_are_an_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(uml, "MODULE_ROOT", tmp_path)
    with pytest.raises(CanUnavailableError, match="no kernel modules"):
        uml.run_in_uml(["true"], 5.0)


def test_interface_that_cannot_be_made_is_named() -> None:
    name = "a-name-too-long-for-linux"
    with pytest.raises(CanUnavailableError, match=name):
        buses.ensure_buses((name,))


def test_native_detection_agrees_with_the_kernel() -> None:
    listed = any(line.startswith("CAN ") for line in Path("/proc/net/protocols").read_text().splitlines())
    assert has_native_can() or not listed
