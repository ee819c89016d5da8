"""The decrease of the held-out error over the steps of a refinement, in the terminal."""

from __future__ import annotations

import textwrap
from typing import Any

from armtrue.candidates import name
from armtrue.cli.shared.output import Output
from armtrue.verdicts import ERROR_FIGURES, NOT_SCORED, scored

_HEADERS = (*ERROR_FIGURES.values(), "floor")
_FIGURE_WIDTH = 8
_WORDS_WIDTH = 32
_BAR_CELLS = (6, 20)


class Waterfall:
    """Held-out errors, the noise floor, a bar and what changed, printed as each step is finished.

    A bar's length is the mean error as a share of the first step's; `│` marks the noise floor.
    """

    def __init__(self, output: Output) -> None:
        self._output = output
        self._first_um = 0.0
        self._figures_width = 4 + len(_HEADERS) * _FIGURE_WIDTH
        free = output.console.width - self._figures_width - 4 - _WORDS_WIDTH
        self._cells = min(_BAR_CELLS[1], max(_BAR_CELLS[0], free))
        self.steps: list[dict[str, Any]] = []

    def add(self, step: dict[str, Any]) -> None:
        """Print the next step."""
        error = scored(step["error"]["held_out"])
        floor = step.get("noise_floor_um")
        if not self.steps:
            self._first_um = error["mean_um"] or 0.0
            self._output.say("Held-out error and noise floor [µm] after each step.")
            self._output.say("Bar: the mean as a share of the first step's; │: the noise floor.\n")
            headers = "".join(f"{header:>{_FIGURE_WIDTH}}" for header in _HEADERS)
            self._output.say(f"step{headers}  {'':{self._cells}}  what changed")
        figures = [*(error[key] for key in ERROR_FIGURES), floor]
        cells = ["–" if figure is None else f"{figure:.1f}" for figure in figures]
        row = f"{len(self.steps):>4}" + "".join(f"{cell:>{_FIGURE_WIDTH}}" for cell in cells)
        changed = self._changes(step) + ([NOT_SCORED] if error["mean_um"] is None else [])
        self._output.say(f"{row}  {self._bar(error['mean_um'], floor)}  {changed[0]}")
        for line in changed[1:]:
            self._output.say(" " * (self._figures_width + self._cells + 4) + line)
        self.steps.append(step)

    def _changes(self, step: dict[str, Any]) -> list[str]:
        """One line for each effect added or removed, wrapped to the width of the terminal."""
        changes = [f"+ {name(step['added'])}"] if step.get("added") else []
        changes += [f"− {name(removed)}" for removed in step.get("removed") or []]
        if not changes and not self.steps:
            changes = ["as it stood"]
        elif not changes:
            changes = ["no effect was added or removed"]
        width = max(16, self._output.console.width - self._figures_width - self._cells - 4)
        return [line for change in changes for line in textwrap.wrap(change, width, subsequent_indent="  ")]

    def _bar(self, mean_um: float | None, floor_um: float | None) -> str:
        per_cell = self._first_um / self._cells or 1.0
        length = 0 if mean_um is None else min(self._cells, max(1, round(mean_um / per_cell)))
        cells = list("█" * length + " " * (self._cells - length))
        if floor_um is not None and floor_um < self._first_um:
            cells[min(self._cells - 1, int(floor_um / per_cell))] = "│"
        return "".join(cells)
