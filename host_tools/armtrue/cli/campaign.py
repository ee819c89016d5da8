"""The command simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from armtrue.cli.shared.output import Output
from armtrue.errors import InputError


def simulate(
    scenario: Annotated[
        Path,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario file, or the name of a shipped one, such as kr30-eccentric-gear.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write.")],
) -> None:
    """Simulate a campaign with known truth: robot.yaml, model.yaml, data.csv, test.csv and hidden.json.

    It shows what a campaign can determine before anything is measured; the same scenario gives the same files.

    Example: armtrue simulate kr30-eccentric-gear --out kr30
    """
    import armtrue_sim

    try:
        armtrue_sim.cli_simulate(scenario, out)
    except armtrue_sim.ScenarioError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{error.filename or out}: cannot be written ({error.strerror})") from None
    Output(None).say(f"written: {out}")
