"""The command explain."""

from __future__ import annotations

from typing import Annotated

import typer

from armtrue import glossary
from armtrue.cli.shared.output import Output
from armtrue.errors import InputError, did_you_mean
from armtrue.io.catalogue import catalogue


def explain(
    term: Annotated[list[str] | None, typer.Argument(metavar="TERM", help="A word of a report.")] = None,
) -> None:
    """Define a term of reports and messages; without TERM, list all terms.

    Example: armtrue explain held out
    """
    output = Output(None)
    words = " ".join(term or [])
    if not words:
        output.say(", ".join(glossary.glossary()))
        return
    entry = glossary.find(words)
    if entry is not None:
        output.say(f"{entry.name} ({entry.also})" if entry.also else entry.name)
        output.items([entry.text])
        return
    effects = catalogue()
    if words not in effects:
        known = [*glossary.glossary(), *effects]
        hint = did_you_mean(words, known) or "; 'armtrue explain' lists them"
        raise InputError(f"explain: found '{words}', expected a word of the glossary or an effect{hint}")
    output.say(f"{words}: {effects[words].summary}")
    output.line(f"armtrue effects {words}")
