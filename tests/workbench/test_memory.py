"""The server's memory over a long session."""

from __future__ import annotations

import armtrue_sim
import pytest
from memory import ACTIONS, EVERY, POSES, held_over
from opened import TWO_HIDDEN

pytestmark = pytest.mark.full


def test_memory_is_flat_over_500_actions(start, tmp_path):
    """After the first hundred actions no more memory is held, though each hundred makes some fifty models."""
    armtrue_sim.simulate({**TWO_HIDDEN, "poses": POSES}).write(tmp_path / "campaign")
    workbench = start(tmp_path / "campaign" / "data.csv")
    held = held_over(workbench, ACTIONS, EVERY)
    assert len(held) == 5
    assert len(workbench.state()["models"]) > 200
    # Freed memory is returned in pieces: a figure may be 10 % above or below the others.
    assert min(held[-2:]) < 1.05 * max(held[:2]), held
