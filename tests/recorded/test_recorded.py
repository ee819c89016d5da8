"""Results of the fitter are those that were recorded (fitter_results.py): a change of any is meant, or a fault."""

from __future__ import annotations

import json
from typing import Any

import fitter_results
import numpy as np
import pytest

RECORDED = json.loads(fitter_results.RECORDED.read_text())
# Relative to the RMS of an entry. Kernels of OpenBLAS for other processors differ by up to 2e-3.
SAME = 3e-3


def differences(found: dict[str, Any], expected: dict[str, Any]) -> list[str]:
    """A line for every path of which one of the two has no summary, or another one."""
    paths = sorted(found.keys() | expected.keys())
    return [
        f"{path}: {found.get(path)}, expected {expected.get(path)}"
        for path in paths
        if not _same(found.get(path), expected.get(path))
    ]


def _same(found: list[float] | None, expected: list[float] | None) -> bool:
    if found is None or expected is None or len(found) != len(expected) or found[0] != expected[0]:
        return False
    if len(found) == 2:
        return found[1] == expected[1]
    return bool(np.allclose(found[1:3], expected[1:3], rtol=0.0, atol=SAME * expected[2])) and (
        abs(found[3] - expected[3]) < SAME
    )


@pytest.mark.parametrize("name", fitter_results.campaigns())
def test_results_are_those_recorded(name: str) -> None:
    assert differences(fitter_results.summary(name), RECORDED[name]) == []


def test_comparison_sees_each_difference() -> None:
    said = {"errors": [1.0, 2.0, 3.0, 4.0], "words": ["bent by 3 µm"]}
    recorded = dict(fitter_results.summarised(said))
    assert differences(dict(fitter_results.summarised(said)), recorded) == []
    for changed in (
        {"errors": [1.1, 2.0, 3.0, 4.0], "words": ["bent by 3 µm"]},
        {"errors": [1.0, 2.0, 3.0], "words": ["bent by 3 µm"]},
        {"errors": [1.0, 2.0, 3.0, None], "words": ["bent by 3 µm"]},
        {"errors": [1.0, 2.0, 3.0, 4.0], "words": ["tilted by 3 µm"]},
        {"errors": [1.0, 2.0, 3.0, 4.0]},
    ):
        assert len(differences(dict(fitter_results.summarised(changed)), recorded)) == 1, changed
    assert dict(fitter_results.summarised(said | {"words": ["bent by 4 µm"]})) == recorded
