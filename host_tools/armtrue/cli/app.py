"""The command line: its commands, and the exit status and message of each error.

Exit status 2: the input is at fault; 130: interrupted; 141: the reader of the output closed the pipe.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated, ClassVar

import click
import typer

import armtrue
from armtrue.cli import INTERRUPTED
from armtrue.cli.shared.guard import GuardedGroup, ReaderGoneError
from armtrue.errors import InputError

INPUT_AT_FAULT = 2
# 128 + SIGPIPE, which a shell reports of any other command whose reader closed the pipe. Not 0, because the command
# may be unfinished: `armtrue upload … | head -1` ends in the middle of the transfer.
READER_GONE = 141


class _Commands(GuardedGroup):
    """The commands of `armtrue`: the module of each, and its line in the list of commands."""

    homes: ClassVar[dict[str, tuple[str, str]]] = {
        "init": (
            "init",
            "Read foreign measurement files and write robot.yaml, dataset.yaml and model.yaml.",
        ),
        "check": ("checking", "Check measurements for mistakes before a fit: units, signs, drift."),
        "fit": ("fitting", "Fit the model's effects, and print how well it predicts held-out poses."),
        "add": ("fitting", "Add an effect to a fit, fit again, and print how the error fell."),
        "remove": ("fitting", "Remove an effect from a fit, fit again: the opposite of 'add'."),
        "predict": ("predicting", "Predict where the tool point will be, row by row."),
        "compare": ("predicting", "Compare a fit with measurements it has not seen."),
        "diagnose": (
            "diagnosis",
            "Name the physical effect that a fit lacks, its joint and its probability.",
        ),
        "refine": ("diagnosis", "Diagnose and add until nothing is missing."),
        "report": ("diagnosis", "Write one self-contained HTML page: what is missing, how the error fell."),
        "open": (
            "workbench.open_workbench",
            "Open the workbench, a page in the browser that adds and removes effects.",
        ),
        "plan": (
            "planning",
            "Choose the poses to measure: for a first campaign, or to decide between candidates.",
        ),
        "export": ("tables", "Write the firmware's table image for a fit."),
        "compensate": (
            "tables",
            "Correct commands: q1…qn that bring the real tool to its intended point.",
        ),
        "keygen": ("tables", "Make an Ed25519 key pair to sign tables with."),
        "upload": ("device", "Install a table on a compensator: transfer, verify, activate."),
        "simulate": ("campaign", "Simulate a campaign with known truth."),
        "effects": ("catalogue", "List the effects, or show the formula, curve, bound and options of one."),
        "explain": ("explain", "Define a term of reports and messages."),
        "tables": ("tables.tables_app", "Inspect table images."),
        "device": ("device.app", "Query and manage a compensator on a bus."),
    }


app = typer.Typer(
    name="armtrue",
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="""Calibrate a robot arm: fit it, see where the model fails, add what is missing, compensate.

The way through it, from measurements to tables:

    \b
    armtrue check data.csv --robot robot.yaml
    armtrue fit data.csv --robot robot.yaml --model model.yaml --out fit.json
    armtrue refine fit.json --out best.json
    armtrue report fit.json best.json --out report.html
    armtrue export best.json --out tables.bin

All files are in metres, radians, kilograms, seconds and °C; joints count from 1.
Measurements in any other form are read through a dataset.yaml.

Exit status: 0 done, 1 done with a negative verdict, 2 bad input (one sentence says what), 130 stopped,
141 the reader of the output closed the pipe.""",
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
        # One sentence, as for other errors; Typer would draw a box.
        print(f"armtrue: {_sentence(error)}", file=sys.stderr)
        sys.exit(INPUT_AT_FAULT)
    except KeyboardInterrupt:
        print("armtrue: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except (ReaderGoneError, BrokenPipeError):
        # No message, as there is no reader. At exit Python flushes standard output, which would fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(READER_GONE)
    except OSError as error:
        place = error.filename or "standard output or a file"
        print(f"armtrue: {place}: {error.strerror or error}", file=sys.stderr)
        # _exit, because at a usual exit Python would write the rest of standard output again.
        sys.stderr.flush()
        os._exit(INPUT_AT_FAULT)
    except MemoryError:
        print("armtrue: found more than this machine's memory holds, expected smaller files", file=sys.stderr)
        sys.exit(INPUT_AT_FAULT)


def _sentence(error: click.ClickException) -> str:
    """The error in the command line's arguments, and the command that prints the help."""
    message = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    words = context.command_path.removeprefix("python -m ").split()[1:] if context is not None else []
    return f"{message}; '{' '.join(['armtrue', *words])} --help' lists the options"
