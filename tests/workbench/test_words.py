"""Sentences of the workbench about errors, in particular where no pose could be scored."""

from __future__ import annotations

import pytest
from armtrue.workbench.showing.words import fall_words, first_words, length


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (200.0, 100.0, "The held-out mean error fell from 200.0 to 100.0 µm (−50 %)."),
        (100.0, 110.0, "The held-out mean error rose from 100.0 to 110.0 µm (+10 %)."),
        (100.0, 100.1, "The held-out mean error stays at 100.1 µm."),
        (100.0, None, "The held-out error is not scored: no pose could be held out of this model."),
        (None, 50.0, "The held-out mean error is 50.0 µm; before it was not scored."),
    ],
)
def test_change_of_the_error_is_stated_in_one_sentence(before, after, said):
    assert fall_words(before, after) == said


def test_model_that_was_not_scored_has_no_figure():
    assert length(None) == "not scored"
    assert "not scored" in first_words(None)
