"""The commands simulate, init and check: measurements, made up, read and checked."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from armtrue.cli.shared.fits import load_measurements
from armtrue.cli.shared.options import DataArgument, JsonOption, RobotOption, SkipBadOption
from armtrue.cli.shared.output import Output
from armtrue.errors import InputError
from armtrue.io import load_robot

if TYPE_CHECKING:
    from armtrue.checking import Finding

_MARKS = {"error": "✗ error", "warning": "! warning", "note": "· note"}


def simulate(
    scenario: Annotated[
        Path,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario file, or the name of a shipped one, such as kr30-eccentric-gear.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write.")],
) -> None:
    """Simulate a campaign with known truth: robot.yaml, model.yaml, data.csv, test.csv and hidden.json.

    It shows what a campaign can determine before anything is measured; the same scenario gives the same files.

    Example: armtrue simulate kr30-eccentric-gear --out kr30
    """
    import armtrue_sim

    try:
        armtrue_sim.cli_simulate(scenario, out)
    except armtrue_sim.ScenarioError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{error.filename or out}: cannot be written ({error.strerror})") from None
    Output(None).say(f"written: {out}")


def init(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="Measurements as exported: CSV, TXT, XLSX.")
    ],
    urdf: Annotated[Path | None, typer.Option("--urdf", metavar="URDF", help="The arm as a URDF.")] = None,
    dh: Annotated[
        Path | None,
        typer.Option(
            "--dh",
            metavar="TABLE",
            help="The arm as a table: a, alpha, d, theta; type, where a joint slides.",
        ),
    ] = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", "-r", metavar="ROBOT", help="The arm as a robot.yaml.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            "-m",
            metavar="MODEL",
            help="The effects to fit, as a model.yaml; default: base, tool and geometry.",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="Folder to write into.", show_default=False)
    ] = Path(),
    force: Annotated[bool, typer.Option("--force", help="Replace files of an earlier run.")] = False,
    skip_bad: SkipBadOption = False,
) -> None:
    """Read foreign measurement files and write robot.yaml, dataset.yaml and model.yaml that check and fit take.

    Separator, decimal mark, units, columns, angles, time and repeats are guessed, and each guess is printed with
    its reason. Several files are joined: joints in one, each reflector in its own.

    Example: armtrue init joints.csv smr1.csv smr2.csv --urdf arm.urdf --out arm
    """
    from armtrue.foreign import init as run

    output = Output(None)
    guessed = run(files, out, urdf=urdf, dh=dh, robot=robot, model=model, force=force, skip_bad=skip_bad)
    output.items(guessed.notes, "Guessed")
    wrong = [finding for finding in guessed.findings if finding.severity == "error"]
    remedies = [f"{finding.message} → {finding.remedy}" for finding in wrong]
    output.items(remedies, "The measurements do not follow the arm yet")
    output.say(f"\nwritten: {', '.join(str(path) for path in guessed.written)}")
    data, arm, effects = (
        shlex.quote(str(out / name)) for name in ("dataset.yaml", "robot.yaml", "model.yaml")
    )
    fit = shlex.quote(str(out / "fit.json"))
    output.say("next:")
    output.line(f"  armtrue check {data} --robot {arm}")
    output.line(f"  armtrue fit {data} --robot {arm} --model {effects} --out {fit}")
    if wrong:
        raise typer.Exit(1)


def check(
    data: DataArgument,
    robot: RobotOption,
    skip_bad: SkipBadOption = False,
    json_to: JsonOption = None,
) -> None:
    """Check measurements for mistakes before a fit: units, signs, coupling, read-back, duplicates, drift,
    a tracker or reflector that was moved half way.

    States what the data can and cannot determine. Exit status 1 where an error was found.

    Example: armtrue check data.csv --robot robot.yaml
    """
    from armtrue.checking import check as run_check

    output = Output(json_to)
    arm = load_robot(robot)
    measurements = load_measurements(data, arm, [json_to], skip_bad=skip_bad, strict=False)
    report = run_check(measurements, arm)
    output.table(_findings_table(report.findings))
    output.say(f"\n{report.summary()}")
    output.figures(report.document())
    if report.has_errors:
        raise typer.Exit(1)


def _findings_table(findings: list[Finding]) -> Table:
    """One row per finding; a remedy that several findings share is printed once, under the last of them."""
    table = Table.grid(padding=(0, 2))
    for number, finding in enumerate(findings):
        table.add_row(_MARKS[finding.severity], finding.code, finding.message)
        following = findings[number + 1 :]
        if finding.remedy and all(finding.remedy != other.remedy for other in following):
            table.add_row("", "", f"→ {finding.remedy}")
    return table
