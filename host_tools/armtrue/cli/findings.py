"""A diagnosis as people read it in the terminal."""

from __future__ import annotations

import json
import re
import statistics
from typing import Any

from rich.table import Table

from armtrue.cli.fitting import FLOOR_SOURCES
from armtrue.cli.output import Output, plain_table
from armtrue.cli.units import value_and_sigma
from armtrue.verdicts import OTHER_SENSOR_ADVICE, of_other_sensors, sensor_of, verdict_words

_CANDIDATES_SHOWN = 10
_ERROR_FIGURES = {"mean_um": "mean", "rms_um": "RMS", "p95_um": "95 %", "max_um": "max"}
_LEGEND = (
    "probability: that the arm has it beside what is fitted; explains: share of the squared residual;",
    "separable: share of its effect that what is fitted cannot imitate; ≈: predicted, not refitted",
)


def name(entry: dict[str, Any]) -> str:
    """`effect [joints]` of a candidate or an added effect."""
    joints = entry.get("joints") or []
    options = entry.get("options") or {}
    cycles = ", ".join(f"{value:g}" for value in options.get("cycles") or [])
    return (
        str(entry["effect"])
        + (f" [{_joint_words(joints)}]" if joints else "")
        + (f" {cycles} cycles a turn" if cycles else "")
    )


def called(entry: dict[str, Any]) -> str:
    """The `name` of a candidate or an effect, and the orders that tell it from others on the same joint."""
    orders = ", ".join(f"{value:g}" for value in (entry.get("options") or {}).get("orders") or [])
    return name(entry) + (f", order {orders}" if orders else "")


def _called_among(entry: dict[str, Any], candidates: list[dict[str, Any]]) -> str:
    """`called`, with the sensor where `candidates` read several."""
    sensors = {sensor_of(other) for other in candidates} - {None}
    sensor = sensor_of(entry)
    return called(entry) + (f", sensor {sensor}" if sensor is not None and len(sensors) > 1 else "")


def _runs(numbers: list[int]) -> str:
    """`1, 3–5` for 1, 3, 4, 5."""
    words: list[str] = []
    first = 0
    for at, number in enumerate(numbers):
        if at + 1 < len(numbers) and numbers[at + 1] == number + 1:
            continue
        run = numbers[first : at + 1]
        words += [f"{run[0]}–{run[-1]}"] if len(run) > 2 else map(str, run)
        first = at + 1
    return ", ".join(words)


def _joint_words(joints: list[int]) -> str:
    """`1–6` for a run of three and more, else the numbers."""
    if len(joints) > 2 and joints == list(range(joints[0], joints[-1] + 1)):
        return f"{joints[0]}–{joints[-1]}"
    return ", ".join(map(str, joints))


def present_diagnosis(result: dict[str, Any], output: Output) -> None:
    """Print a diagnosis as a short report."""
    output.title(verdict_words(result))
    held_out = result["error"]["held_out"]
    figures = ", ".join(f"{word} {held_out[key]:.1f} µm" for key, word in _ERROR_FIGURES.items())
    output.say(f"error on held-out poses: {figures}")
    output.say(floor_words(result))
    _present_structure(result.get("unexplained", []), output)
    _present_candidates(result, output)
    if result.get("untestable"):
        output.title("Not testable with what was recorded")
        output.items([f"{entry['effect']} needs {_words(entry['needs'])}" for entry in result["untestable"]])
    if result.get("advice"):
        output.title("Advice")
        output.items(result["advice"])


def floor_words(result: dict[str, Any]) -> str:
    """The noise floor of a diagnosis, and what tells it."""
    floor, source = result.get("noise_floor_um"), result.get("noise_floor_source", "none")
    if floor is None and result.get("instrument_floor_um") is not None:
        floor, source = result["instrument_floor_um"], "targets"
    if floor is None:
        return "noise floor not known"
    return f"noise floor {floor:.1f} µm ({FLOOR_SOURCES.get(source, source)})"


def parameter_lines(parameters: list[dict[str, Any]]) -> list[str]:
    """Each parameter with its sigma; a table or grid as one line."""
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
            f"each ± {spread} {spread_unit} (median)"
        )
    return lines


