"""Scales and ticks of axes."""

import numpy as np
import pytest

from armtrue.report.scales import Scale, around, symmetric, tick_text


@pytest.mark.parametrize(
    "scale", [Scale(-3.7, 12.2), Scale(0.0, 0.0031), Scale(-90.0, 90.0), Scale(0.5, 600.0, True)]
)
def test_ticks_are_round_numbers_within_the_scale(scale):
    ticks = scale.ticks()
    assert 3 <= len(ticks) <= 12
    for tick in ticks:
        assert -1e-9 <= scale.share(tick) <= 1.0 + 1e-9
        assert len(tick_text(tick).strip("−0.").replace(".", "").rstrip("0")) <= 3


def test_share_runs_from_0_at_the_low_end_to_1_at_the_high_end():
    assert Scale(-2.0, 6.0).share(np.array([-2.0, 2.0, 6.0])).tolist() == [0.0, 0.5, 1.0]
    assert Scale(1.0, 100.0, logarithmic=True).share(10.0) == pytest.approx(0.5)


def test_scale_of_a_single_value_has_a_width():
    assert around(np.array([5.0, 5.0])).low < 5.0 < around(np.array([5.0, 5.0])).high
    assert symmetric(0.0).low == -1.0


@pytest.mark.parametrize(("value", "text"), [(-2.5, "−2.5"), (0.0, "0"), (3000.0, "3000"), (1e-6, "1e−06")])
def test_tick_text_has_the_unicode_minus_sign(value, text):
    assert tick_text(value) == text
