"""The commands diagnose, refine and report."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Annotated, Any

import typer

from armtrue.cli.options import FitArgument, JsonOption, OutOption
from armtrue.cli.output import Output, plain_table, waiting
from armtrue.cli.units import value_and_sigma
from armtrue.io.files import check_writable

_VERDICTS = {
    "nothing_missing": "Nothing is missing: what is left is noise.",
    "missing_effect": "An effect is missing.",
    "unexplained_structure": "What is left has structure that no effect of the catalogue explains.",
}
_CANDIDATES_SHOWN = 10
_BAR_CELLS = 30


def add_to(app: typer.Typer) -> None:
    """Add the commands to `app`."""
    app.command()(diagnose)
    app.command()(refine)
    app.command()(report)


def diagnose(fit_file: FitArgument, json_to: JsonOption = None) -> None:
    """Say which physical effect a fit lacks, on which joint, how sure that is, and what else it could be.

    Example: [bold]armtrue diagnose fit.json[/]
    """
    from armtrue import diagnosis, fitting

    output = Output(json_to)
    fit = fitting.Fit.load(fit_file)
    with waiting() as progress:
        result = diagnosis.diagnose(fit, progress=progress)
    present_diagnosis(result, output)
    output.figures(result)


def refine(fit_file: FitArgument, out: OutOption, json_to: JsonOption = None) -> None:
    """Diagnose and add until nothing is missing, printing how the error falls step by step.

    Interrupted (Ctrl-C), the last finished step is kept in FILE.

    Example: [bold]armtrue refine fit.json --out best.json[/]
    """
    from armtrue import diagnosis, fitting

    output = Output(json_to)
    check_writable(out)
    fit = fitting.Fit.load(fit_file)
    waterfall = Waterfall(output)

    def keep(fit_so_far: fitting.Fit, step: dict[str, Any]) -> None:
        fit_so_far.save(out)
        waterfall.add(step)

    try:
        with waiting() as progress:
            refined, result = diagnosis.refine(fit, progress=progress, on_step=keep)
    except KeyboardInterrupt:
        kept = f"{out} holds the last finished step" if waterfall.steps else "no step was finished"
        output.say(f"\nstopped: {kept}")
        raise
    refined.save(out)
    if result.get("steps"):
        present_diagnosis(result["steps"][-1], output)
    output.say(f"\nwritten: {out}")
    output.figures(result)


def report(
    fit_files: Annotated[
        list[Path], typer.Argument(metavar="FIT…", help="Fits, first to last step.", show_default=False)
    ],
    out: OutOption,
) -> None:
    """Write one self-contained HTML page: where it fails, what is missing, how the error fell.

    Example: [bold]armtrue report fit.json best.json --out report.html[/]
    """
    from armtrue import fitting
    from armtrue import report as report_writer

    check_writable(out)
    report_writer.write([fitting.Fit.load(path) for path in fit_files], out)
    Output(None).say(f"written: {out}")


class Waterfall:
    """The error's fall, one line a step as the steps are finished: held-out mean, a bar, and what changed.

    A bar is as long as its share of the first step's error; `│` stands where the noise floor is.
    """

    def __init__(self, output: Output) -> None:
        self._output = output
        self._first_um = 0.0
        self.steps = 0

    def add(self, step: dict[str, Any]) -> None:
        """Print the next step."""
        held_out = step["error"]["held_out"]
        if self.steps == 0:
            self._first_um = held_out["mean_um"]
            self._output.say(
                f"{'step':>4}  {'mean':>8}  {'95 %':>8}  held-out error [µm]{'':11}  what changed"
            )
        changes = [f"+ {name(step['added'])}"] if step.get("added") else []
        changes += [f"− {name(removed)}" for removed in step.get("removed") or []]
        bar = self._bar(held_out["mean_um"], step.get("noise_floor_um"))
        self._output.say(
            f"{self.steps:>4}  {held_out['mean_um']:>8.1f}  {held_out['p95_um']:>8.1f}  {bar}  "
            f"{', '.join(changes) or 'as it stood'}"
        )
        self.steps += 1

    def _bar(self, mean_um: float, floor_um: float | None) -> str:
        per_cell = self._first_um / _BAR_CELLS or 1.0
        length = min(_BAR_CELLS, max(1, round(mean_um / per_cell)))
        cells = list("█" * length + " " * (_BAR_CELLS - length))
        if floor_um is not None and floor_um < self._first_um:
            cells[int(floor_um / per_cell)] = "│"
        return "".join(cells)


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


def _joint_words(joints: list[int]) -> str:
    """`1–6` for a run of three and more, else the numbers."""
    if len(joints) > 2 and joints == list(range(joints[0], joints[-1] + 1)):
        return f"{joints[0]}–{joints[-1]}"
    return ", ".join(map(str, joints))


def present_diagnosis(result: dict[str, Any], output: Output) -> None:
    """Print a diagnosis as a short report."""
    output.title(_VERDICTS.get(result["verdict"], result["verdict"]))
    error = result["error"]
    floor = result.get("noise_floor_um")
    output.say(
        f"error on held-out poses: mean {error['held_out']['mean_um']:.1f} µm, "
        f"95 % {error['held_out']['p95_um']:.1f} µm; "
        + (
            "noise floor not known"
            if floor is None
            else f"noise floor {floor:.1f} µm ({result['noise_floor_source']})"
        )
    )
    candidates = result.get("candidates", [])[:_CANDIDATES_SHOWN]
    if candidates and result["verdict"] != "nothing_missing":
        table = plain_table("candidate", "explains", "log10 p", "ΔBIC", "held-out mean if added [µm]", "")
        for candidate in candidates:
            held_out = candidate.get("held_out_mean_um_if_added")
            table.add_row(
                name(candidate),
                f"{100 * candidate['explained']:.1f} %",
                f"{candidate['log10_p']:.1f}",
                f"{candidate['delta_bic']:.0f}",
                "" if held_out is None else f"{held_out:.1f}",
                "recommended" if candidate.get("recommend") else "",
            )
        output.table(table)
        for candidate in candidates:
            if candidate.get("recommend"):
                output.say(f"{name(candidate)}: {candidate.get('why', '')}")
                for line in _parameter_lines(candidate.get("parameters", [])):
                    output.say(f"  {line}")
                if candidate.get("confounded_with"):
                    others = ", ".join(
                        name(other) if isinstance(other, dict) else str(other)
                        for other in candidate["confounded_with"]
                    )
                    output.say(f"  this data cannot tell it from: {others}")
    said = set()
    for unexplained in result.get("unexplained", []):
        joints = ", ".join(map(str, unexplained.get("joints", [])))
        key = (unexplained["variable"], joints)
        if key in said:  # the same on another coordinate
            continue
        said.add(key)
        output.say(
            f"left over, depends on {unexplained['variable']}{f' (joints {joints})' if joints else ''}: "
            f"{unexplained.get('shape', '')} (log10 p {unexplained['log10_p']:.1f})"
        )
    if result.get("untestable"):
        output.title("Not testable with what was recorded")
        output.items([f"{entry['effect']} needs {_words(entry['needs'])}" for entry in result["untestable"]])
    if result.get("advice"):
        output.title("Advice")
        output.items(result["advice"])


def _parameter_lines(parameters: list[dict[str, Any]]) -> list[str]:
    """Each parameter with its sigma; a table or grid as one line."""
    tables: dict[str, list[dict[str, Any]]] = {}
    lines = []
    for parameter in parameters:
        stem, _, node = parameter["name"].rpartition(".node")
        if node:
            tables.setdefault(stem, []).append(parameter)
            continue
        value, sigma, unit = value_and_sigma(parameter["value"], parameter["sigma"], parameter["unit"])
        lines.append(f"{parameter['name']} = {value} ± {sigma} {unit}")
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


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
