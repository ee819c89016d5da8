"""The command plan."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armtrue.candidates import argument_of, entry_of, name
from armtrue.cli.shared.findings import following
from armtrue.cli.shared.fits import load_with_data
from armtrue.cli.shared.options import JsonOption, MovedDataOption, OutOption
from armtrue.cli.shared.output import Output, plain_table, waiting
from armtrue.errors import InputError
from armtrue.io import Robot, load_model, load_robot
from armtrue.io.files import write_file
from armtrue.io.model import check_effect
from armtrue.planning import HARDLY, SETTLED, Ambiguity, Cell, Plan, Rival
from armtrue.units import plural

if TYPE_CHECKING:
    from armtrue.fitting import Fit

_MOST_POSES = 2000
_DISTINCT_SHOWN = 6
_RANKS = ("weakest", "second weakest", "third weakest")


def plan(
    fit_file: Annotated[
        Path | None, typer.Argument(metavar="[FIT]", help="A fit whose ambiguity is to be resolved.")
    ] = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", "-r", metavar="ROBOT", help="For a first campaign: robot.yaml.")
    ] = None,
    model: Annotated[
        Path | None, typer.Option("--model", "-m", metavar="MODEL", help="For a first campaign: model.yaml.")
    ] = None,
    *,
    poses: Annotated[int, typer.Option("--poses", min=1, max=_MOST_POSES, help="How many poses.")],
    out: OutOption,
    candidates: Annotated[
        tuple[str, str] | None,
        typer.Option(
            "--candidates",
            metavar="A B",
            help="Effects to distinguish, such as gear_harmonics:2 joint_compliance:2; "
            "default: those of the diagnosis' ambiguity set between which the data do not decide.",
        ),
    ] = None,
    also: Annotated[
        list[str] | None, typer.Option("--also", metavar="C", help="A further effect beside --candidates.")
    ] = None,
    sharpen: Annotated[
        bool, typer.Option("--sharpen", help="Poses that determine the fit's own parameters better.")
    ] = False,
    levels: Annotated[
        list[str] | None,
        typer.Option(
            "--levels",
            metavar="COLUMN=V,V",
            help="Values to choose from: payload=0,8,16 or temp_arm=20,35; dir=-1,1 means every joint's; "
            "time=0,3600: earliest times in the session [s].",
        ),
    ] = None,
    tool: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--tool", metavar="X Y Z", help="Reflector in the flange [m], where robot.yaml has no tool."
        ),
    ] = None,
    box: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option("--box", metavar="X X Y Y Z Z", help="Keep the tool point inside [m, robot base]."),
    ] = None,
    floor: Annotated[
        float | None,
        typer.Option("--floor", metavar="Z", help="Keep joints and tool point above [m, robot base]."),
    ] = None,
    tracker: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--tracker", metavar="X Y Z", help="Keep the line of sight from here free [m, robot base]."
        ),
    ] = None,
    clearance: Annotated[
        float | None,
        typer.Option(
            "--clearance", metavar="M", help="Least distance of the line of sight from the arm [m]."
        ),
    ] = None,
    acceptance: Annotated[
        float | None,
        typer.Option("--acceptance", metavar="DEG", help="Half of the reflector's acceptance angle."),
    ] = None,
    opening: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            "--opening",
            metavar="X Y Z",
            help="Direction of the reflector's opening in the tool frame; default: z.",
        ),
    ] = None,
    choose_from: Annotated[int, typer.Option("--choose-from", help="Possible poses to choose from.")] = 4000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the possible poses.")] = 0,
    data: MovedDataOption = None,
    json_to: JsonOption = None,
) -> None:
    """Choose the poses to measure: for a first campaign, or those that decide between candidates of a fit.

    Without FIT, poses that determine the model's parameters best (D-optimal). With FIT, poses, payloads, directions and
    temperatures that separate the candidates of the diagnosis' ambiguity set between which its data do not decide
    (T-optimal); if there are none, or with --sharpen, poses for its own parameters.

    Rows are in the order to run them: temperature outermost, time forward, few changes of payload, short travel.

    Example: armtrue plan --robot robot.yaml --model model.yaml --poses 50 --out poses.csv

    Example: armtrue plan fit.json --poses 12 --out poses.csv
    """
    from armtrue import diagnosis, planning

    output = Output(json_to)
    if also and not candidates:
        raise InputError(f"--also: found '{also[0]}' without --candidates, expected it together with them")
    if clearance is not None and not clearance > 0.0:
        raise InputError(f"--clearance: found {clearance}, expected metres above 0")
    cell = Cell(
        [(box[0], box[1]), (box[2], box[3]), (box[4], box[5])] if box else None,
        floor,
        tracker,
        clearance,
        None if acceptance is None else math.radians(acceptance),
        opening,
    )
    ambiguity: planning.Ambiguity | None = None
    settings: dict[str, Any] = {"cell": cell, "candidates": choose_from, "seed": seed}
    if fit_file is None:
        if robot is None or model is None:
            raise InputError("plan: found neither a fit nor --robot and --model, expected one or the other")
        if data is not None:
            raise InputError("--data: found it without a fit, expected it together with one")
        arm = load_robot(robot)
        chosen_levels = _levels(levels or [], arm)
        with waiting(output) as progress:
            result = planning.plan_campaign(
                arm,
                load_model(model, arm, chosen_levels),
                poses,
                tool=tool,
                levels=chosen_levels,
                progress=progress,
                **settings,
            )
    else:
        for name, given in (("--robot", robot), ("--model", model), ("--tool", tool)):
            if given is not None:
                raise InputError(f"{name}: found it beside {fit_file}, expected one or the other")
        fit = load_with_data(fit_file, data, [out, json_to])
        settings["levels"] = _levels(levels or [], fit.robot)
        with waiting(output) as progress:
            if candidates:
                rivals = [_rival(text, fit) for text in (*candidates, *(also or []))]
            elif sharpen:
                rivals = []
            else:
                ambiguity = planning.ambiguity(fit, diagnosis.diagnose(fit, progress=progress))
                rivals = ambiguity.open if ambiguity else []
            result = planning.plan(fit, poses, rivals=rivals, progress=progress, **settings)
        if not candidates and not sharpen:
            moved = f" --data {shlex.quote(str(data))}" if data else ""
            again = f"--poses {poses} --out {shlex.quote(str(following(out)))}{moved}"
            _present_ambiguity(ambiguity, result, f"armtrue plan {shlex.quote(str(fit_file))}", again, output)
    write_file(out, result.csv())
    reflector = f" of reflector {result.target}" if result.target is not None else ""
    output.say(f"{plural(result.count, 'pose')}{reflector}{_settings_words(result)}")
    (_present_separation if result.separates else _present_campaign)(result, output)
    output.say(f"\nwritten: {out}")
    columns = {
        "columns": {name: list(values) for name, values in result.columns.items()},
        "target": result.target,
    }
    open_set = {"ambiguity": ambiguity.figures()} if ambiguity else {}
    output.figures(result.figures | open_set | columns)


def _present_ambiguity(
    ambiguity: Ambiguity | None, plan: Plan, command: str, rest: str, output: Output
) -> None:
    """Print what the data already decide about a diagnosis' ambiguity set, and thus the purpose of the poses.

    `command`, `rest`: what stands before and after the candidates in the command that separates them all the same.
    """
    if ambiguity is None:
        output.say("The diagnosis recommends no effect: these poses are for the fit's own parameters.")
        return
    if not ambiguity.rivals:
        output.say(
            f"No other effect explains as much as {name(ambiguity.entry)}: "
            "these poses are for the fit's own parameters."
        )
        return
    first = name(ambiguity.entry)
    preferences = [f"{first} or {name(rival.entry)}: {preference(rival)}" for rival in ambiguity.rivals]
    output.items(preferences, "Alternative explanations")
    if plan.separates:
        told = "; ".join(name(rival.entry) for rival in ambiguity.rivals if rival.entry in ambiguity.open)
        left_out = sum(not rival.decided and not rival.table for rival in ambiguity.rivals)
        left_out -= len(ambiguity.open) - 1
        output.say(
            f"These poses are chosen to distinguish {first} from {told}"
            + (f", not yet from {left_out} less likely ones." if left_out else ".")
        )
        return
    why = (
        "The data decide already"
        if all(rival.decided for rival in ambiguity.rivals)
        else "No pose rules out a table"
    )
    output.say(
        f"{why}: these poses are for the fit's own parameters. To measure the difference nevertheless:"
    )
    closest = [argument_of(own) for own in (ambiguity.candidate, ambiguity.rivals[0].candidate)]
    output.line(f"  {command} --candidates {shlex.join(closest)} {rest}\n")


def preference(rival: Rival) -> str:
    """Sentence on whether the data prefer the first candidate or `rival`, called the second."""
    if rival.delta_bic is None:
        return "the second cannot be fitted"
    figure = f"(ΔBIC {rival.delta_bic:+.0f})"
    if abs(rival.delta_bic) < HARDLY:
        sentence = f"the data do not decide {figure}"
    else:
        preferred = "first" if rival.delta_bic > 0.0 else "second"
        how = "slightly" if abs(rival.delta_bic) < SETTLED else "decisively"
        sentence = f"the data favour the {preferred} {how} {figure}"
    if rival.table:
        return f"{sentence}; the second is a table, which fits any cause, with more parameters"
    if rival.delta_bic >= SETTLED and rival.fits_as_well:
        return f"{sentence}, but only because it has fewer parameters: the second fits as well"
    return sentence


def _settings_words(plan: Plan) -> str:
    """The values in the plan's columns other than joints, as text."""
    words = ""
    for column, values in plan.columns.items():
        if not column.startswith("q"):
            different = [f"{value:g}" for value in sorted({float(value) for value in values})]
            few = len(different) <= _DISTINCT_SHOWN
            words += f"; {column} {', '.join(different) if few else f'{different[0]} to {different[-1]}'}"
    return words


