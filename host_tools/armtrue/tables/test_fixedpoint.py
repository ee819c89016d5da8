"""Fixed-point fractions, mantissas and angles."""

from __future__ import annotations

import pytest

from armtrue.tables.fixedpoint import fraction_for, mantissa_and_shift, to_fixed, wrapped_angle


def test_fractions_fill_thirty_bits() -> None:
    for largest in (1e-9, 3e-5, 0.5, 1.0, 1.5, 700.0, 1e6):
        fraction = fraction_for(largest)
        assert largest * 2.0**fraction < 2**30
        assert fraction == 60 or largest * 2.0 ** (fraction + 1) >= 2**29


def test_mantissas_keep_thirty_bits_where_shifts_allow() -> None:
    for factor in (1e-12, 1e-3, 0.7, 1.0, 123.456, 1e6):
        mantissa, shift = mantissa_and_shift(factor)
        assert 1 <= shift <= 62
        assert mantissa * 2.0**-shift == pytest.approx(factor, rel=2.0**-28 if factor > 1e-9 else 1e-5)
    with pytest.raises(OverflowError):
        mantissa_and_shift(2.0**31)
    assert mantissa_and_shift(0.0)[0] == 0


def test_overflow_raises() -> None:
    with pytest.raises(OverflowError):
        to_fixed(16.0, 27)


def test_angles_wrap_at_half_a_turn() -> None:
    assert wrapped_angle(0.25) == 2**30
    assert wrapped_angle(-0.25) == -(2**30)
    assert wrapped_angle(1.0) == 0
    assert wrapped_angle(0.5) == -(2**31)
