"""Checks of a fit.json read from disk, before anything computes with it (docs/model.md, fit.json)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from armtrue import _core
from armtrue.errors import InputError, did_you_mean
from armtrue.io.catalogue import catalogue
from armtrue.io.model import check_effect, coordinate_names, names_in, own_columns, variables_of
from armtrue.io.robot import Robot, check_robot, pose
from armtrue.io.yamlfile import Section
from armtrue.verdicts import VERDICTS

# Variables for a gear's warmth from its duty, or a low-passed temperature; the time constant is part of the name.
_WARMTH = re.compile(r"\b(?:warm[0-9]+_[0-9]+|lag[0-9]+_\w+)\b")
# Keys that only the report and the command line read; predict, export and diagnose do not need them.
_ALSO: dict[str, type] = {
    **dict.fromkeys(("error", "noise", "noise_floor", "solver"), dict),
    **dict.fromkeys(("rejected", "nonlinear", "unobservable", "warnings"), list),
}


def check_document(document: dict[str, Any], path: Path) -> None:
    """Refuse a fit.json that is incomplete, or was edited into something invalid.

    Errors: InputError naming the key, what was found and what was expected.
    """
    top = Section(document, str(path))
    for key in ("robot", "model", "parameters", "measuring_from_base", "flange_from_tool", "data", "options"):
        if key not in document:
            raise InputError(f"{path}: key '{key}' is missing, expected a complete fit.json")
    check_robot(document["robot"], path, "robot")
    robot = Robot(document["robot"])
    data = top.section("data")
    listed = data.entries("columns", "a list of columns") if data.has("columns") else []
    recorded = [str(name) for name in listed]
    _check_model(top, robot, recorded)
    _check_parameters(top, robot, recorded)
    pose(top.section("measuring_from_base"))
    tools = top.section("flange_from_tool")
    if not list(tools):
        raise top.fail("flange_from_tool", "a pose for each reflector, at least one")
    for name in tools:
        pose(tools.section(name))
    top.numbers("payload_point", 3, "a list [x, y, z] in metres", default=None)
    if top.has("columns"):
        columns = top.section("columns")
        for name in columns:
            if not isinstance(columns.raw(name), str):
                raise columns.fail(name, "the column that stands in for it, or ''")
    top.number("time_origin_s", None, expected="a finite number")
    for key in ("searched", "left_out_effects"):
        for name in top.entries(key, "a list of effects") if top.has(key) else []:
            if not isinstance(name, str):
                raise top.fail(key, "names of effects")
    if top.has("verdict") and document["verdict"] not in VERDICTS:
        raise top.fail("verdict", f"one of {', '.join(VERDICTS)}")
    _check_data(top, list(tools), robot.joint_count)
    for key, kind in _ALSO.items():
        if not isinstance(document.get(key), kind):
            raise top.fail(key, "what armtrue fit writes there" if key in document else "a complete fit.json")
    _check_error(top.section("error"))


def users_parameters(document: dict[str, Any]) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """The parameters of a user's own effects by name, each with the effect's entry in the model."""
    entries = {
        f"{entry['effect']}.{entry['name']}": entry
        for entry in document.get("model", {}).get("effects", [])
        if catalogue()[entry["effect"]].role == "custom"
    }
    named = {parameter.get("name"): parameter for parameter in document["parameters"]}
    return {name: (named[name], entry) for name, entry in entries.items() if name in named}


def own_columns_read(document: dict[str, Any]) -> dict[str, list[str]]:
    """By parameter, the columns outside the contract that a user's effect reads; only parameters that have any."""
    own = own_columns(Robot(document["robot"]), document.get("data", {}).get("columns", []))
    read = {
        name: [column for column in own if column in _read_by(parameter)]
        for name, (parameter, _) in users_parameters(document).items()
    }
    return {name: columns for name, columns in read.items() if columns}


def not_for_a_device(document: dict[str, Any]) -> dict[str, str]:
    """Exported parameters, by name, whose terms read what a device does not know, and why; tables hold their average.

    A user's own term of `time` is among them unless its entry says `measurement: false`: the fit cannot tell creep of
    the arm from creep of the instrument, and on a device time runs on for days.
    """
    own = own_columns_read(document)
    found = {}
    for name, (parameter, entry) in users_parameters(document).items():
        if not parameter.get("exported", True):
            continue
        if name in own:
            columns = ", ".join(own[name])
            found[name] = (
                f"a device does not know column {columns}: its average over the measurements is taken"
            )
        elif "measurement" not in entry and "time" in _read_by(parameter):
            found[name] = (
                "it depends on time, where drift of the arm and of the instrument look the same, and a device's clock "
                "goes on after the session: the session's average is taken; if the arm itself drifts, fit the effect "
                "with 'measurement: false'"
            )
    return found


