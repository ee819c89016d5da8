"""The guesses of `init` on foreign files as a form beside the first rows; form and dataset.yaml say the same."""

from __future__ import annotations

import csv
import json
from itertools import islice
from pathlib import Path
from typing import Any

import yaml

from armtrue.checking import Finding
from armtrue.checking.lengths import true_unit
from armtrue.errors import InputError
from armtrue.io import Robot
from armtrue.io.columns import POSITION, QUATERNION, TEXT_COLUMNS, UNITS, ColumnNames
from armtrue.io.files import read_text
from armtrue.io.layout import SEPARATORS
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import folded, listed
from armtrue.units import plural
from armtrue.workbench.showing.elements import button

Document = dict[str, Any]

_UNUSED = "not used"
_TURNS = ("rotation 1", "rotation 2", "rotation 3")
_SEQUENCES = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX", "ZYZ", "ZXZ", "XYX", "XZX", "YXY", "YZY")
_FIRST_ROWS = 5
_SIGN, _SWAPPED, _HAND = "joint_sign", "joints_swapped", "left_handed_frame"
_UNIT_OF_POINTS = ("scale", "units")
_UNIT_OF_JOINTS = {"joints_in_degrees": "deg", "joints_in_radians": "rad"}


def first_rows(dataset: Path, document: Document) -> tuple[list[str], list[list[str]]]:
    """Header and first rows of the file that a dataset.yaml reads, as they stand in it."""
    path = dataset.parent / str(document.get("file", ""))
    at = document.get("header_row", 1)
    skipped = max(0, at - 1) if isinstance(at, int) else 0
    encoding = str(document.get("encoding", "utf-8"))
    text = read_text(path, "utf-8-sig" if encoding == "utf-8" else encoding)
    lines = list(islice(text.splitlines(), skipped, skipped + 1 + _FIRST_ROWS))
    rows = list(csv.reader(lines, delimiter=_separator(document)))
    if at == 0:
        return [str(k) for k in range(1, len(rows[0]) + 1)] if rows else [], rows
    return (rows[0], rows[1:]) if rows else ([], [])


def _separator(document: Document) -> str:
    given = str(document.get("separator", "comma"))
    return SEPARATORS.get(given, given if len(given) == 1 else ",")


def form(document: Document, header: list[str], rows: list[list[str]], robot: Robot) -> Markup:
    """The form of a dataset.yaml beside the first rows of its file."""
    given = {value: name for name, value in SEPARATORS.items()}
    turn = document.get("rotation") or {}
    at = document.get("header_row", 1)
    line = tag("input", type="number", min="0", max="1000", value=at, data_form="header_row")
    top = [
        _choice("separator", list(SEPARATORS), given.get(_separator(document), "comma")),
        _choice("decimal", [".", ","], str(document.get("decimal", "."))),
        tag("label", "line of the header ", line),
    ]
    turns = [
        _choice("sequence", list(_SEQUENCES), str(turn.get("sequence", "XYZ"))),
        _choice("axes", ["intrinsic", "extrinsic"], str(turn.get("axes", "intrinsic"))),
        _choice("rotation unit", ["rad", "deg", "mrad"], str(turn.get("unit", "rad"))),
    ]
    meanings, units = _meanings(document), _units(document)
    known = _known(robot, [*meanings.values()])
    heads = [tag("th", name, scope="col") for name in header]
    kinds, given_units = [], []
    for name in header:
        kind = _select(f"{name} is", [_UNUSED, *known], meanings.get(name, _UNUSED), name, "is")
        unit = _select(f"unit of {name}", ["", *UNITS], units.get(name, ""), name, "unit")
        kinds.append(tag("td", kind))
        given_units.append(tag("td", unit))
    body = [tag("tr", [tag("td", cell) for cell in row]) for row in rows]
    caption = tag("caption", "The first rows, and what their columns are")
    head = tag("thead", tag("tr", heads), tag("tr", kinds), tag("tr", given_units))
    table = tag("table", caption, head, tag("tbody", body))
    return tag(
        "div",
        tag("p", top, class_="form"),
        tag("div", table, class_="scroll", tabindex="0", role="region", aria_label="The first rows"),
        tag("p", "Angles of the tool, where three columns are rotations: ", turns, class_="form"),
        tag("p", "Poses measured again are told by equal joints, or by a column that is 'repeat'."),
    )


def _choice(name: str, choices: list[str], chosen: str) -> Markup:
    return tag("label", f"{name} ", _select(name, choices, chosen, name.replace(" ", "_"), None))


def _select(label: str, choices: list[str], chosen: str, key: str, what: str | None) -> Markup:
    options = [tag("option", choice or "–", value=choice, selected=choice == chosen) for choice in choices]
    return tag("select", options, aria_label=label, data_form=key if what is None else None,
               data_column=key if what else None, data_what=what)  # fmt: skip


def _known(robot: Robot, also: list[str]) -> list[str]:
    """Names that a column may get, those of this file's guesses among them."""
    per_joint = [f"{stem}{k}" for stem in ("q", "qr", "dir", "tau") for k in robot.motors]
    sensors = [f"temp_{name}" for name in robot.sensors] or ["temp_arm"]
    names = [*per_joint[: len(robot.motors)], *POSITION, *QUATERNION, *_TURNS, *TEXT_COLUMNS, "time", "payload",
             "sigma", *sensors, *per_joint[len(robot.motors) :]]  # fmt: skip
    return list(dict.fromkeys([*names, *also]))


