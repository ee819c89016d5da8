"""Answers on causes that look alike, each hidden in a session that cannot separate them and in one that can."""

from __future__ import annotations

from collections import Counter

from armtrue_sim.kinds import PAIRS, Pair
from harness import Outcome

HEAD = (
    "| hidden | taken for | the session | cases | right alone | both named | and a false one | column asked for "
    "| wrong alone | else | nothing said | what decides | right alone then |\n"
    f"|{'---|' * 13}\n"
)
ANSWERS = ("right", "both", "and a false one", "no column", "wrong", "else", "nothing")


def answer(outcome: Outcome) -> str:
    """The answer in one case, by ANSWERS, or `failed`.

    both: the true cause is added or listed as an alternative. and a false one: the same, but an absent cause is added
    with SURELY or more. no column: the true cause is listed with the column to record. wrong: an absent cause is added
    with SURELY or more, and the true one is not mentioned. else: something is added with less, or unexplained.
    """
    if outcome.trouble:
        return "failed"
    surely = outcome.added & outcome.sure
    if outcome.hidden <= surely and not surely - outcome.hidden:
        return "right"
    if outcome.hidden <= outcome.added | outcome.stand_ins:
        return "and a false one" if surely - outcome.hidden else "both"
    if outcome.without_column & {word.split()[0] for word in outcome.hidden}:
        return "no column"
    if surely:
        return "wrong"
    is_silent = outcome.verdict == "nothing_missing" and not outcome.added
    return "nothing" if is_silent and not outcome.stand_ins else "else"


def row(pair: Pair, hidden: int, answers: dict[str, Counter[str]]) -> str:
    """One line of the table: answers in the open session, and how often the deciding one is right alone."""
    one, other = pair.suspects[hidden], pair.suspects[1 - hidden]
    there = answers.get(pair.kind(hidden, False), Counter())
    then = answers.get(pair.kind(hidden, True))
    failed = f", {there['failed']} failed" if there["failed"] else ""
    decided = [pair.measurement, f"{then['right']} of {then.total()}"] if then else ["none of these", "–"]
    cells = [
        one.words,
        other.words,
        pair.lacks,
        f"{there.total()}{failed}",
        *(str(there[name]) for name in ANSWERS),
    ]
    return "| " + " | ".join([*cells, *decided]) + " |\n"


def table(outcomes: list[Outcome]) -> str:
    """Markdown, one line for each cause of each pair."""
    answers: dict[str, Counter[str]] = {}
    for outcome in outcomes:
        answers.setdefault(outcome.kind, Counter())[answer(outcome)] += 1
    return HEAD + "".join(row(pair, hidden, answers) for pair in PAIRS for hidden in (0, 1))
