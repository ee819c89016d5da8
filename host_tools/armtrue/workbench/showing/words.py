"""Sentences about changes, errors and rows; without a figure where no pose could be scored."""

from __future__ import annotations

from typing import Any

from armtrue.candidates import name
from armtrue.report.parts import minus
from armtrue.units import plural
from armtrue.verdicts import NOT_SCORED

_SAME_PERCENT = 0.5
_NAMED_ROWS = 5


def length(mean_um: float | None) -> str:
    """A mean error with its unit, or that there is none."""
    return NOT_SCORED if mean_um is None else f"{mean_um:.1f} µm"


def fall_words(before_um: float | None, after_um: float | None) -> str:
    """How the held-out error changed."""
    if after_um is None:
        return "The held-out error is not scored: no pose could be held out of this model."
    if before_um is None:
        return f"The held-out mean error is {after_um:.1f} µm; before it was not scored."
    share = 100.0 * (after_um / before_um - 1.0) if before_um else 0.0
    if abs(share) < _SAME_PERCENT:
        return f"The held-out mean error stays at {after_um:.1f} µm."
    figures = f"from {before_um:.1f} to {after_um:.1f} µm"
    change = minus(f"{share:+.0f} %")
    return f"The held-out mean error {'fell' if share < 0 else 'rose'} {figures} ({change})."


def first_words(mean_um: float | None) -> str:
    """The sentence about the first model."""
    if mean_um is None:
        return f"The model is fitted. {fall_words(None, None)}"
    return f"The model is fitted. The held-out mean error is {mean_um:.1f} µm."


def change_words(added: list[dict[str, Any]], removed: list[dict[str, Any]]) -> str:
    """`added gear_harmonics 3; removed backlash 2`."""
    return "; ".join(
        [f"added {name(entry)}" for entry in added] + [f"removed {name(entry)}" for entry in removed]
    )


def rows_words(rows: list[int], before: list[int] | None) -> str:
    """How the left-out rows differ from the model before; `before` is None for the first model."""
    if before is None:
        return "first model"
    if rows == before:
        return "the same effects, fitted again"
    words = ", ".join(map(str, rows[:_NAMED_ROWS])) + (" and more" if len(rows) > _NAMED_ROWS else "")
    return f"left out: {plural(len(rows), 'row')} ({words})" if rows else "all rows take part again"
