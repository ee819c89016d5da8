"""A minute of fuzzing over all readers, from the committed corpus: they may raise InputError only.

The harness also runs on its own, for any time: tests/fuzz/fuzz_readers.py.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.full  # tests/test_bad_input.py has one bad file of each kind

FUZZ = Path(__file__).parent / "fuzz"
SECONDS = {"csv": 12, "dataset": 12, "robot": 10, "urdf": 6, "model": 10, "expression": 6, "fit": 4}


@pytest.mark.parametrize("target", SECONDS)
def test_only_input_errors_escape(tmp_path: Path, target: str) -> None:
    found = tmp_path / "found"
    found.mkdir()
    corpus = FUZZ / "corpus" / target
    assert any(corpus.iterdir())
    run = subprocess.run(
        [
            sys.executable,
            str(FUZZ / "fuzz_readers.py"),
            target,
            f"-max_total_time={SECONDS[target]}",
            f"-dict={FUZZ / 'tokens.dict'}",
            f"-artifact_prefix={found}/",
            "-timeout=10",
            "-rss_limit_mb=2048",
            "-max_len=4096",
            "-seed=1",
            str(found),
            str(corpus),
        ],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=SECONDS[target] + 60,
    )
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    assert "Done" in run.stderr
