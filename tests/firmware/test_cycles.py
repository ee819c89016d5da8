"""Recorded control cycles: the host library and the ARM image give the same 32-bit outputs, within the budget.

The recording moves a six-axis arm with every effect, tables and a grid through its limits while temperatures drift,
the payload changes, and tables are enabled, exchanged and disabled.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import arms
import budget
import numpy as np
import pytest
import recording
from armtrue.tables import ExportOptions, export
from armtrue.tables.image import Image

from tests import qemu

ROOT = Path(__file__).resolve().parents[2]
# With the tool's attitude held as well (`export --full-pose`): six equations instead of three.
POSE_BUDGET = 33_000
CYCLES = 10_000


def tables_for(name: str, full_pose: bool) -> tuple[bytes, bytes]:
    """Two tables of one arm: every effect with a grid, and other values without one."""
    first = export(arms.full_arm(name, grid_nodes=6), ExportOptions(blend_ms=200, full_pose=full_pose)).image
    second = export(
        arms.full_arm(name, seed=2), ExportOptions(blend_ms=300, sequence=1, full_pose=full_pose)
    ).image
    return first, second


def recorded(name: str, cycles: int, full_pose: bool = False) -> recording.Recording:
    """A recording of arm `name`; events are spread over its length."""
    arm = arms.full_arm(name, grid_nodes=6)
    first, second = tables_for(name, full_pose)
    increments = np.array([joint.increments for joint in Image(first).joints()])
    rng = np.random.default_rng(4)
    rows = recording.blank_cycles(cycles)
    n = arm.chain.joint_count
    path = recording.motion(arm.chain.limits, cycles, 1e-3, rng)
    rows["target"][:, :n] = np.round(path * increments)
    rows["temperature_mdegc"][:, 0] = 20_000 + np.linspace(0.0, 15_000, cycles)
    rows["temperature_valid"] = np.where(np.arange(cycles) % 997 == 0, 0, 1)
    rows["payload_g"] = np.where(np.arange(cycles) < cycles // 2, 0, 7_500)
    rows["time_ms"] = np.arange(cycles) * 400
    for at, request in (
        (20, recording.ACTIVATE_A),
        (cycles * 5 // 10, recording.ACTIVATE_B),
        (cycles * 5 // 10 + 60, recording.DISABLE),  # in mid-blend
        (cycles * 6 // 10, recording.ACTIVATE_A),
        (cycles * 9 // 10, recording.DISABLE),
    ):
        rows["request"][at] = request
    return recording.Recording(n, first, second, cycles=rows)


def on_host(made: recording.Recording, folder: Path) -> np.ndarray:
    """Play on the host with the release build's program."""
    subprocess.run(["cmake", "--build", "--preset", "release", "--target", "cycle_replay"], cwd=ROOT, check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    (folder / "in").write_bytes(made.to_bytes())
    subprocess.run(
        [ROOT / "build/release/firmware/replay/cycle_replay", folder / "in", folder / "out"], check=True
    )
    return recording.played((folder / "out").read_bytes())


def on_chip(made: recording.Recording) -> np.ndarray:
    """Play on the emulated STM32F405, counting instructions."""
    elf = qemu.build_images("stm32f405", "cycle_replay") / "cycle_replay.elf"
    run = qemu.run_image(elf, made.to_bytes(), timeout_s=240.0)
    assert run.status == 0, run.printed
    return recording.played(run.output)


@pytest.fixture(scope="module")
def kr30(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray, recording.Recording]:
    made = recorded("kr30", CYCLES)
    return on_host(made, tmp_path_factory.mktemp("kr30")), on_chip(made), made


def test_host_and_chip_agree_in_every_bit(kr30: tuple[np.ndarray, np.ndarray, recording.Recording]) -> None:
    host, chip, _ = kr30
    assert len(host) == len(chip) == CYCLES
    for field in ("corrected", "delta", "flags", "state"):
        assert np.array_equal(host[field], chip[field]), field


def test_recording_covers_every_state(kr30: tuple[np.ndarray, np.ndarray, recording.Recording]) -> None:
    host, _, made = kr30
    assert {recording.PASS_THROUGH, recording.BLENDING, recording.ACTIVE} == set(host["state"])
    assert np.abs(host["delta"][:, :6]).max() > 1000
    passing = host["state"] == recording.PASS_THROUGH
    assert np.array_equal(host["corrected"][passing][:, :6], made.cycles["target"][passing][:, :6])
    # No step anywhere: enabling, exchanging and disabling included.
    rate = 0.1 * 1e-3 * max(joint.increments for joint in Image(made.table_a).joints())
    assert np.abs(np.diff(host["delta"].astype(np.int64), axis=0)).max() <= rate + 2


def test_a_cycle_stays_within_the_budget(kr30: tuple[np.ndarray, np.ndarray, recording.Recording]) -> None:
    worst = int(kr30[1]["instructions"].max())
    check_budget("kr30", worst)


@pytest.mark.full
@pytest.mark.parametrize("full_pose", [False, True], ids=["position", "pose"])
@pytest.mark.parametrize("name", ["kr30", "irb2400", "cobot"])
def test_other_arms_agree_and_stay_within_the_budget(name: str, full_pose: bool, tmp_path: Path) -> None:
    made = recorded(name, 600, full_pose)
    host, chip = on_host(made, tmp_path), on_chip(made)
    for field in ("corrected", "delta", "flags", "state"):
        assert np.array_equal(host[field], chip[field]), field
    check_budget(name, int(chip["instructions"].max()), full_pose)


def check_budget(name: str, worst: int, full_pose: bool = False) -> None:
    """Check `worst` against the absolute budget and the recorded value."""
    assert worst <= (POSE_BUDGET if full_pose else budget.INSTRUCTIONS_A_CYCLE)
    budget.check(f"{name} with every effect, tables and grid{', full pose' if full_pose else ''}", worst)
