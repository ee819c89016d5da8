"""Conversion of real numbers to the firmware's integers: fraction bits, mantissas and shifts."""

from __future__ import annotations

import math

INT32_MAX = 2**31 - 1


def fraction_for(largest: float, most: int = 60) -> int:
    """Fraction bits with which numbers up to `largest` stay within 30 bits."""
    if largest <= 0.0 or not math.isfinite(largest):
        return 30
    return max(-30, min(most, 30 - math.frexp(largest)[1]))


def mantissa_and_shift(factor: float, least_shift: int = 1) -> tuple[int, int]:
    """`factor` as mantissa / 2^shift with a 30-bit mantissa where the shifts allow it.

    Raises OverflowError where the factor is too large for the least shift.
    """
    if factor == 0.0:
        return 0, least_shift
    shift = max(least_shift, min(62, 30 - math.frexp(abs(factor))[1]))
    mantissa = round(factor * 2.0**shift)
    if abs(mantissa) > INT32_MAX:
        raise OverflowError(f"{factor} does not fit a mantissa with a shift of {shift}")
    return mantissa, shift


def to_fixed(value: float, fraction: int) -> int:
    """`value` · 2^fraction, rounded. Raises OverflowError beyond 32 bits."""
    result = round(value * 2.0**fraction)
    if abs(result) > INT32_MAX:
        raise OverflowError(f"{value} does not fit 32 bits with {fraction} fraction bits")
    return result


def wrapped_angle(turns: float) -> int:
    """An angle in turns as a signed 32-bit binary angle."""
    raw = round((turns % 1.0) * 2.0**32) % 2**32
    return raw - 2**32 if raw >= 2**31 else raw
