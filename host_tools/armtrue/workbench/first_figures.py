"""A model fitted to some of many measurements: the page shows its figures during the fit to all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armtrue.errors import InputError
from armtrue.fitting import Fit, with_effects
from armtrue.progress import Progress
from armtrue.report.gathered.thinning import spread_rows
from armtrue.workbench.session import Node

Entry = dict[str, Any]

# Up to this many rows the slowest effect of the catalogue is fitted in about a second; thirteen seconds at 12 000 rows.
_MANY_ROWS = 3000
_SOME_ROWS = 1000


@dataclass(frozen=True)
class FirstFigures:
    """A model that is not in the session yet. `of_all`: number of measurements in the fit that still runs."""

    node: Node
    fit: Fit
    of_all: int

    @property
    def words(self) -> str:
        """The number of measurements that the figures are from."""
        return f"from {self.fit.data.count} of {self.of_all} measurements; all are being fitted"

    @property
    def said(self) -> str:
        """The sentence about the error, marked as preliminary."""
        return f"First figures, {self.words}. {self.node.said}"


def fit_to_some(base: Fit, effects: list[Entry], progress: Progress) -> Fit | None:
    """`base` with these effects, fitted to measurements spread evenly through the file.

    None where all are few enough to be fitted quickly, or where the selected ones do not allow the model.
    """
    if base.data.count <= _MANY_ROWS:
        return None
    some = base.data.take(spread_rows(base.data.count, _SOME_ROWS))
    try:
        return with_effects(Fit(base.document, None, some), effects, progress)
    except InputError:
        return None
