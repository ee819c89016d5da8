"""Printed text and the progress bar on one terminal."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from armtrue.cli.shared import output as module
from armtrue.cli.shared.output import Output, waiting


def test_text_during_the_progress_bar_starts_on_a_cleared_line(monkeypatch):
    monkeypatch.setattr(module, "_SHOW_PROGRESS_AFTER_S", -1.0)
    screen = io.StringIO()
    output = Output(None)
    output.console = Console(file=screen, force_terminal=True, width=100, color_system=None)
    with waiting(output) as progress:
        progress(0.5, "fitting")
        output.say("   1    50.9")
        progress(0.2, "fitting again")
    shown = screen.getvalue()
    assert "50 %" in shown
    assert re.search(r"\x1b\[2K   1    50\.9\n", shown)
    assert re.search(r"fitting again .* 20 %", shown)


def test_progress_bar_fits_in_80_columns_and_names_no_time_before_it_can_be_estimated(monkeypatch):
    monkeypatch.setattr(module, "_SHOW_PROGRESS_AFTER_S", -1.0)
    screen = io.StringIO()
    output = Output(None)
    output.console = Console(file=screen, force_terminal=True, width=80, color_system=None)
    with waiting(output) as progress:
        progress(0.1, "looking for periods and structure")
    shown = screen.getvalue()
    assert "--" not in shown
    assert "remaining" not in shown
    assert re.search("looking for periods and structure .* 10 % 0:00:00", shown)


def test_progress_bar_is_not_written_to_redirected_output(monkeypatch, capsys):
    monkeypatch.setattr(module, "_SHOW_PROGRESS_AFTER_S", -1.0)
    output = Output(None)
    with waiting(output) as progress:
        progress(0.5, "fitting")
        output.say("   1    50.9")
    assert capsys.readouterr().out == "   1    50.9\n"


@pytest.mark.parametrize("width", [120, 80, 68])
def test_tables_in_narrow_terminals_lose_no_name_and_no_figure(capsys, width):
    table = module.plain_table(
        "parameter", "increments per turn (m)", "one is [µm at tool]", "nominal", "note"
    )
    cells = (
        "link_geometry[5].tz",
        "265604300.8",
        "0.056",
        "350.000 mm",
        "tied to joint_offset[5] (+0.978), outside",
    )
    table.add_row(*cells)
    output = module.Output(None)
    output.console = Console(width=width, highlight=False)
    output.table(table)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    assert "…" not in "".join(lines)
    shown = " ".join(" ".join(lines).split())
    for word in " ".join(cells).split():
        assert word in shown
