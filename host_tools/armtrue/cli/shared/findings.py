"""A diagnosis as text in the terminal."""

from __future__ import annotations

import itertools
import shlex
from pathlib import Path
from typing import Any

from rich.table import Table

from armtrue.candidates import entry_of, label, name, parameter_lines
from armtrue.cli.shared.output import Output, plain_table
from armtrue.io.catalogue import catalogue
from armtrue.verdicts import (
    ERROR_FIGURES,
    FLOOR_SOURCES,
    NOT_SCORED,
    OTHER_SENSOR_ADVICE,
    chance,
    needs_words,
    of_other_sensors,
    scored,
    verdict_words,
    why_words,
    with_signs,
)

_CANDIDATES_SHOWN = 10
_MORE_LIKELY_THAN_NOT = 0.5
_COMMAND = "armtrue add FIT"
_LEGEND = (
    "probability: that the arm has it beside what is fitted; explains: share of the squared residual;",
    "separable: share of its effect that what is fitted cannot imitate; ≈: predicted, not refitted;",
    "error if added: mean on held-out poses; ★: recommended",
)


def _runs(numbers: list[int]) -> str:
    """`1, 3–5` for 1, 3, 4, 5."""
    words: list[str] = []
    for _, group in itertools.groupby(enumerate(numbers), key=lambda place: place[1] - place[0]):
        run = [number for _, number in group]
        words += [f"{run[0]}–{run[-1]}"] if len(run) > 2 else map(str, run)
    return ", ".join(words)


def present_diagnosis(
    result: dict[str, Any], output: Output, fit_file: Path, data: Path | None = None
) -> None:
    """Print a diagnosis of `fit_file` as a short report, with the commands that come next."""
    output.title(verdict_words(result))
    held_out = scored(result["error"]["held_out"])
    figures = [
        f"{word} {held_out[key]:.1f} µm" for key, word in ERROR_FIGURES.items() if held_out[key] is not None
    ]
    output.say(f"error on held-out poses: {', '.join(figures) or NOT_SCORED}")
    output.say(floor_words(result))
    _present_structure(result.get("unexplained", []), output)
    _present_candidates(result, output)
    untestable = [
        f"{entry['effect']} needs {needs_words(entry['needs'])}" for entry in result.get("untestable", [])
    ]
    output.items(untestable, "Not testable with what was recorded")
    advice = result.get("advice", [])
    # Untestable effects are already listed above.
    sentences = [line for line in advice if _COMMAND not in line and not line.startswith("not testable")]
    output.items([with_signs(sentence) for sentence in sentences], "Advice")
    if commands := _next_commands(advice, fit_file, data):
        output.title("Next")
        for command in commands:
            output.line(f"  {command}")


def present_added(result: dict[str, Any], output: Output) -> None:
    """Print how probable each effect is that a refinement added."""
    effects = result["effects"]
    lines = [
        f"{name(entry)}: {chance(entry['probability'])}" + (f" ({entry['why']})" if entry.get("why") else "")
        for entry in effects
        if "probability" in entry
    ]
    output.items(lines, "Added, with the probability that the arm has it")
    output.items(_perhaps_of_the_arm(result["steps"], effects), "The instrument or the arm?")


def _perhaps_of_the_arm(steps: list[dict[str, Any]], effects: list[dict[str, Any]]) -> list[str]:
    """Sentences on added effects of the instrument that may be effects of the arm: tables leave them out."""
    present = {label(entry) for entry in effects}
    exported = {info.id for info in catalogue().values() if info.exported}
    lines = []
    for added in (step["added"] for step in steps if step["added"]):
        if label(added) not in present or added["effect"] in exported:
            continue
        rivals = [
            entry for rival in added["confounded_with"] if (entry := entry_of(rival))["effect"] in exported
        ]
        if names := [name(entry) for entry in rivals if label(entry) not in present]:
            lines.append(
                f"{name(added)} can hardly be distinguished from {'; '.join(names)} by these poses, and tables leave "
                "out effects of the measurement: if the arm is the cause, its error stays uncorrected. A length that "
                "is known without this instrument distinguishes them; 'armtrue add' before 'refine' attributes it to "
                "the arm"
            )
    return lines


