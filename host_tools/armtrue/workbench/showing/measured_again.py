"""Measurements dropped after the first fit: reads them, compares them with the model, joins them to the fit's own."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armtrue.comparing import Comparison, compare
from armtrue.errors import InputError, RowError
from armtrue.fitting import Fit
from armtrue.fitting import fit as fit_model
from armtrue.io import Dataset, Model, load_data
from armtrue.io.files import csv_text, read_text, write_file
from armtrue.progress import Progress
from armtrue.report.markup import Markup, tag
from armtrue.report.parts import listed, micrometres
from armtrue.units import plural
from armtrue.workbench.opening.dropped import Drop, is_own, kind_of
from armtrue.workbench.opening.opened import Opened
from armtrue.workbench.showing.elements import button
from armtrue.workbench.showing.further import Result

Entry = dict[str, Any]

_SET_UP = "station"
_JOIN = "Fitted together, they make the model better known; what stands open goes on as a session of its own."
_JOIN_APART = (
    "They can join as a set-up of their own: its frame is fitted beside the first one's (effect station), and the arm "
    "from both. What stands open goes on as a session of its own."
)
_JOIN_WORSE = (
    "Joining is not recommended: the arm is not as it was, or moves here as the model does not know. Look at the worst "
    "rows first. What stands open goes on as a session of its own."
)


def _measured(fit: Fit, drop: Drop, words: Entry) -> Dataset | None:
    """The measurements that were dropped; None where guesses are to be reviewed first.

    `words`: the form or the text of guesses. Foreign files are read as those of the session were, if possible.
    Errors: InputError where there is no file of measurements, or one in Armtrue's own form has an unreadable row.
    """
    if drop.guess is not None:
        return _of_set_up(fit, drop.measurements(words))
    kinds = {name: kind_of(drop.folder / name) for name in drop.names}
    files = [name for name, kind in kinds.items() if kind == "data"]
    files = files or [name for name, kind in kinds.items() if kind == "table"]
    if not files:
        raise InputError("compare: found no file of measurements among those dropped, expected one")
    path = drop.folder / files[0]
    if len(files) == 1:
        try:
            return _of_set_up(fit, load_data(path, fit.robot))
        except InputError as error:
            if kinds[path.name] == "data" or (is_own(path) and isinstance(error, RowError)):
                raise
        with suppress(InputError):
            return _of_set_up(fit, _read_as_before(fit, path))
    if not {"robot", "urdf", "dh"} & set(kinds.values()):
        drop.take("robot.yaml", yaml.safe_dump(fit.robot.spec, sort_keys=False).encode())
    opened = drop.open({})
    return None if opened is None else _of_set_up(fit, opened.data)


def _read_as_before(fit: Fit, path: Path) -> Dataset:
    """A foreign file read through the dataset.yaml of the session. Errors: InputError where that is impossible."""
    before = fit.data.path
    if before.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{path}: found measurements of the session that no dataset.yaml describes")
    document = {**yaml.safe_load(read_text(before)), "file": str(path)}
    as_before = path.with_name(f"as-before-{path.name}.yaml")
    write_file(as_before, yaml.safe_dump(document, sort_keys=False, allow_unicode=True))
    return load_data(as_before, fit.robot)


def _of_set_up(fit: Fit, data: Dataset) -> Dataset:
    """`data`, assigned to the model's first set-up if the model reads the set-up and `data` lack it."""
    if _SET_UP not in fit.document.get("columns", {}) or _SET_UP in data.columns:
        return data
    first = np.full(data.count, fit.data.columns[_SET_UP].min())
    return replace(data, columns={**data.columns, _SET_UP: first})


