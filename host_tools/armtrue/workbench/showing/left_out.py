"""Rows that the user left out, and the error there of the model fitted without them."""

from __future__ import annotations

from typing import Any

import numpy as np

from armtrue.comparing import prediction_error
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Dataset
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import micrometres
from armtrue.units import plural
from armtrue.workbench.session import Node
from armtrue.workbench.showing.elements import button
from armtrue.workbench.showing.words import length

_NAMED_ROWS = 30


def error_there(fit: Fit, data: Dataset, rows: list[int]) -> dict[str, Any] | None:
    """The error of the prediction at `rows` of the file of `data`; None where there are none, or no prediction: a
    reflector whose rows are all left out has no fitted offset on the tool.
    """
    there = data.take(np.isin(data.rows, rows))
    if not there.count:
        return None
    try:
        return prediction_error(fit.predict(there), there)
    except InputError:
        return None


def said_there(node: Node) -> str:
    """The error at the rows left out beside that of held-out poses, in a sentence."""
    figures = node.left_out_error
    if figures is None:
        return "The model says nothing of the rows left out: all rows of their reflector are."
    return (
        f"At the {plural(figures['n'], 'row')} left out, the prediction is off by {length(figures['mean_um'])} in the "
        f"mean and {length(figures['max_um'])} at most; at held-out poses by {length(node.mean_um)} in the mean."
    )


def left_out_part(node: Node, rejected: int) -> Markup:
    """Which rows are kept out, what the model predicts there, and the button that lets them take part."""
    content: list[Content] = []
    if rows := node.left_out:
        named = ", ".join(map(str, rows[:_NAMED_ROWS])) + (" and more" if len(rows) > _NAMED_ROWS else "")
        again = button("Let all rows take part again", "leave_out", rows="[]")
        by_you = f"{plural(len(rows), 'row')} left out by you: {named}."
        content += [tag("p", by_you), tag("p", said_there(node)), tag("p", again)]
    if rejected:
        content.append(tag("p", f"{plural(rejected, 'row')} kept out as gross errors."))
    return tag("div", content)


def left_out_row(node: Node, keys: list[str]) -> Markup | None:
    """The row of the table of errors for the rows left out; None where there are none, or no figures."""
    figures = node.left_out_error
    if figures is None:
        return None
    cells = [tag("td", micrometres(figures[key])) for key in keys]
    name = f"left out by you ({plural(figures['n'], 'row')})"
    return tag("tr", tag("th", name, scope="row"), cells)
