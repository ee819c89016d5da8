"""The command line: its commands, and the exit status and message of each error.

Exit status 2: the input is at fault; 130: interrupted; 141: the reader of the output closed the pipe.
"""

from __future__ import annotations

import importlib
import math
import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import click
import typer
import typer.core
import typer.main

import armtrue
from armtrue.cli import INTERRUPTED
from armtrue.errors import InputError, did_you_mean
from armtrue.io.files import check_writable, refuse_to_lose

INPUT_AT_FAULT = 2
# 128 + SIGPIPE, which a shell reports of any other command whose reader closed the pipe. Not 0, because the command
# may be unfinished: `armtrue upload … | head -1` ends in the middle of the transfer.
READER_GONE = 141


# Options that name files to be written; every other path is read.
_WRITTEN = {"out", "json_to", "record"}
# Commands whose --out may be the fit that they read: the next step replaces the last one.
_IN_PLACE = {"add", "remove", "refine"}
# Suffix of a second file that a command writes beside --out.
_BESIDE_OUT = {"export": ".fit.json", "keygen": ".pub"}
# Suffix of a second file that a command reads beside its argument.
_BESIDE_TABLES = {"compensate": ".fit.json"}


class ReaderGoneError(Exception):
    """The reader of the command's output has closed the pipe, as in `armtrue … | head`."""


@contextmanager
def _told_of_closed_pipe() -> Iterator[None]:
    # Click would turn a closed pipe into exit status 1, which means a refusal here.
    try:
        yield
    except BrokenPipeError:
        raise ReaderGoneError from None


def _refuse_not_finite(command: click.Command, parameters: dict[str, Any]) -> None:
    """Raise InputError for an option of `command` whose value is NaN or infinite.

    Click's ranges let NaN through, as it is neither below nor above anything: a timeout of NaN never ends.
    """
    for parameter in command.params:
        value, kind = parameters.get(parameter.name or ""), parameter.type
        for number in value if isinstance(value, list | tuple) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                expected = "a finite number"
                if isinstance(kind, click.FloatRange) and kind.min is not None and kind.max is not None:
                    expected = f"{kind.min:g} to {kind.max:g}"
                raise InputError(f"{parameter.opts[0]}: found {number}, expected {expected}")


def _refuse_clashes(command: str, files: dict[str, list[Path]]) -> None:
    """Raise InputError if `command` would overwrite a file that it reads, or write one file twice.

    `files`: those of each parameter that names any.
    """
    reads = [path for name, paths in files.items() if name not in _WRITTEN for path in paths]
    reads += [
        Path(f"{path}{_BESIDE_TABLES[command]}") for path in files["tables"] if command in _BESIDE_TABLES
    ]
    writes = [path for name in _WRITTEN for path in files[name]]
    writes += [Path(f"{path}{_BESIDE_OUT[command]}") for path in files["out"] if command in _BESIDE_OUT]
    if command in _IN_PLACE and [path.resolve() for path in files["fit_file"]] == [
        path.resolve() for path in files["out"]
    ]:
        reads = [path for path in reads if path not in files["fit_file"]]
    refuse_to_lose(reads, writes)
    if command not in ("init", "simulate"):
        for path in writes:
            check_writable(path)


def _paths(value: Any) -> list[Path]:
    if value is None or value == "-":
        return []
    return [Path(one) for one in value] if isinstance(value, list | tuple) else [Path(value)]


# Help in plain text: importing Rich takes a fifth of a second, and it takes a unit in brackets for markup.
typer.core.HAS_RICH = False


