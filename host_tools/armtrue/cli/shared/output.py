"""Output of commands: tables for people, JSON for programs, progress of long work."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.progress import BarColumn, Progress, Task, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from armtrue import progress as progress_protocol
from armtrue.io.files import write_file

# A pipe has no width of its own; tables cut at 80 columns would lose figures.
_WIDTH_OF_A_PIPE = 120
_FIELD_WIDTH = 20
# Spaces that Rich counts for each column beside its content.
_GAP = 2
_SHOW_PROGRESS_AFTER_S = 1.0
# Stage, bar, share and times fit into 80 columns.
_BAR_WIDTH = 16
STANDARD_OUTPUT = "-"


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Raise BrokenPipeError: Rich by itself would end with exit status 1, which means a refusal here."""
        raise BrokenPipeError


class Output:
    """Destination of one command's text and figures. `json_to`: the value of --json."""

    def __init__(self, json_to: str | None) -> None:
        self._json_to = json_to
        width = None if sys.stdout.isatty() else _WIDTH_OF_A_PIPE
        self.console = _Console(
            width=width, highlight=False, markup=False, soft_wrap=False, quiet=json_to == STANDARD_OUTPUT
        )

    @property
    def is_watched(self) -> bool:
        """True if the printed text goes to a terminal."""
        return self.console.is_terminal and not self.console.quiet

    def say(self, text: str = "") -> None:
        """Print a line for people."""
        self.console.print(text)

    def line(self, text: str) -> None:
        """Print a command to paste: never broken, however narrow the terminal."""
        self.console.print(text, soft_wrap=True)

    def title(self, text: str) -> None:
        """Print a heading for people."""
        self.console.print(f"\n{text}", style="bold")

    def items(self, lines: list[str], title: str = "") -> None:
        """Print sentences as a list below their title, long ones with their continuation indented."""
        if not lines:
            return
        if title:
            self.title(title)
        grid = Table.grid(padding=(0, 1))
        for line in lines:
            grid.add_row("  ·", line)
        self.console.print(grid)

    def fields(self, pairs: list[tuple[str, str]]) -> None:
        """Print names and their values, in two columns."""
        grid = Table.grid(padding=(0, 2))
        grid.add_column(min_width=_FIELD_WIDTH)
        for name, text in pairs:
            grid.add_row(name, text)
        self.console.print(grid)

    def table(self, table: Table) -> None:
        """Print a table for people; in a narrow terminal its cells break between words, and none is cut."""
        if table.show_header:
            _fit(table, self.console.width)
        self.console.print(table)

    def figures(self, document: Mapping[str, Any]) -> None:
        """Write the figures to the destination given by --json; nothing without it."""
        if self._json_to is None:
            return
        text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        if self._json_to == STANDARD_OUTPUT:
            sys.stdout.write(text)
        else:
            write_file(Path(self._json_to), text)


def plain_table(*headers: str) -> Table:
    """A table with text in the first column and figures in the others."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for number, header in enumerate(headers):
        table.add_column(header, justify="left" if number == 0 else "right", no_wrap=number > 0)
    return table


def _fit(table: Table, width: int) -> None:
    """Give the columns of a `plain_table` widths that add up to `width` if the table is wider.

    Rich itself shortens every column alike, which cuts names to `par…` or to nothing.
    """
    texts = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    full = [max(cell_len(line) for text in column for line in text.split("\n")) for column in texts]
    spare = width - _GAP * len(full)
    if sum(full) <= spare:
        return
    widths = [
        max((cell_len(word) for text in column for word in text.split()), default=1) for column in texts
    ]
    while sum(widths) > spare and max(widths) > 1:  # no room for the longest words: they are folded
        widths[widths.index(max(widths))] -= 1
    while sum(widths) < spare:
        lacking = [wanted - given for wanted, given in zip(full, widths, strict=True)]
        widths[lacking.index(max(lacking))] += 1
    for column, own in zip(table.columns, widths, strict=True):
        column.width, column.no_wrap, column.overflow = own, False, "fold"


class _Remaining(TimeRemainingColumn):
    def render(self, task: Task) -> Text:
        """The remaining time, once it can be estimated."""
        return Text("") if task.time_remaining is None else Text("remaining ") + super().render(task)


@contextmanager
def waiting(output: Output) -> Iterator[progress_protocol.Progress]:
    """Yield a progress callback; after one second, a bar with the remaining time is shown below the printed text.

    The bar is on stderr if `output` does not go to a terminal.
    """
    bar = Progress(
        "{task.description}",
        BarColumn(_BAR_WIDTH),
        "{task.percentage:.0f} %",
        TimeElapsedColumn(),
        _Remaining(),
        # One console for both, so that a line printed meanwhile goes above the bar and not into it.
        console=output.console if output.is_watched else Console(stderr=True),
        transient=True,
    )
    started = time.monotonic()
    task = bar.add_task("", total=1.0)
    done = 0.0
    shown = False

    def report(share: float, stage: str) -> None:
        nonlocal shown, done
        if not shown and time.monotonic() - started > _SHOW_PROGRESS_AFTER_S:
            bar.start()
            shown = True
        if share < done:  # the next round of the same work
            bar.reset(task, description=stage)
        done = share
        bar.update(task, completed=share, description=stage, refresh=shown)

    try:
        yield report
    finally:
        if shown:
            bar.stop()