def _present_candidates(result: dict[str, Any], output: Output) -> None:
    candidates = result.get("candidates", [])
    if not candidates:
        return
    if result["verdict"] == "nothing_missing":
        nearest = candidates[0]
        output.say(f"nothing is missing: {_chance(result['probability_nothing'])}")
        output.say(
            f"nearest to an effect: {_called_among(nearest, candidates)}, {_chance(nearest['probability'])}, "
            f"{100 * nearest['explained']:.1f} % "
            f"of the squared residual: {_typeset(nearest['why'])}"
        )
        return
    tried, candidates = candidates, candidates[:_CANDIDATES_SHOWN]
    output.say()
    output.table(_candidate_table(candidates, tried))
    for line in _LEGEND:
        output.say(line)
    for candidate in candidates:
        if candidate["recommend"]:
            output.title(f"Recommended: {_called_among(candidate, tried)}")
            output.items([_typeset(candidate["why"]), *parameter_lines(candidate["parameters"])])
            others = [_called_among(other, tried) for other in of_other_sensors(candidate, tried)]
            warmed = [OTHER_SENSOR_ADVICE] if others else []
            others += [called(entry_of(label)) for label in candidate["confounded_with"]]
            if others:
                output.items([f"nearly as much is explained by: {', '.join(others)}", *warmed])
    reasons: dict[str, list[int]] = {}
    for rank, candidate in enumerate(candidates, start=1):
        if not candidate["recommend"]:
            reasons.setdefault(_typeset(candidate["why"]), []).append(rank)
    if reasons:
        output.title("Not recommended")
        output.items([f"{_runs(ranks)}: {why}" for why, ranks in reasons.items()])


def _chance(probability: float) -> str:
    """A probability in percent; near 0 and 1 as the bound that sampling can support."""
    if probability > 0.995:
        return "> 99 %"
    return "< 1 %" if probability < 0.005 else f"{100 * probability:.0f} %"


def _candidate_table(candidates: list[dict[str, Any]], tried: list[dict[str, Any]]) -> Table:
    headers = ("probability", "explains", "separable", "held-out mean\nif added [µm]", "")
    table = plain_table("    candidate", *headers)
    for rank, candidate in enumerate(candidates, start=1):
        table.add_row(
            f"{rank:>2}  {_called_among(candidate, tried)}",
            _chance(candidate["probability"]),
            f"{100 * candidate['explained']:.1f} %",
            f"{100 * candidate['separability']:.1f} %",
            f"≈ {candidate['held_out_mean_um_if_added']:.1f}",
            "recommended" if candidate["recommend"] else "",
        )
    return table


def _present_structure(findings: list[dict[str, Any]], output: Output) -> None:
    lines: dict[tuple[str, str], str] = {}
    for finding in findings:
        joints = ", ".join(map(str, finding["joints"]))
        where = f" (joint{'s' if len(finding['joints']) > 1 else ''} {joints})" if joints else ""
        variable = "no recorded variable" if finding["variable"] == "none recorded" else finding["variable"]
        # The same on another coordinate is said once.
        lines.setdefault(
            (finding["variable"], joints),
            f"depends on {variable}{where}: {finding['shape']} (log10 p {finding['log10_p']:.1f})",
        )
    if lines:
        output.title("Left over")
        output.items(list(lines.values()))


def entry_of(label: str) -> dict[str, Any]:
    """Effect, joints and options of a candidate that the diagnosis names as `gear_mesh 3 orders [13]`."""
    found = re.fullmatch(r"(\S+)(?: ([\d,]+))?(?: (orders|cycles) (\[.*\]))?", label)
    if found is None:
        return {"effect": label}
    joints = [int(joint) for joint in found[2].split(",")] if found[2] else []
    options = {found[3]: json.loads(found[4])} if found[3] else {}
    return {"effect": found[1], "joints": joints, "options": options}


def _typeset(sentence: str) -> str:
    """A sentence of the diagnosis, which is plain ASCII, with its units and arrows as they are printed."""
    return sentence.replace(" um", " µm").replace("->", "→")


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
