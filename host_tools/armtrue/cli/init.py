"""The command init."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from armtrue.cli.shared.options import SkipBadOption
from armtrue.cli.shared.output import Output


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
