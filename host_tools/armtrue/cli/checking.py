"""The command check."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer
from rich.table import Table

from armtrue.cli.shared.fits import load_measurements
from armtrue.cli.shared.options import DataArgument, JsonOption, RobotOption, SkipBadOption
from armtrue.cli.shared.output import Output
from armtrue.io import load_robot

if TYPE_CHECKING:
    from armtrue.checking import Finding

_MARKS = {"error": "✗ error", "warning": "! warning", "note": "· note"}


def check(
    data: DataArgument,
    robot: RobotOption,
    skip_bad: SkipBadOption = False,
    json_to: JsonOption = None,
) -> None:
    """Check measurements for mistakes before a fit: units, signs, coupling, read-back, duplicates, drift,
    a tracker or reflector that was moved half way.

    States what the data can and cannot determine. Exit status 1 where an error was found.

    Example: armtrue check data.csv --robot robot.yaml
    """
    from armtrue.checking import check as run_check

    output = Output(json_to)
    arm = load_robot(robot)
    measurements = load_measurements(data, arm, [json_to], skip_bad=skip_bad, strict=False)
    report = run_check(measurements, arm)
    output.table(_findings_table(report.findings))
    output.say(f"\n{report.summary()}")
    output.figures(report.document())
    if report.has_errors:
        raise typer.Exit(1)


def _findings_table(findings: list[Finding]) -> Table:
    """One row per finding; a remedy that several findings share is printed once, under the last of them."""
    table = Table.grid(padding=(0, 2))
    for number, finding in enumerate(findings):
        table.add_row(_MARKS[finding.severity], finding.code, finding.message)
        following = findings[number + 1 :]
        if finding.remedy and all(finding.remedy != other.remedy for other in following):
            table.add_row("", "", f"→ {finding.remedy}")
    return table
