"""The order of the C++ folders, and that an include against it is found."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from include_order import violations  # noqa: E402


@pytest.mark.parametrize(
    ("file", "included", "wrong"),
    [
        ("firmware/storage/a.cc", "firmware/core/b.h", False),
        ("firmware/core/a.cc", "firmware/storage/b.h", True),
        ("firmware/core/evaluation/a.cc", "firmware/core/table/b.h", False),
        ("firmware/core/table/a.cc", "firmware/core/compensator.h", True),
        ("firmware/canopen/motion/a.cc", "firmware/canopen/table/b.h", True),
        ("firmware/core/a.cc", "firmware/testing/b.h", True),
        ("firmware/core/a.cc", "fitter/model/b.h", True),
        ("firmware/core/a_test.cc", "firmware/testing/b.h", False),
        ("fitter/model/a.h", "fitter/solve/b.h", True),
        ("firmware/novel/a.cc", "firmware/core/b.h", True),
    ],
)
def test_include_against_the_order_is_found(tmp_path: Path, file: str, included: str, wrong: bool) -> None:
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(f'#include <vector>\n#include "{included}"\n')
    assert bool(violations(tmp_path)) is wrong
