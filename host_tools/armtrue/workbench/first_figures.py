"""A model fitted to some of many measurements: its figures stand on the page while it is fitted to all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armtrue.errors import InputError
from armtrue.fitting import Fit, with_effects
from armtrue.progress import Progress
from armtrue.report.gathered.thinning import spread_rows
from armtrue.workbench.session import Node

Entry = dict[str, Any]

# Up to here the slowest effect of the catalogue is fitted in about a second; at 12 000 measurements it takes thirteen.
_MANY_ROWS = 3000
_SOME_ROWS = 1000


@dataclass(frozen=True)
class FirstFigures:
    """A model that is no part of the session yet. `of_all`: how many measurements it is being fitted to meanwhile."""

    node: Node
    fit: Fit
    of_all: int

    @property
    def words(self) -> str:
        """From how many measurements they are."""
        return f"from {self.fit.data.count} of {self.of_all} measurements; all are being fitted"

    @property
    def said(self) -> str:
        """The sentence about the error, and that it is not the last word."""
        return f"First figures, {self.words}. {self.node.said}"


def fit_to_some(base: Fit, effects: list[Entry], progress: Progress) -> Fit | None:
    """`base` with these effects, fitted to measurements spread evenly through the file.

    None where there are so few that fitting all is as quick, or where some cannot carry the model.
    """
    if base.data.count <= _MANY_ROWS:
        return None
    some = base.data.take(spread_rows(base.data.count, _SOME_ROWS))
    try:
        return with_effects(Fit(base.document, None, some), effects, progress)
    except InputError:
        return None
