"""The commands diagnose, refine and report."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Annotated, Any

import typer

from armtrue.candidates import name
from armtrue.cli.shared.findings import present_added, present_diagnosis
from armtrue.cli.shared.fits import load_with_data
from armtrue.cli.shared.options import FitArgument, JsonOption, MovedDataOption, OutOption
from armtrue.cli.shared.output import Output, waiting
from armtrue.verdicts import ERROR_FIGURES, NOT_SCORED, scored


def diagnose(fit_file: FitArgument, data: MovedDataOption = None, json_to: JsonOption = None) -> None:
    """Name the physical effect that a fit lacks, its joint, its probability, and alternative explanations.

    Example: armtrue diagnose fit.json
    """
    from armtrue import diagnosis

    output = Output(json_to)
    fit = load_with_data(fit_file, data, [json_to])
    with waiting(output) as progress:
        result = diagnosis.diagnose(fit, progress=progress)
    present_diagnosis(result, output, fit_file, data)
    output.figures(result)


def refine(
    fit_file: FitArgument, out: OutOption, data: MovedDataOption = None, json_to: JsonOption = None
) -> None:
    """Diagnose and add until nothing is missing, printing how the error falls step by step.

    Interrupted (Ctrl-C), the last finished step is kept in FILE, and --json holds those finished, "interrupted": true.

    Example: armtrue refine fit.json --out best.json
    """
    from armtrue import diagnosis, fitting

    output = Output(json_to)
    fit = load_with_data(fit_file, data, [out, json_to])
    waterfall = Waterfall(output)

    def keep(fit_so_far: fitting.Fit, step: dict[str, Any]) -> None:
        fit_so_far.save(out)
        waterfall.add(step)

    try:
        with waiting(output) as progress:

            def tell(share: float, stage: str) -> None:
                progress(share, "fitting again" if share >= 1.0 else stage)

            refined, result = diagnosis.refine(fit, progress=tell, on_step=keep)
    except KeyboardInterrupt:
        if not waterfall.steps:
            output.say("\nstopped: no step was finished, nothing is written")
            raise
        effects = waterfall.steps[-1]["effects"]
        output.figures({"steps": waterfall.steps, "effects": effects, "interrupted": True})
        output.say(f"\nstopped: {out} holds the last finished step")
        raise
    refined.save(out)
    if result.get("steps"):
        present_added(result, output)
        present_diagnosis(result["steps"][-1], output, out, data)
    output.items(refined.document["warnings"], "Warnings")
    output.say(f"\nwritten: {out}")
    output.figures(result)


def report(
    fit_files: Annotated[list[Path], typer.Argument(metavar="FIT…", help="Fits, first to last step.")],
    out: OutOption,
    data: MovedDataOption = None,
) -> None:
    """Write one self-contained HTML page: where it fails, what is missing, how the error fell.

    Example: armtrue report fit.json best.json --out report.html
    """
    from armtrue import report as report_writer

    fits = [load_with_data(path, data, [out]) for path in fit_files]
    output = Output(None)
    with waiting(output) as progress:
        report_writer.write(fits, out, progress)
    output.say(f"written: {out}")


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
