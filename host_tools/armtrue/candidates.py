"""Names of effects and candidates: one spelling for the terminal, the report and the workbench."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Mapping
from typing import Any

from armtrue.units import plural, value_and_sigma

# Options with lists of numbers: words before, factor from SI units, words after. They are part of a label.
_LISTS = {
    "orders": ("order ", 1.0, ""),
    "cycles": ("", 1.0, " cycles a turn"),
    "wavelengths": ("waves of ", 1e3, " mm"),
}
_UNITS = {"tau": " s", "soft_torque": " Nm", "theta0": " rad"}
_LABEL = rf"(\w+)(?: ([\d,]+))?(?: ({'|'.join(_LISTS)}) (\[[^\]]*\]))"


def options_of(entry: dict[str, Any]) -> dict[str, Any]:
    """The options of a candidate (its key `options`), or of a model's effect, which has them among its other keys."""
    if isinstance(options := entry.get("options"), dict):
        return options
    return {k: value for k, value in entry.items() if k not in ("effect", "joints", "probability", "why")}


def model_entry(candidate: Mapping[str, Any]) -> dict[str, Any]:
    """A candidate as an entry of model.yaml."""
    entry = {"effect": candidate["effect"], **(candidate.get("options") or {})}
    if candidate.get("joints"):
        entry["joints"] = list(candidate["joints"])
    return entry


def option_words(entry: dict[str, Any]) -> list[str]:
    """The options as `--option` takes them, NAME=VALUE each."""
    return [f"{key}={json.dumps(value)}" for key, value in options_of(entry).items()]


def name(entry: dict[str, Any]) -> str:
    """An effect, candidate or entry of a model as people read it: `gear_mesh 2 (99.5 cycles a turn)`.

    The joints are as `--joints` takes them. The options are all those that distinguish one variant from another.
    """
    joints = ",".join(map(str, entry.get("joints") or []))
    options = options_of(entry)
    # A user's own effect is known by its name.
    shown = {"name": options["name"]} if "name" in options else options
    words = [word for key, value in shown.items() if (word := _option(key, value))]
    return " ".join(
        [entry["effect"], *([joints] if joints else []), *([f"({', '.join(words)})"] if words else [])]
    )


def _option(key: str, value: Any) -> str:
    """An option in words; empty for one that is off, or that no word can show, as the nodes of a table."""
    if key in _LISTS and value:
        before, factor, after = _LISTS[key]
        figures = ", ".join(f"{factor * figure:.5g}" for figure in value)
        return f"{before if len(value) == 1 else before.replace('order', 'orders')}{figures}{after}"
    if value is True:
        return key
    if isinstance(value, str):
        return value if key == "name" else f"{key} {value}"
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{key} {value:.5g}{_UNITS.get(key, '')}" if is_number else ""


def label(entry: dict[str, Any]) -> str:
    """A candidate as `confounded_with` of a diagnosis lists it: `gear_mesh 3 orders [13]`."""
    options = options_of(entry)
    given = {key: ",".join(f"{figure:.6g}" for figure in options.get(key) or []) for key in _LISTS}
    lists = [f"{key} [{figures}]" for key, figures in given.items() if figures]
    return " ".join([name({key: entry.get(key) for key in ("effect", "joints")}), *lists])


def spelled(sentence: str) -> str:
    """A sentence of the diagnosis with each effect of orders, cycles or wavelengths as `name` spells it."""
    return re.sub(_LABEL, lambda found: name(entry_of(found[0])), sentence)


def joint_words(joints: list[int]) -> str:
    """`1–6` for a run of three and more, else the numbers."""
    if len(joints) > 2 and joints == list(range(joints[0], joints[-1] + 1)):
        return f"{joints[0]}–{joints[-1]}"
    return ", ".join(map(str, joints))


def entry_of(candidate: str) -> dict[str, Any]:
    """An entry of model.yaml from a candidate as a diagnosis names it (`gear_mesh 2 cycles [13]`) or a shell argument.

    The latter is as `argument_of` gives it: `gear_mesh:2:cycles=13` or `thermal_base:sensor=arm`. Raises ValueError
    where `candidate` has another form.
    """
    match = _CANDIDATE.fullmatch(candidate.strip())
    if match is None:
        raise ValueError(f"found '{candidate}', expected EFFECT, EFFECT:2,3 or EFFECT:2:cycles=13")
    entry: dict[str, Any] = {"effect": match["effect"]}
    if match["option"]:
        entry[match["option"]] = [_number(text) for text in match["values"].split(",")]
    if match["sensor"]:
        entry["sensor"] = match["sensor"]
    if match["joints"]:
        entry["joints"] = [int(text) for text in re.split("[ ,]", match["joints"])]
    return entry


def argument_of(candidate: str) -> str:
    """A candidate as a diagnosis names it, written as one word of a command line."""
    named, _, sensor = candidate.partition(" sensor ")
    effect, *rest = named.translate(str.maketrans("", "", "[]")).split(" ")
    joints = rest[:1] if len(rest) % 2 else []
    options = [f"{key}={value}" for key, value in zip(*[iter(rest[len(joints) :])] * 2, strict=True)]
    options += [f"sensor={sensor}"] if sensor else []
    return ":".join([effect, *joints, *options])


_CANDIDATE = re.compile(
    r"(?P<effect>\w+)(?:[ :](?P<joints>\d+(?:[ ,]\d+)*))?"
    rf"(?:[ :](?P<option>{'|'.join(_LISTS)})[ =]\[?(?P<values>\d[-+.\de]*(?:,\d[-+.\de]*)*)\]?)?"
    r"(?:[ :]sensor[ =](?P<sensor>.+))?"
)


def _number(text: str) -> float | int:
    value = float(text)  # ValueError for text that passes _CANDIDATE but is no number, such as 1-2
    return int(value) if value.is_integer() else value


def parameter_lines(parameters: list[dict[str, Any]]) -> list[str]:
    """Each parameter of a candidate with its sigma; one line for a table or grid."""
    tables: dict[str, list[dict[str, Any]]] = {}
    lines = []
    for parameter in parameters:
        stem, is_node, _ = parameter["name"].rpartition(".node")
        if is_node:
            tables.setdefault(stem, []).append(parameter)
            continue
        value, sigma, unit = value_and_sigma(parameter["value"], parameter["sigma"], parameter["unit"])
        spread = f" ± {sigma}" if sigma else ""
        lines.append(f"{parameter['name']} = {value}{spread} {unit}")
    for stem, nodes in tables.items():
        values = [node["value"] for node in nodes]
        typical = statistics.median(node["sigma"] or 0.0 for node in nodes)
        low, _, unit = value_and_sigma(min(values), None, nodes[0]["unit"])
        high, _, high_unit = value_and_sigma(max(values), None, nodes[0]["unit"])
        spread, _, spread_unit = value_and_sigma(typical, None, nodes[0]["unit"])
        lines.append(
            f"{stem}: {plural(len(nodes), 'node')} from {low} {unit} to {high} {high_unit}, typically ± {spread} "
            f"{spread_unit}; a fit chooses its own nodes"
        )
    return lines
