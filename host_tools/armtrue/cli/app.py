"""The command line: its commands, and what becomes of errors (exit 2: the input is at fault; 130: interrupted)."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import click
import typer

import armtrue
from armtrue.cli import (
    INTERRUPTED,
    campaign,
    catalogue,
    checking,
    diagnosis,
    fitting,
    init,
    planning,
    predicting,
    workbench,
)
from armtrue.cli.guard import GuardedGroup
from armtrue.device import cli as device
from armtrue.errors import InputError
from armtrue.tables import cli as tables

INPUT_AT_FAULT = 2

app = typer.Typer(
    name="armtrue",
    cls=GuardedGroup,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
    help="""Calibrate a robot arm: fit it, see where the model fails, add what is missing, compensate.

The way through it, from measurements to tables:

    [bold]armtrue check[/] data.csv --robot robot.yaml

    [bold]armtrue fit[/] data.csv --robot robot.yaml --model model.yaml --out fit.json

    [bold]armtrue refine[/] fit.json --out best.json

    [bold]armtrue report[/] fit.json best.json --out report.html

    [bold]armtrue export[/] best.json --out tables.bin

All files are in metres, radians, kilograms, seconds and °C; joints count from 1.
Measurements in any other form are read through a dataset.yaml.

Exit status: 0 done, 1 done with a verdict against, 2 bad input (one sentence says what), 130 stopped.""",
)


def _say_version(wanted: bool) -> None:
    if wanted:
        print(f"armtrue {armtrue.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version and end."),
    ] = False,
) -> None:
    pass


for commands in (
    init,
    checking,
    fitting,
    predicting,
    diagnosis,
    workbench,
    planning,
    tables,
    device,
    campaign,
    catalogue,
):
    commands.add_to(app)


def main() -> None:
    """Run the command line and exit."""
    try:
        status = app(standalone_mode=False)
        sys.stdout.flush()
        sys.exit(status if isinstance(status, int) else 0)
    except InputError as error:
        print(f"armtrue: {error}", file=sys.stderr)
        sys.exit(INPUT_AT_FAULT)
    except click.ClickException as error:
        # One sentence here too, where Typer would draw a box.
        print(f"armtrue: {_sentence(error)}", file=sys.stderr)
        sys.exit(INPUT_AT_FAULT)
    except KeyboardInterrupt:
        print("armtrue: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output went away, as `armtrue … | head` does: nothing to say and nobody to say it to.
        sys.stderr.close()
        sys.exit(0)
    except OSError as error:
        print(f"armtrue: {_place(error)}: {error.strerror or error}", file=sys.stderr)
        # What standard output could not take would be tried again at the end.
        sys.stderr.flush()
        os._exit(INPUT_AT_FAULT)
    except MemoryError:
        print("armtrue: found more than this machine's memory holds, expected smaller files", file=sys.stderr)
        sys.exit(INPUT_AT_FAULT)


def _place(error: OSError) -> str:
    """What could not be read or written."""
    return str(error.filename) if error.filename else "standard output or a file"


def _sentence(error: click.ClickException) -> str:
    """What was wrong with the words of the command line, and where its help is."""
    message = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    words = context.command_path.removeprefix("python -m ").split()[1:] if context is not None else []
    return f"{message}; '{' '.join(['armtrue', *words])} --help' says what there is"
