"""Results of actions other than adding effects, and leaving out rows by the range of a variable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.report.markup import Markup, tag
from armtrue.report.parts import folded
from armtrue.workbench.outputs import Made
from armtrue.workbench.showing.elements import button
from armtrue.workbench.showing.looking import all_variables


@dataclass(frozen=True)
class Result:
    """The result of an action: for the page, in a sentence, and as a file where there is one."""

    shown: Markup
    said: str
    made: Made | None = None

    def as_json(self) -> dict[str, Any]:
        """For the session's file. Files of results are text."""
        made = self.made
        kept = made and {"name": made.name, "kind": made.kind, "text": made.content.decode()}
        return {"shown": str(self.shown), "said": self.said, "made": kept}

    @staticmethod
    def of_json(kept: dict[str, Any]) -> Result:
        """What `as_json` gave. Errors: KeyError, TypeError where it is something else."""
        made = kept["made"]
        file = Made(made["name"], made["text"].encode(), made["kind"]) if made else None
        return Result(Markup(kept["shown"]), str(kept["said"]), file)


def rows_between(fit: Fit, words: dict[str, Any]) -> list[int]:
    """Rows of the file where a variable lies between two values, ends included. Errors: InputError where none does."""
    known = {variable.name: variable for variable in all_variables(fit)}
    variable = known.get(str(words.get("variable")))
    low, high = words.get("low"), words.get("high")
    if variable is None:
        raise InputError(f"variable: found {words.get('variable')!r}, expected one of {', '.join(known)}")
    if not isinstance(low, int | float) or not isinstance(high, int | float) or not low <= high:
        raise InputError(f"from, to: found {low!r} and {high!r}, expected two numbers, the lower one first")
    inside = (variable.values >= low) & (variable.values <= high)
    if not inside.any():
        raise InputError(f"found no row with {variable.label} from {low:g} to {high:g}, expected some")
    return [int(row) for row in fit.data.rows[inside]]


def leave_out_form(fit: Fit) -> Markup:
    """A form to leave out a region, a time or a range of any other variable."""
    options = [
        tag("option", f"{v.label} ({v.values.min():.4g} to {v.values.max():.4g})", value=v.name)
        for v in all_variables(fit)
    ]
    return folded(
        "Leave out a region or a time",
        tag("label", "rows with ", tag("select", options, id="leave-variable")),
        tag("label", " from ", tag("input", type="number", step="any", id="leave-low")),
        tag("label", " to ", tag("input", type="number", step="any", id="leave-high")),
        button("Leave out", "leave_out_where"),
    )