def _meanings(document: Document) -> dict[str, str]:
    """What each column of the file is, by its header."""
    found = {}
    for name, entry in (document.get("columns") or {}).items():
        column = entry.get("column") if isinstance(entry, dict) else entry
        if column is not None:
            found[str(column)] = str(name)
    for place, column in zip(_TURNS, (document.get("rotation") or {}).get("columns") or [], strict=False):
        found[str(column)] = place
    return found


def _units(document: Document) -> dict[str, str]:
    return {
        str(entry["column"]): str(entry["unit"])
        for entry in (document.get("columns") or {}).values()
        if isinstance(entry, dict) and "column" in entry and "unit" in entry
    }


def filled_in(text: str, given: Any, robot: Robot) -> str:
    """dataset.yaml with the entries of the form. Errors: InputError where the form is not complete or consistent."""
    document = _document(text)
    fields, columns = map(given.get, ("fields", "columns")) if isinstance(given, dict) else (None, None)
    if not isinstance(fields, dict) or not isinstance(columns, dict):
        raise InputError("form: found none, expected its fields and columns")
    document["separator"] = str(fields.get("separator", "comma"))
    document["decimal"] = str(fields.get("decimal", "."))
    if str(fields.get("header_row", "")).isdecimal():
        document["header_row"] = int(fields["header_row"])
    old = dict(document.get("columns") or {})
    new: Document = {name: e for name, e in old.items() if isinstance(e, dict) and "column" not in e}
    turns: dict[str, str] = {}
    for header, entry in columns.items():
        chosen = entry if isinstance(entry, dict) else {}
        name, unit = (str(chosen.get(key) or "") for key in ("is", "unit"))
        if name in _TURNS:
            turns[name] = header
        elif name and name != _UNUSED:
            if name in new:
                raise InputError(f"columns: found two columns that are {name}, expected one")
            new[name] = _column(old.get(name), header, unit, ColumnNames(robot).kind(name))
    document["columns"] = new
    if turns:
        if len(turns) < len(_TURNS):
            raise InputError(f"rotation: found {len(turns)} columns, expected three")
        document["rotation"] = {
            "form": "euler", "columns": [turns[place] for place in _TURNS], "sequence": str(fields.get("sequence")),
            "axes": str(fields.get("axes")), "unit": str(fields.get("rotation_unit")),
        }  # fmt: skip
    elif any(place in _meanings(_document(text)).values() for place in _TURNS):
        document.pop("rotation", None)
    return _text(document)


def _column(old: Any, header: str, unit: str, kind: str | None) -> Any:
    """The entry of a column; an existing scale and offset stay."""
    entry: Document = dict(old) if isinstance(old, dict) else {}
    entry["column"] = header
    entry.pop("unit", None)
    if unit and kind in {of for of, _, _ in UNITS.values()}:
        entry["unit"] = unit
    return header if list(entry) == ["column"] else entry


def can_be_mended(finding: Finding) -> bool:
    """True where a change of dataset.yaml can correct what a finding reports."""
    in_a_known_unit = finding.code in _UNIT_OF_POINTS and bool(finding.evidence.get("unit"))
    return in_a_known_unit or finding.code in (_SIGN, _SWAPPED, _HAND, *_UNIT_OF_JOINTS)


def mended(text: str, finding: Finding) -> str:
    """dataset.yaml, changed to correct what a finding reports."""
    document = _document(text)
    columns = {
        name: dict(entry) if isinstance(entry, dict) else {"column": entry}
        for name, entry in document["columns"].items()
    }
    joints = [f"q{k}" for k in finding.evidence.get("joints", [])]
    if missing := [name for name in joints if name not in columns]:
        raise InputError(f"columns: found none that is {missing[0]}, expected the one to be mended")
    if finding.code in (_SIGN, _HAND):
        for name in joints or ["z"]:
            columns[name]["scale"] = -columns[name].get("scale", 1)
    elif finding.code == _SWAPPED:
        columns[joints[0]], columns[joints[1]] = columns[joints[1]], columns[joints[0]]
    elif finding.code in _UNIT_OF_POINTS:
        for name in POSITION:
            read_as = columns[name].get("unit", "m")
            if (unit := true_unit(finding.evidence["scale"], read_as)) is None:
                raise InputError(
                    f"columns: found {name} in {read_as}, expected a unit that explains its size"
                )
            columns[name]["unit"] = unit
    elif finding.code in _UNIT_OF_JOINTS:
        for name in columns:
            if name[:1] == "q" and name[1:].isdigit():
                columns[name]["unit"] = _UNIT_OF_JOINTS[finding.code]
    plain = {name: entry["column"] if list(entry) == ["column"] else entry for name, entry in columns.items()}
    return _text({**document, "columns": plain})


def _document(text: str) -> Document:
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError:
        document = None
    if not isinstance(document, dict):
        raise InputError("dataset.yaml: found no mapping, expected file, separator and columns")
    return document


def _text(document: Document) -> str:
    return yaml.safe_dump(json.loads(json.dumps(document)), sort_keys=False, allow_unicode=True)


def findings_list(findings: list[Finding]) -> Markup:
    """The findings of the check, with a button at those that can be corrected here; notes are folded away."""

    def line(place: int, finding: Finding) -> list[Content]:
        words = " → ".join(part for part in (finding.message, finding.remedy) if part)
        mend = button("Mend this", "open", mend=place) if can_be_mended(finding) else None
        return [f"{finding.severity}: {words} ", mend]

    wrong = [line(k, finding) for k, finding in enumerate(findings) if finding.severity != "note"]
    notes = [line(k, finding) for k, finding in enumerate(findings) if finding.severity == "note"]
    of_notes = folded(plural(len(notes), "note"), listed(notes)) if notes else None
    return tag("div", listed(wrong) if wrong else tag("p", "Nothing is wrong."), of_notes)