def compared(fit: Fit, drop: Drop, words: Entry) -> Result | None:
    """Dropped measurements compared with the model; None where guesses are to be reviewed first."""
    data = _measured(fit, drop, words)
    if data is None:
        return None
    found = compare(fit, data)
    figures = found.figures
    mean, expected = figures["error"]["mean_um"], figures["expected_mean_um"]
    verdict = "as" if figures["verdict"] == "as_expected" else "worse than"
    name = data.file.name
    said = f"{name}: mean error {micrometres(mean)} µm, {verdict} was to be expected ({micrometres(expected)} µm)."
    if found.all_fitted:
        said = f"{name}: {found.sentences[0]}."
    elif found.elsewhere_um is not None:
        said = f"{said} {found.sentences[-1].capitalize()}."
    worst = [f"row {entry['row']}: {micrometres(entry['error_um'])} µm" for entry in figures["rows"]]
    shown = tag(
        "div",
        tag("h3", f"{name}: {found.title.lower()}"),
        listed(found.sentences),
        None if found.all_fitted else _offer(found),
        tag("h3", "The worst rows"),
        tag("ol", [tag("li", row) for row in worst]),
    )
    return Result(shown, said)


def _offer(found: Comparison) -> Markup:
    """Whether to join what was compared, and how."""
    if found.elsewhere_um is not None:
        return tag("p", _JOIN_APART, " ", button("Let them join as a set-up of their own", "join"))
    words = _JOIN if found.figures["verdict"] == "as_expected" else _JOIN_WORSE
    return tag("p", words, " ", button("Let them join", "join"))


def joined(fit: Fit, drop: Drop, progress: Progress) -> Opened:
    """The session's measurements and the dropped ones as one campaign, with the model fitted to all of them.

    Only columns that both have are kept. Where base or instrument stand elsewhere, the new measurements become a
    separate set-up. Errors: InputError where the two cannot be of one campaign.
    """
    old, new = fit.data, _measured(fit, drop, {})
    if new is None:
        raise InputError("join: found guesses that nobody has looked at, expected them to be compared first")
    effects = fit.effects
    if compare(fit, new).elsewhere_um is not None:
        old, new = _apart(old, new)
        effects += [] if any(entry["effect"] == _SET_UP for entry in effects) else [{"effect": _SET_UP}]
    new = replace(new, columns=new.columns | fit.assumed(new)[0])
    names = [name for name in old.columns if name in new.columns]
    rows: list[tuple[str, ...]] = []
    for part, prefix in ((old, ""), (new, "new ")):
        cells = [_cells(part, name, prefix if name == "repeat" else "") for name in names]
        rows += zip(*cells, strict=True)
    text = csv_text(names, rows)
    place = drop.folder / f"joined-{hashlib.sha256(text.encode()).hexdigest()[:8]}.csv"
    place.parent.mkdir(parents=True, exist_ok=True)
    write_file(place, text)
    data = load_data(place, fit.robot)
    model = fit.document["model"]
    instrument = fit.document["options"].get("instrument")
    believed = Model(effects, model["parameters"], model["priors"], instrument)
    note = f"{plural(new.count, 'measurement')} of {new.file.name} joined {old.count} of {old.file.name}"
    made = fit_model(data, fit.robot, believed, progress=progress)
    return Opened(data, fit.robot, None, [made], [place], [note])


def _apart(old: Dataset, new: Dataset) -> tuple[Dataset, Dataset]:
    """Both with their set-ups numbered, those of `new` after those of `old`."""
    before, after = (part.columns.get(_SET_UP, np.ones(part.count)) for part in (old, new))
    after = after - after.min() + before.max() + 1.0
    apart = ((old, before), (new, after))
    old, new = (replace(part, columns={**part.columns, _SET_UP: set_up}) for part, set_up in apart)
    return old, new


def _cells(data: Dataset, name: str, prefix: str) -> list[str]:
    """A column as text; reflectors and poses measured again under their names."""
    values = data.columns[name]
    if name in data.labels:
        return [prefix + data.labels[name][int(value)] for value in values]
    return [repr(float(value)) for value in values]