def _present_separation(plan: Plan, output: Output) -> None:
    figures = plan.figures

    def spelled(text: str) -> str:
        # The longest first: a label may begin with another.
        for own in sorted(figures["candidates"], key=len, reverse=True):
            text = text.replace(own, name(entry_of(own)))
        return text

    for sentence in plan.decisions():
        output.say(spelled(sentence))
    table = plain_table(
        "ΔBIC of the cause minus its rival", "now", plural(plan.count, "random pose"), "these poses"
    )
    for entry in figures["separations"]:
        table.add_row(
            spelled(f"if {entry['truth']}, not {entry['rival']}"),
            *(f"{round(entry[f'delta_bic_{key}'])}" for key in ("now", "expected_random", "expected")),
        )
    output.table(table)
    for sentence in filter(None, map(outlook, figures["separations"])):
        output.say(spelled(sentence))


def outlook(separation: dict[str, Any]) -> str | None:
    """Sentence on a pair's expected ΔBIC if the planned poses do not decide it; None if they do.

    Also None if neither is preferred: `Plan.decisions` states that for both at once.
    """
    cause, rival = separation["truth"], separation["rival"]
    expected = separation["delta_bic_expected"]
    if expected <= -SETTLED or abs(expected) < HARDLY:
        return None
    figure = f"(ΔBIC {expected:+.0f})"
    if expected >= SETTLED:
        sentence = (
            f"If the cause is {cause}, {rival} is expected to be preferred nevertheless {figure}: "
            f"its worse fit costs less than the additional parameters of {cause}"
        )
    else:
        sentence = (
            f"If the cause is {cause}, {rival} is expected to remain about as good {figure}: "
            "more poses, payloads or joint range may decide"
        )
    now = separation["delta_bic_now"]
    if now >= SETTLED:
        sentence += f"; the present data favour {rival} (ΔBIC {now:+.0f})"
    return sentence + "."


