"""Prints the parameters of a fit: with sigma, unit, the nominal value, and ties between parameters."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from armtrue import notebook
from armtrue.cli.shared.output import Output, plain_table
from armtrue.units import plural, value_and_sigma

# Tables can have hundreds of parameters; more than this are shown only when asked for.
_SHOWN = 60
# From this correlation on, the combination of two parameters is known better than each of them.
_TIED = 0.95
# A value beyond its bound by less than this many standard deviations may be inside.
_SIGMAS = 2.0


def present_parameters(document: dict[str, Any], output: Output, everything: bool) -> None:
    """Print base and tool, then the parameters that are not held at nominal."""
    output.title("Base and tool")
    poses = plain_table(*notebook.POSE_HEADERS)
    for row in notebook.pose_rows(document):
        poses.add_row(*row)
    output.table(poses)
    parameters = notebook.beside_the_poses(document)
    told = [entry for entry in parameters if not entry.get("held")]
    held = len(parameters) - len(told)
    output.title(plural(len(told), "parameter") + (f", and {held} held at nominal" if held else ""))
    if not everything and len(told) > _SHOWN:
        by_effect: dict[str, int] = {}
        for entry in told:
            by_effect[entry["effect"]] = by_effect.get(entry["effect"], 0) + 1
        output.items([f"{effect}: {count}" for effect, count in by_effect.items()])
        output.say("  (--parameters prints each)")
        told = [entry for entry in told if outside_words(entry)]
        if not told:
            return
    output.table(_parameter_table(told, document["robot"]))
    output.say("value: where the column nominal has a figure, what the fit adds to it")


def _parameter_table(parameters: list[dict[str, Any]], robot: dict[str, Any]) -> Table:
    table = plain_table("parameter", "value", "± sigma", "unit", "nominal", "note")
    for entry in parameters:
        value, sigma, unit = value_and_sigma(entry["value"], entry.get("sigma"), entry["unit"])
        if entry.get("fixed"):
            sigma = "fixed"
        ties = [tie for tie in entry.get("correlations", []) if abs(tie["r"]) >= _TIED]
        notes = [f"tied to {tie['with']} ({tie['r']:+.3f})" for tie in ties]
        outside = outside_words(entry)
        notes = [outside, *notes] if outside else notes
        table.add_row(
            entry["name"], value, sigma, unit, notebook.nominal_words(entry["name"], robot), ", ".join(notes)
        )
    return table


def outside_words(parameter: dict[str, Any]) -> str:
    """`outside 0 to 200 µrad/Nm` if the value is beyond its bound by more than its uncertainty, else an empty text."""
    bound = parameter.get("bound") or 0.0
    if not bound or parameter.get("held") or parameter.get("fixed"):
        return ""
    sign = parameter.get("sign", 0)
    # The range of a parameter with a physical sign, such as a compliance, ends at zero.
    lowest, highest = (0.0 if sign > 0 else -bound), (0.0 if sign < 0 else bound)
    margin = _SIGMAS * (parameter.get("sigma") or 0.0)
    if lowest - margin <= parameter["value"] <= highest + margin:
        return ""
    words, _, unit = value_and_sigma(bound, None, parameter["unit"])
    if sign:
        return f"outside {f'0 to {words}' if sign > 0 else f'-{words} to 0'} {unit}"
    return f"outside ±{words} {unit}"