def at_average(parameter: dict[str, Any], means: dict[str, float]) -> dict[str, Any]:
    """`parameter` with each variable named in `means` replaced by its mean."""

    def replaced(expression: str) -> str:
        return re.sub(
            r"\b[A-Za-z_]\w*",
            lambda found: f"({means[found[0]]!r})" if found[0] in means else found[0],
            expression,
        )

    terms = [{**term, "expression": replaced(term["expression"])} for term in parameter["terms"]]
    return {**parameter, "terms": terms}


def _read_by(parameter: dict[str, Any]) -> set[str]:
    return {name for term in parameter.get("terms", []) for name in names_in(term["expression"])}


def _check_error(error: Section) -> None:
    """Refuse missing error figures: each is a number of micrometres, or null where it is not known."""
    by = error.section("held_out_by")
    scored = [by.section(name) for name in by if by.raw(name) is not None]
    for figures in (*map(error.section, ("nominal", "train", "held_out")), *scored):
        for key in ("mean_um", "rms_um", "p95_um", "max_um"):
            expected = "a number of micrometres, or null"
            if key not in list(figures):
                raise figures.fail(key, expected)
            figures.number(key, None, minimum=0.0, expected=expected)


def _check_model(top: Section, robot: Robot, columns: list[str]) -> None:
    model = top.section("model")
    for number, entry in enumerate(model.sections("effects", "a list of effects"), start=1):
        effect = {key: entry.raw(key) for key in entry}
        check_effect(effect, robot, f"{top.file}: model.effects[{number}]", columns=columns)
    for key in ("parameters", "priors"):
        if model.has(key):
            model.section(key)
    options = top.section("options")
    for key in ("folds", "seed"):
        options.number(key, minimum=0.0, expected="a whole number")
    if options.has("instrument"):
        options.section("instrument")


def _check_parameters(top: Section, robot: Robot, columns: list[str]) -> None:
    targets = len(list(top.section("flange_from_tool")))
    coordinates = coordinate_names(robot.joint_count)
    of_tool = [name for name in coordinates if name.startswith("tool.")]
    coordinates += [name.replace("tool", f"tool[{k}]") for k in range(targets) for name in of_tool]
    states = [*variables_of(robot, columns), *columns]
    known: set[str] = set()
    for parameter in top.sections("parameters", "a list of fitted parameters"):
        for key in ("name", "effect"):
            parameter.text(key)
        parameter.number("value", expected="a finite number")
        parameter.entries("joints", "a list of joint numbers")
        parameter.flag("exported", default=True)
        for term in parameter.sections("terms", "a list of terms"):
            coordinate = term.text("coordinate")
            if coordinate not in coordinates:
                near = did_you_mean(coordinate, coordinates)
                raise term.fail("coordinate", f"a coordinate of the arm{near}")
            term.number("weight", expected="a finite number")
            expression = term.text("expression")
            if expression in known:
                continue
            try:
                _core.check_expression(expression, [*states, *_WARMTH.findall(expression)], [])
            except ValueError as error:
                raise term.fail("expression", f"arithmetic of the state: {error}") from None
            known.add(expression)


def _check_data(top: Section, reflectors: list[str], joint_count: int) -> None:
    data = top.section("data")
    for key in ("path", "relative", "sha256"):
        data.text(key)
    if data.has("means"):
        means = data.section("means")
        for name in means:
            means.number(name, expected="the average of a column")
    for skipped in data.sections("skipped", "a list of rows left out") if data.has("skipped") else []:
        skipped.number("row", minimum=1.0, expected="a row of the file")
        skipped.text("why")
    for row in data.entries("left_out", "a list of rows") if data.has("left_out") else []:
        if type(row) is not int or row < 1:
            raise data.fail("left_out", "rows of the file, counted from 1")
    targets = data.entries("targets", "a list of reflectors") if data.has("targets") else []
    if len(targets) > 1 and sorted(map(str, targets)) != sorted(reflectors):
        raise data.fail("targets", f"those of flange_from_tool: {', '.join(reflectors)}")
    if data.has("ranges"):
        ranges = data.section("ranges")
        columns = [f"q{k}" for k in range(1, joint_count + 1)] + ["time", *(top.raw("columns") or {})]
        known = list(dict.fromkeys(columns))
        for name in ranges:
            if name not in known:
                raise InputError(f"{ranges.place(name)}: found '{name}', expected one of {', '.join(known)}")
            ranges.numbers(name, 2, "the lowest and the highest value that was fitted")