def _list_commands(group: click.Group, ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write every command with its complete first sentence, which Click would cut to one line."""
    commands = [(name, group.get_command(ctx, name)) for name in group.list_commands(ctx)]
    with formatter.section("Commands"):
        formatter.write_dl([(name, own.get_short_help_str(limit=1000)) for name, own in commands if own])


class GuardedGroup(typer.core.TyperGroup):
    """The group of all commands; their arguments are checked before any of them begins.

    `homes`: command → its module in `cli`, imported when the command runs, with the name there if another than the
    command's; and its line of the help.
    """

    homes: ClassVar[dict[str, tuple[str, str]]] = {
        "init": (
            "measurements",
            "Read foreign measurement files and write robot.yaml, dataset.yaml and model.yaml.",
        ),
        "check": ("measurements", "Check measurements for mistakes before a fit: units, signs, drift."),
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
        "simulate": ("measurements", "Simulate a campaign with known truth."),
        "effects": ("catalogue", "List the effects, or show the formula, curve, bound and options of one."),
        "explain": ("catalogue", "Define a term of reports and messages."),
        "tables": ("tables.tables_app", "Inspect table images."),
        "device": ("device.app", "Query and manage a compensator on a bus."),
    }
    format_commands = _list_commands

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """As Click's; raises ReaderGoneError if the reader closes the pipe while help is printed."""
        with _told_of_closed_pipe():
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """As Click's; raises ReaderGoneError if the reader of the output closes the pipe."""
        with _told_of_closed_pipe():
            return super().invoke(ctx)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the help."""
        return list(self.homes)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command if it is loaded, else a placeholder with its line of the help."""
        if cmd_name in self.commands or cmd_name not in self.homes:
            return self.commands.get(cmd_name)
        return typer.core.TyperCommand(cmd_name, help=self.homes[cmd_name][1])

    def whole(self) -> GuardedGroup:
        """The group with every command loaded, for the documentation."""
        for name in self.homes:
            self.load(name)
        return self

    def load(self, name: str) -> click.Command:
        """The command `name`, loaded and guarded."""
        if name not in self.commands:
            part = typer.Typer(pretty_exceptions_enable=False)
            part.callback()(lambda: None)
            module, _, own = self.homes[name][0].partition(".")
            home = getattr(importlib.import_module(f"armtrue.cli.{module}"), own or name)
            if isinstance(home, typer.Typer):
                part.add_typer(home, name=name)
            else:
                part.command(name)(home)
            self.commands[name] = typer.main.get_group(part).commands[name]
            _guard(name, self.commands[name])
        return self.commands[name]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that `args` name, guarded; the error for an unknown name suggests the nearest known one."""
        name = args[0] if args else ""
        if name in self.homes:
            self.load(name)
        elif not name.startswith("-"):
            hint = did_you_mean(name, self.homes) if name else ""
            ctx.fail(f"No such command '{name}'{hint}")
        return super().resolve_command(ctx, args)


_EXAMPLE = re.compile(r"Example: .*?(?=\n\s*\n|\Z)", re.DOTALL)


def _guard(name: str, command: click.Command) -> None:
    """Make `command`, or its subcommands, check for finite numbers and by `_refuse_clashes` before they begin."""
    if isinstance(command, click.Group):
        command.format_commands = partial(_list_commands, command)  # type: ignore[method-assign]
        for under, own in command.commands.items():
            _guard(under, own)
        return
    # Each example is on one line, marked so that Click does not wrap it: users paste it.
    command.help = _EXAMPLE.sub(lambda found: "\b\n" + " ".join(found[0].split()), command.help or "")
    for parameter in command.params:
        if parameter.default is None:
            parameter.show_default = False  # type: ignore[attr-defined]
    run = command.invoke
    named = {own.name for own in command.params if isinstance(own.type, click.Path) or own.name in _WRITTEN}

    def invoke(ctx: click.Context) -> Any:
        _refuse_not_finite(command, ctx.params)
        # Typer converts arguments to paths only when it calls the command's function.
        files = {key: _paths(value) for key, value in ctx.params.items() if key in named}
        _refuse_clashes(name, defaultdict(list, files))
        return run(ctx)

    command.invoke = invoke  # type: ignore[method-assign]


app = typer.Typer(
    name="armtrue",
    cls=GuardedGroup,
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
