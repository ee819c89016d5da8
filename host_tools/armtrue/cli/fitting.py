"""The commands fit, add and remove."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from armtrue import notebook
from armtrue.candidates import option_words
from armtrue.cli.shared.fits import load_measurements, load_with_data
from armtrue.cli.shared.options import (
    DataArgument,
    FitArgument,
    FoldsOption,
    JsonOption,
    ModelOption,
    MovedDataOption,
    OutOption,
    RobotOption,
    SeedOption,
    SkipBadOption,
)
from armtrue.cli.shared.output import Output, plain_table, waiting
from armtrue.errors import ForeignError, InputError, did_you_mean
from armtrue.io import load_model, load_robot
from armtrue.io.catalogue import catalogue
from armtrue.io.model import check_effect
from armtrue.io.plausible import refuse_too_few_poses
from armtrue.notebook import floor_sentence
from armtrue.units import plural, value_and_sigma
from armtrue.verdicts import ERROR_FIGURES, PARTS_OF_ERROR, error_words

if TYPE_CHECKING:
    from armtrue.fitting import Fit

# Tables can have hundreds of parameters; more than this are shown only when asked for.
_SHOWN = 60
# From this correlation on, the combination of two parameters is known better than each of them.
_TIED = 0.95
# A value beyond its bound by less than this many standard deviations may be inside.
_SIGMAS = 2.0

JointsOption = Annotated[
    str | None,
    typer.Option("--joints", metavar="K,K…", help="Joints, counted from 1; default: all of the effect."),
]
EffectOption = Annotated[
    list[str] | None,
    typer.Option("--option", metavar="NAME=VALUE", help="An option of the effect; may be repeated."),
]


def fit(
    data: DataArgument,
    robot: RobotOption,
    model: ModelOption,
    out: OutOption,
    folds: FoldsOption = 5,
    seed: SeedOption = 0,
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Print every parameter, tables too.")
    ] = False,
    skip_bad: SkipBadOption = False,
    leave_out: Annotated[
        str | None,
        typer.Option("--leave-out", metavar="ROW,ROW…", help="Rows of the file that are known to be wrong."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Fit even if the checks report an error.")] = False,
    json_to: JsonOption = None,
) -> None:
    """Fit the model's effects to measurements, and print how well it predicts held-out poses.

    Base and tool are found from the data where robot.yaml does not give them. Gross errors are found and left out.
    Refuses measurements that do not follow the arm, such as those of a reversed joint; see --force.

    Example: armtrue fit data.csv --robot robot.yaml --model model.yaml --out fit.json
    """
    from armtrue import fitting
    from armtrue.checking import refuse_what_cannot_be_an_arm, warnings_of_fit

    output = Output(json_to)
    arm = load_robot(robot)
    try:
        measurements = load_measurements(data, arm, [out, json_to], skip_bad=skip_bad)
    except ForeignError as error:
        raise InputError(f"{error} --model {shlex.quote(str(model))}") from None
    effects = load_model(model, arm, measurements.columns)
    if leave_out is not None:
        rows = _whole_numbers(leave_out, "--leave-out", "row numbers such as 12,40")
        measurements = measurements.without(rows)
    refuse_too_few_poses(measurements.file, measurements.joints)
    doubts = [] if force else refuse_what_cannot_be_an_arm(measurements, arm)
    with waiting(output) as progress:
        result = fitting.fit(measurements, arm, effects, folds=folds, seed=seed, progress=progress)
    result.document["warnings"] += doubts + warnings_of_fit(result.document["measuring_from_base"], arm)
    result.save(out)
    output.items(measurements.notes)
    present_fit(result, output, all_parameters=parameters)
    output.say(f"\nwritten: {out}")
    output.figures(summary(result))


def add(
    fit_file: FitArgument,
    effect: Annotated[
        str, typer.Argument(metavar="EFFECT", help="Effect of the catalogue, such as gear_harmonics.")
    ],
    out: OutOption,
    joints: JointsOption = None,
    option: EffectOption = None,
    data: MovedDataOption = None,
    json_to: JsonOption = None,
) -> None:
    """Add an effect to a fit, fit again, and print how the error fell.

    Example: armtrue add fit.json gear_harmonics --joints 3 --out fit2.json
    """
    from armtrue import fitting

    output = Output(json_to)
    before = load_with_data(fit_file, data, [out, json_to])
    wanted = {**_options(option or []), "effect": effect}
    if joints is not None:
        wanted["joints"] = _whole_numbers(joints, "--joints", "joint numbers such as 2,3")
    already = [*before.effects, *_effects_with_joints(before)]
    entry = check_effect(wanted, before.robot, str(fit_file), already, before.data.columns)
    try:
        with waiting(output) as progress:
            after = fitting.with_effects(before, [*before.effects, entry], progress=progress)
    except InputError as error:
        raise InputError(f"{fit_file}: {effect} cannot be added: {error}") from None
    _keep_change(before, after, out, output)


def remove(
    fit_file: FitArgument,
    effect: Annotated[
        str, typer.Argument(metavar="EFFECT", help="Effect of the model, such as joint_compliance.")
    ],
    out: OutOption,
    joints: JointsOption = None,
    option: EffectOption = None,
    data: MovedDataOption = None,
    json_to: JsonOption = None,
) -> None:
    """Remove an effect from a fit, fit again, and print what that does to the error: the opposite of 'add'.

    Where a model has an effect more than once, --option selects one: orders=[13].

    Example: armtrue remove fit2.json gear_harmonics --joints 3 --out fit3.json
    """
    from armtrue import fitting

    output = Output(json_to)
    before = load_with_data(fit_file, data, [out, json_to])
    wanted = {**_options(option or []), "effect": effect}
    on = None if joints is None else _whole_numbers(joints, "--joints", "joint numbers such as 2,3")
    kept = _without(before, wanted, on, fit_file)
    with waiting(output) as progress:
        after = fitting.with_effects(before, kept, progress=progress)
    _keep_change(before, after, out, output)


def _keep_change(before: Fit, after: Fit, out: Path, output: Output) -> None:
    after.save(out)
    table = plain_table("error [µm]", *ERROR_FIGURES.values())
    for name, fitted in (("before", before), ("after", after)):
        for part in ("train", "held_out"):
            table.add_row(f"{name}, {PARTS_OF_ERROR[part]}", *error_words(fitted.document["error"][part]))
    output.table(table)
    output.say(floor_sentence(after.document))
    output.say(f"\nwritten: {out}")
    output.figures({"before": before.document["error"], **summary(after)})


def _without(
    fit: Fit, wanted: dict[str, Any], joints: list[int] | None, origin: Path
) -> list[dict[str, Any]]:
    """The effects of `fit` without those that match all entries of `wanted`, or without them on `joints` only."""
    effect = wanted["effect"]
    standing = _effects_with_joints(fit)
    alike = [entry for entry in standing if entry["effect"] == effect]
    if not alike:
        names = sorted({entry["effect"] for entry in standing})
        hint = did_you_mean(effect, names) or f" (it has: {', '.join(names)})"
        raise InputError(f"{origin}: found no effect '{effect}' in the model, expected one of its own{hint}")

    def is_chosen(entry: dict[str, Any]) -> bool:
        return wanted.items() <= entry.items()

    chosen = [entry for entry in alike if is_chosen(entry)]
    if not chosen:
        found, *has = [", ".join(option_words(entry)) or "none" for entry in [wanted, *alike]]
        raise InputError(
            f"{origin}: --option: found {found}, expected options of {effect} in the model: {'; '.join(has)}"
        )
    is_pair = catalogue()[effect].joints == "pair"
    on = [tuple(entry.get("joints", [])) for entry in chosen]
    places = {tuple(joints)} if joints is not None and is_pair else {(k,) for k in joints or []}
    known = set(on) if is_pair else {(k,) for own in on for k in own}
    if not places <= known:
        words = ", ".join(" ".join(map(str, place)) for place in sorted(known)) or "none"
        raise InputError(
            f"{origin}: --joints: found {joints}, expected joints of {effect} in the model: {words}"
        )
    kept: list[dict[str, Any]] = []
    for entry, model_entry in zip(standing, fit.effects, strict=True):
        if not is_chosen(entry) or (joints is not None and is_pair and tuple(entry["joints"]) not in places):
            kept.append(model_entry)
        elif joints is not None and not is_pair:
            left = [k for k in entry["joints"] if k not in joints]
            kept += [{**entry, "joints": left}] if left else []
    if not kept:
        raise InputError(f"{origin}: {effect} is the only effect of the model, expected one to remain")
    return kept


def summary(result: Fit) -> dict[str, Any]:
    """The figures of a fit for --json: all of fit.json but the robot and the terms, and the error of orientation."""
    document = dict(result.document)
    document.pop("robot", None)
    if (turned := result.orientation_error()) is not None:
        document["orientation_error"] = {
            "train": {f"{key}_urad": 1e6 * angle for key, angle in turned.items()}
        }
    document["parameters"] = [
        {key: value for key, value in parameter.items() if key != "terms"}
        for parameter in document.get("parameters", [])
    ]
    return document


def present_fit(result: Fit, output: Output, all_parameters: bool = False) -> None:
    """Print the errors, the noise floor, parameters, gross errors, what the data do not determine, and warnings."""
    document = result.document
    output.table(_error_table(document))
    if (turned := result.orientation_error()) is not None:
        table = plain_table("error of orientation [″]", *ERROR_FIGURES.values())
        arcseconds = [f"{math.degrees(turned[key]) * 3600.0:.1f}" for key in ("mean", "rms", "p95", "max")]
        table.add_row(PARTS_OF_ERROR["train"], *arcseconds)
        output.table(table)
    output.say(floor_sentence(document))
    if document.get("statics") == "nominal":
        output.say(
            "gravity loads are calculated at the commanded angles, because those of the deflected arm fit worse"
        )
    present_parameters(document, output, all_parameters)
    rejected = document.get("rejected", [])
    if rejected:
        rows = ", ".join(
            f"row {entry['row']} ({entry['residual_um'] / 1000:.2f} mm)" for entry in rejected[:10]
        )
        more = f" and {len(rejected) - 10} more" if len(rejected) > 10 else ""
        output.title(f"{plural(len(rejected), 'gross error')} kept out")
        output.say(f"  {rows}{more}")
    output.items(document.get("unobservable", []), "What the data cannot tell")
    output.items(document.get("warnings", []), "Warnings")


def _error_table(document: dict[str, Any]) -> Any:
    error = document["error"]
    table = plain_table("error [µm]", *ERROR_FIGURES.values(), "rows")
    parts = {name: error.get(part) for part, name in PARTS_OF_ERROR.items()}
    # Held-out poses are those held out at random.
    splits = error["held_out_by"].items()
    parts |= {f"  held out by {split}": figures for split, figures in splits if split != "random"}
    with_history = error.get("with_history", {}).items()
    parts |= {f"  {PARTS_OF_ERROR[part]}, the arm's past known": figures for part, figures in with_history}
    for name, figures in parts.items():
        if figures:
            table.add_row(name, *error_words(figures), str(figures.get("n", "")))
    return table


def _effects_with_joints(fit: Fit) -> list[dict[str, Any]]:
    """The effects of a fit, each with the joints that it acts on where the model left them to the effect."""
    effects = []
    for entry in fit.effects:
        of_effect = [p for p in fit.document["parameters"] if p["effect"] == entry["effect"]]
        joints = sorted({joint for parameter in of_effect for joint in parameter["joints"]})
        effects.append({**entry, "joints": joints} if joints and "joints" not in entry else entry)
    return effects


def _whole_numbers(text: str, option: str, expected: str) -> list[int]:
    try:
        return [int(part) for part in text.replace(",", " ").split()]
    except ValueError:
        raise InputError(f"{option}: found '{text}', expected {expected}") from None


def _options(pairs: list[str]) -> dict[str, Any]:
    import yaml

    options: dict[str, Any] = {}
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals or not name:
            raise InputError(f"--option: found '{pair}', expected NAME=VALUE such as orders=[13]")
        try:
            options[name] = yaml.safe_load(value)
        except yaml.YAMLError:
            raise InputError(f"--option: found '{pair}', expected a YAML value after '='") from None
    return options


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
