"""What is done beside adding effects: rows left out by a variable, new measurements compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armtrue.comparing import compare
from armtrue.errors import InputError
from armtrue.fitting import Fit, fingerprint
from armtrue.fitting import fit as fit_model
from armtrue.io import Dataset, Model, load_data
from armtrue.io.files import csv_text, write_file
from armtrue.progress import Progress
from armtrue.report.gathered.state import Variable
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import micrometres
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import Opened
from armtrue.workbench.outputs import Made
from armtrue.workbench.showing.elements import button
from armtrue.workbench.showing.looking import all_variables


@dataclass(frozen=True)
class Result:
    """What an action found: for the page, in a sentence, and as a file where there is one."""

    shown: Markup
    said: str
    made: Made | None = None

    def as_json(self) -> dict[str, Any]:
        """For the session's file. Files of results are text."""
        made = self.made and {
            "name": self.made.name,
            "kind": self.made.kind,
            "text": self.made.content.decode(),
        }
        return {"shown": str(self.shown), "said": self.said, "made": made}

    @staticmethod
    def of_json(kept: dict[str, Any]) -> Result:
        """What `as_json` gave. Errors: KeyError, TypeError where it is something else."""
        made = kept["made"] and Made(
            kept["made"]["name"], kept["made"]["text"].encode(), kept["made"]["kind"]
        )
        return Result(Markup(kept["shown"]), str(kept["said"]), made or None)


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

    def option(variable: Variable) -> Markup:
        values = variable.values
        return tag(
            "option", f"{variable.label} ({values.min():.4g} to {values.max():.4g})", value=variable.name
        )

    return tag(
        "details",
        tag("summary", "Leave out a region or a time"),
        tag(
            "label", "rows with ", tag("select", [option(v) for v in all_variables(fit)], id="leave-variable")
        ),
        tag("label", " from ", tag("input", type="number", step="any", id="leave-low")),
        tag("label", " to ", tag("input", type="number", step="any", id="leave-high")),
        button("Leave out", "leave_out_where"),
    )


def _dropped(fit: Fit, drop: Drop) -> Dataset:
    """The measurements that were dropped. Errors: InputError where they are not one file in Armtrue's form."""
    files = [name for name in drop.names if name.lower().endswith((".csv", ".yaml", ".yml"))]
    if len(files) != 1:
        raise InputError(
            f"compare: found {len(files)} files of measurements, expected one to be dropped first"
        )
    return load_data(drop.folder / files[0], fit.robot)


def compared(fit: Fit, drop: Drop) -> Result:
    """Dropped measurements against the model. Errors: InputError where they are not one file in Armtrue's form."""
    data = _dropped(fit, drop)
    figures = compare(fit, data).figures
    mean, expected = figures["error"]["mean_um"], figures["expected_mean_um"]
    verdict = (
        "as was to be expected" if figures["verdict"] == "as_expected" else "worse than was to be expected"
    )
    said = f"{data.file.name}: mean error {micrometres(mean)} µm, {verdict} ({micrometres(expected)} µm)."
    worst: list[Content] = [
        tag("li", f"row {entry['row']}: {micrometres(entry['error_um'])} µm") for entry in figures["rows"]
    ]
    words = "Fitted together, they make the model better known; what stands open goes on as a session of its own. "
    join = tag("p", words, button("Let them join", "join"))
    return Result(tag("div", tag("p", said), join, tag("h3", "The worst rows"), tag("ol", worst)), said)


def joined(fit: Fit, drop: Drop, progress: Progress) -> Opened:
    """The session's measurements and the dropped ones as one campaign, with the model fitted to all of them.

    Only what both recorded is kept. Errors: InputError where the two cannot be of one campaign.
    """
    old, new = fit.data, _dropped(fit, drop)
    names = [name for name in old.columns if name in new.columns]
    if missing := [name for name in fit.document.get("columns", {}) if name not in names]:
        raise InputError(
            f"{new.file.name}: column {missing[0]} is missing, expected it as the model reads it"
        )
    place = drop.folder / f"joined-{fingerprint(new)[:8]}.csv"
    place.parent.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, ...]] = []
    for part, prefix in ((old, ""), (new, "new ")):
        cells = [_cells(part, name, prefix if name == "repeat" else "") for name in names]
        rows += zip(*cells, strict=True)
    write_file(place, csv_text(names, rows))
    data = load_data(place, fit.robot)
    model = fit.document["model"]
    believed = Model(
        model["effects"], model["parameters"], model["priors"], fit.document["options"].get("instrument")
    )
    note = f"{new.count} measurements of {new.file.name} joined {old.count} of {old.file.name}"
    made = fit_model(data, fit.robot, believed, progress=progress)
    return Opened(data, fit.robot, None, [made], [place], [note])


def _cells(data: Dataset, name: str, prefix: str) -> list[str]:
    """A column as text; reflectors and poses measured again under their names."""
    values = data.columns[name]
    if name in data.labels:
        return [prefix + data.labels[name][int(value)] for value in values]
    return [repr(float(value)) for value in values]