def _present_campaign(plan: Plan, output: Output) -> None:
    figures, information = plan.figures, plan.figures["information"]
    columns = {"now": "present", plural(plan.count, "random pose"): "random", "these poses": "planned"}
    shown = {header: information[key] for header, key in columns.items() if information[key]}
    table = plain_table(plural(figures["unknowns"], "unknown"), *shown)
    table.add_row(
        "error of predictions, RMS over the reach [µm]",
        *(f"{entry['prediction_rms_um']:.1f}" for entry in shown.values()),
    )
    eigenvalues = [entry["eigenvalues_per_m2"] for entry in shown.values()]
    for which, place in (("largest", -1), ("median", None), ("smallest", 0)):
        table.add_row(
            f"{which} eigenvalue of the Fisher information [1/m²]",
            *(f"{values[len(values) // 2 if place is None else place]:.2e}" for values in eigenvalues),
        )
    for rank in range(len(information["planned"]["weakest"])):
        table.add_row(
            f"{_RANKS[rank]} direction known to [µm at the tool]",
            *(f"{entry['weakest'][rank]['sigma_um']:.1f}" for entry in shown.values()),
        )
    output.table(table)
    output.say(plan.precision() or "")
    weakest = [f"{header}: {entry['weakest'][0]['words']}" for header, entry in shown.items()]
    output.items(weakest, "Weakest direction")
    if figures.get("same_numbers"):
        output.say(
            f"{plural(figures['same_numbers'], 'further parameter')} {'is' if figures['same_numbers'] == 1 else 'are'} "
            "equivalent to another one at every pose: held at nominal."
        )
    output.items(figures.get("weak", []), "What poses of this arm hardly determine")


def _levels(given: list[str], robot: Robot) -> dict[str, list[float]]:
    """`COLUMN=V,V` arguments by column; `dir` stands for every joint's direction."""
    levels: dict[str, list[float]] = {}
    for text in given:
        name, equals, values = text.partition("=")
        try:
            numbers = [float(value) for value in values.split(",")]
        except ValueError:
            numbers = []
        if not name or not equals or not numbers or not all(map(math.isfinite, numbers)):
            raise InputError(f"--levels: found '{text}', expected COLUMN=V,V such as payload=0,8,16")
        for column in [f"dir{k}" for k in robot.motors] if name == "dir" else [name]:
            levels[column] = numbers
    return levels


def _rival(text: str, fit: Fit) -> dict[str, Any]:
    """`EFFECT:2,3`, `EFFECT 2,3` or `EFFECT:2:cycles=13` as an entry of model.yaml."""
    try:
        entry = entry_of(text)
    except ValueError:
        raise InputError(
            f"--candidates: found '{text}', expected an effect and joints such as gear_harmonics:2, or with an option "
            "such as gear_mesh:5:cycles=13 or thermal_base:sensor=arm"
        ) from None
    return check_effect(entry, fit.robot, "--candidates", columns=fit.data.columns)
