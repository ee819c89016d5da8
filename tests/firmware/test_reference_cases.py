"""The cases that firmware/core/evaluation/reference_test.cc reads are those that the generator makes."""

from __future__ import annotations

import numpy as np
import pytest
import reference_cases


@pytest.mark.quick("kr30_pose", "at_command", "tables", "nodes")
@pytest.mark.parametrize("name", list(reference_cases.documents()))
def test_reference_cases_are_up_to_date(name: str) -> None:
    arm, full_pose = reference_cases.documents()[name]
    made = reference_cases.file_of(arm, full_pose)
    kept = (reference_cases.FOLDER / f"{name}.bin").read_bytes()
    assert len(made) == len(kept), (
        "python tests/firmware/reference_cases.py firmware/core/evaluation/reference"
    )
    head = 16 + int.from_bytes(made[:4], "little")
    assert made[:head] == kept[:head], (
        "python tests/firmware/reference_cases.py firmware/core/evaluation/reference"
    )
    # Another numpy may round the last bit of an angle or of a correction the other way.
    words = [np.frombuffer(data[head:], "<i4").astype(np.int64) for data in (made, kept)]
    assert np.abs(words[0] - words[1]).max() <= 1