def _next_commands(advice: list[str], fit_file: Path, data: Path | None) -> list[str]:
    """The commands in the advice, with the user's own files in place of FIT and FIT2."""
    fit, moved = shlex.quote(str(fit_file)), f" --data {shlex.quote(str(data))}" if data else ""
    commands = []
    for line in advice:
        if _COMMAND in line:
            command = line[line.index(_COMMAND) :].replace(" FIT ", f" {fit} ")
            commands.append(f"{command.removesuffix(' FIT2')} {shlex.quote(str(following(fit_file)))}{moved}")
    if any("armtrue plan" in line for line in advice):
        poses = shlex.quote(str(fit_file.with_name("poses.csv")))
        commands.append(f"armtrue plan {fit} --poses 12 --out {poses}{moved}")
    return commands


def following(fit_file: Path) -> Path:
    """fit.json → fit2.json → fit3.json: the first that does not exist."""
    stem = fit_file.stem.rstrip("0123456789") or fit_file.stem
    number = int(fit_file.stem[len(stem) :] or 1)
    files = (fit_file.with_name(f"{stem}{k}{fit_file.suffix}") for k in itertools.count(number + 1))
    return next(file for file in files if not file.exists())


def floor_words(result: dict[str, Any]) -> str:
    """The noise floor of a diagnosis and its source, as text."""
    floor, source = result.get("noise_floor_um"), result.get("noise_floor_source", "none")
    if floor is None and result.get("instrument_floor_um") is not None:
        floor, source = result["instrument_floor_um"], "targets"
    if floor is None:
        return "noise floor not known"
    return f"noise floor {floor:.1f} µm ({FLOOR_SOURCES.get(source, source)})"


def _present_candidates(result: dict[str, Any], output: Output) -> None:
    candidates = result.get("candidates", [])
    if not candidates:
        return
    if result["verdict"] == "nothing_missing":
        nearest = candidates[0]
        output.say(f"probability that nothing is missing: {chance(result['probability_nothing'])}")
        output.say(
            f"nearest candidate: {name(nearest)}, probability {chance(nearest['probability'])}, "
            f"explains {100 * nearest['explained']:.1f} % of the squared residual: {why_words(nearest)}"
        )
        return
    tried, candidates = candidates, candidates[:_CANDIDATES_SHOWN]
    output.say()
    output.table(_candidate_table(candidates))
    for line in _LEGEND:
        output.say(line)
    for candidate in candidates:
        if candidate["recommend"]:
            reasons = [why_words(candidate), *parameter_lines(candidate["parameters"])]
            output.items(reasons, f"Recommended: {name(candidate)}")
            others = [name(other) for other in of_other_sensors(candidate, tried)]
            warmed = [OTHER_SENSOR_ADVICE] if others else []
            others += [name(entry_of(rival)) for rival in candidate["confounded_with"]]
            if others:
                output.items([f"at least 90 % of it is also explained by: {'; '.join(others)}", *warmed])
    likely: list[int] = []
    unlikely: dict[str, list[int]] = {}
    for rank, candidate in enumerate(candidates, start=1):
        if candidate["recommend"]:
            continue
        if candidate["probability"] > _MORE_LIKELY_THAN_NOT:
            likely.append(rank)
        else:
            unlikely.setdefault(why_words(candidate), []).append(rank)
    if likely:
        words = "probability above 50 %; armtrue refine adds those that lower the held-out error"
        output.items([f"{_runs(likely)}: {words}"], "Probably also missing")
    output.items([f"{_runs(ranks)}: {why}" for why, ranks in unlikely.items()], "Not recommended")


def _candidate_table(candidates: list[dict[str, Any]]) -> Table:
    table = plain_table("", "candidate", "probability", "explains", "separable", "error if\nadded [µm]", "")
    table.columns[1].justify = "left"
    for rank, candidate in enumerate(candidates, start=1):
        after = candidate["held_out_mean_um_if_added"]
        table.add_row(
            f"{rank:>2}",
            name(candidate),
            chance(candidate["probability"]),
            f"{100 * candidate['explained']:.1f} %",
            f"{100 * candidate['separability']:.1f} %",
            NOT_SCORED if after is None else f"≈ {after:.1f}",
            "★" if candidate["recommend"] else "",
        )
    return table


def _present_structure(findings: list[dict[str, Any]], output: Output) -> None:
    lines: dict[tuple[str, str], str] = {}
    for finding in findings:
        joints = ", ".join(map(str, finding["joints"]))
        where = f" (joint{'s' if len(finding['joints']) > 1 else ''} {joints})" if joints else ""
        variable = "no recorded variable" if finding["variable"] == "none recorded" else finding["variable"]
        # The same finding on another coordinate is printed once.
        lines.setdefault(
            (finding["variable"], joints),
            f"depends on {variable}{where}: {with_signs(finding['shape'])} (log10 p {finding['log10_p']:.1f})",
        )
    output.items(list(lines.values()), "Left over")
