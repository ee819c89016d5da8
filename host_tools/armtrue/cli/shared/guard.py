"""Checks and error handling common to all commands.

No output is one of the inputs, every number is finite, a mistyped name is answered with the nearest, and a closed pipe
is not reported as a failure.
"""

from __future__ import annotations

import importlib
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import click
import typer
import typer.core
import typer.main

from armtrue.errors import InputError, did_you_mean
from armtrue.io.files import check_writable, refuse_to_lose

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
    """A group of commands that are imported when they run, and whose arguments are checked before they begin.

    `homes`: command → its module in `cli`, imported when the command runs, with the name there if another than the
    command's; and its line of the help.
    """

    homes: ClassVar[dict[str, tuple[str, str]]] = {}
    format_commands = _list_commands

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Parse the arguments; raises ReaderGoneError if the reader closes the pipe while help is printed."""
        with _told_of_closed_pipe():
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; raises ReaderGoneError if the reader of its output closes the pipe."""
        with _told_of_closed_pipe():
            return super().invoke(ctx)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the help."""
        return list(self.homes)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command; one that is not imported yet has its line of the help and nothing else."""
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
        # `ctx.params` still has texts: Typer converts them to paths when it calls the command's function.
        files = {key: _paths(value) for key, value in ctx.params.items() if key in named}
        _refuse_clashes(name, defaultdict(list, files))
        return run(ctx)

    command.invoke = invoke  # type: ignore[method-assign]
