"""Steps so large that no arm fits the whole file: from some row on, the frame or the reflector is another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.checking.hypotheses import Hypothesis
from armtrue.checking.placement import UNKNOWNS_OF_BASE, Reading, relaxed_system
from armtrue.checking.scatter.repeats import set_up_of_row
from armtrue.io.dataset import Dataset

# The relaxed problem has 12 unknowns on each side of a step and 3 for each tool: four equations for each of the 12.
_FEWEST_ROWS = 16
_RIDGE = 1e-9
_BASE = "station"
_TOOL = "target"


def hypotheses(data: Dataset, reading: Reading) -> Iterator[Hypothesis]:
    """The likeliest step of the measuring frame and that of the reflector; `reading` has the rows of `data`."""
    order = np.argsort(data.clock, kind="stable")
    for column in (_BASE, _TOOL):
        if column in reading.columns:
            continue  # the file itself names set-ups or reflectors
        at = _place(reading, order, column)
        if at is None:
            continue
        codes = np.zeros(data.count)
        codes[order[at:]] = 1.0
        first = int(data.rows[order[at]])
        yield _hypothesis(column, codes, first)


def _hypothesis(column: str, codes: Array, first: int) -> Hypothesis:
    if column == _BASE:
        code, cause = "base_step", "the measuring frame is displaced, as if tracker or base had been moved"
        remedy = (
            f"Increase the number in a column 'station' from row {first} on and add the effect station to the model, "
            "or fit the rows before and after separately."
        )
    else:
        code, cause = (
            "reflector_step",
            "the reflector is at another place on the arm, as if it had been exchanged",
        )
        remedy = (
            f"Give the rows from {first} on another name in a column 'target', or fit both parts separately."
        )
    return Hypothesis(
        code,
        f"from row {first} on {cause}",
        remedy,
        lambda reading: reading.with_columns(**{column: codes}),
        frozenset({column}),
        figures={"first_row": first},
    )


def _place(reading: Reading, order: NDArray[np.int64], column: str) -> int | None:
    """Index in `order` before which a step of `column` leaves the least residual of the relaxed problem."""
    count = len(order)
    if count < 2 * _FEWEST_ROWS:
        return None
    rows, right = relaxed_system(reading)
    rows, right = rows[order], right[order]
    bases = UNKNOWNS_OF_BASE * (int(set_up_of_row(reading.columns).max()) + 1)
    twice = slice(0, bases) if column == _BASE else slice(bases, rows.shape[2])
    stepped = rows[:, :, twice]
    # The design with a step repeats the columns `twice`, as zero in the rows before the step.
    square = np.einsum("nia,nib->ab", rows, rows)
    given = np.einsum("nia,ni->a", rows, right)
    shared = np.cumsum(np.einsum("nia,nib->nab", stepped, rows)[::-1], axis=0)[::-1]
    wanted = np.cumsum(np.einsum("nia,ni->na", stepped, right)[::-1], axis=0)[::-1]
    places = np.arange(_FEWEST_ROWS, count - _FEWEST_ROWS + 1)
    size, more = rows.shape[2], stepped.shape[2]
    normal = np.zeros((len(places), size + more, size + more))
    normal[:, :size, :size] = square
    normal[:, size:, :size] = shared[places]
    normal[:, :size, size:] = shared[places].transpose(0, 2, 1)
    normal[:, size:, size:] = shared[places][:, :, twice]
    sides = np.concatenate([np.tile(given, (len(places), 1)), wanted[places]], axis=1)
    ridge = _RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(size + more)
    solved = np.linalg.solve(normal + ridge, sides[:, :, None])[:, :, 0]
    return int(places[int(np.argmax(np.einsum("na,na->n", solved, sides)))])
