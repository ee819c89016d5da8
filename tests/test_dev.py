"""The harness of `./dev test`: which steps a level runs, and that no failure is lost."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Installing and building are not tested here.
STUBS = "install_packages() { :; }\nensure_venv() { :; }\nconfigure() { :; }\nbuild_preset() { :; }\n"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with `dev` and the command `test`, and no steps."""
    shutil.copy(ROOT / "dev", tmp_path)
    (tmp_path / "tools/dev.d").mkdir(parents=True)
    (tmp_path / "tools/test.d").mkdir()
    shutil.copy(ROOT / "tools/dev.d/test.sh", tmp_path / "tools/dev.d")
    (tmp_path / "tools/dev.d/zz-stubs.sh").write_text(STUBS)
    return tmp_path


def dev_test(checkout: Path, *words: str, **steps: str) -> subprocess.CompletedProcess[str]:
    for name, text in steps.items():
        (checkout / f"tools/test.d/{name.replace('__', '.')}.sh").write_text(text)
    command = [str(checkout / "dev"), "test", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_first_failing_command_of_a_step_fails_the_run(checkout: Path) -> None:
    done = dev_test(checkout, one="false\necho went on", two="echo second step")
    assert done.returncode == 1
    assert "went on" not in done.stdout
    assert "second step" in done.stdout
    assert "FAILED: one" in done.stdout


def test_steps_that_succeed_end_with_success(checkout: Path) -> None:
    done = dev_test(checkout, one="true", two="true")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all steps passed" in done.stdout


@pytest.mark.parametrize(
    ("words", "ran"),
    [((), "quick"), (("full",), "quick long"), (("long",), "long"), (("full", "short"), "quick")],
)
def test_level_chooses_the_steps(checkout: Path, words: tuple[str, ...], ran: str) -> None:
    steps = {"1-short": "echo ran-quick", "2-long__full": "echo ran-long"}
    done = dev_test(checkout, *words, **steps)
    assert [line for line in done.stdout.split() if line.startswith("ran-")] == [
        f"ran-{name}" for name in ran.split()
    ]


def test_unknown_step_is_refused(checkout: Path) -> None:
    assert dev_test(checkout, "absent", one="true").returncode == 2
