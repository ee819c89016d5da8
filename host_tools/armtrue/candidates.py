"""Candidates of a diagnosis as people name them, the same in the terminal, the report and the workbench."""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from armtrue.units import value_and_sigma


def options_of(entry: dict[str, Any]) -> dict[str, Any]:
    """The options of a candidate (its key `options`), or of a model's effect, which has them among its other keys."""
    if isinstance(options := entry.get("options"), dict):
        return options
    return {key: value for key, value in entry.items() if key not in ("effect", "joints", "probability")}


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
    """`effect [joints]` of a candidate or an added effect."""
    joints = entry.get("joints") or []
    options = options_of(entry)
    cycles = ", ".join(f"{value:g}" for value in options.get("cycles") or [])
    lengths = ", ".join(f"{1e3 * value:g}" for value in options.get("wavelengths") or [])
    return (
        str(entry["effect"])
        + (f" [{joint_words(joints)}]" if joints else "")
        + (f" {cycles} cycles a turn" if cycles else "")
        + (f" waves of {lengths} mm" if lengths else "")
    )


def called(entry: dict[str, Any], others: Sequence[dict[str, Any]] = ()) -> str:
    """The `name` of a candidate or effect, with the orders and options that distinguish it from `others`."""
    orders = ", ".join(f"{value:g}" for value in options_of(entry).get("orders") or [])
    return ", ".join([name(entry), *([f"order {orders}"] if orders else []), *form_words(entry, others)])


def form_words(entry: dict[str, Any], others: Sequence[dict[str, Any]] = ()) -> list[str]:
    """Options that distinguish variants of an effect (`shape beam`, `soft`); the sensor if `others` read several."""
    options = options_of(entry)
    words = [f"{key} {options[key]}" for key in ("shape", "name") if options.get(key)]
    words += ["soft"] if options.get("soft") else []
    sensors = {options_of(other).get("sensor") for other in others} - {None}
    if options.get("sensor") in sensors and len(sensors) > 1:
        words.append(f"sensor {options['sensor']}")
    return words


def joint_words(joints: list[int]) -> str:
    """`1–6` for a run of three and more, else the numbers."""
    if len(joints) > 2 and joints == list(range(joints[0], joints[-1] + 1)):
        return f"{joints[0]}–{joints[-1]}"
    return ", ".join(map(str, joints))


def entry_of(label: str) -> dict[str, Any]:
    """Effect, joints and options of a candidate that the diagnosis names as `gear_mesh 3 orders [13]`."""
    found = re.fullmatch(r"(\S+)(?: ([\d,]+))?(?: (orders|cycles|wavelengths) (\[.*\]))?", label)
    if found is None:
        return {"effect": label}
    joints = [int(joint) for joint in found[2].split(",")] if found[2] else []
    options = {found[3]: json.loads(found[4])} if found[3] else {}
    return {"effect": found[1], "joints": joints, "options": options}


def parameter_lines(parameters: list[dict[str, Any]]) -> list[str]:
    """Each parameter of a candidate with its sigma; one line for a table or grid, whose nodes are the score's."""
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
            f"{stem}: {len(nodes)} nodes from {low} {unit} to {high} {high_unit}, "
            f"each ± {spread} {spread_unit} (median); these nodes are the score's, a fit has its own"
        )
    return lines
