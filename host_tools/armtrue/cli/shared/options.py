"""Arguments and options that several commands share, with one wording each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DataArgument = Annotated[
    Path,
    typer.Argument(metavar="DATA", help="Measurements: a CSV in the contract's form, or a dataset.yaml."),
]
PosesArgument = Annotated[
    Path,
    typer.Argument(metavar="POSES", help="Poses, q1…qn and what the model reads: a CSV or a dataset.yaml."),
]
FitArgument = Annotated[Path, typer.Argument(metavar="FIT", help="A fit, as 'armtrue fit' writes it.")]
TablesArgument = Annotated[
    Path, typer.Argument(metavar="TABLES", help="A table image, as 'armtrue export' writes it.")
]
MovedDataOption = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DATA",
        help="The fit's measurements, if they were moved after the fit.",
    ),
]
RobotOption = Annotated[
    Path, typer.Option("--robot", "-r", metavar="ROBOT", help="The nominal arm: robot.yaml.")
]
ModelOption = Annotated[
    Path, typer.Option("--model", "-m", metavar="MODEL", help="The effects to fit: model.yaml.")
]
OutOption = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="File to write.")]
JsonOption = Annotated[
    str | None,
    typer.Option("--json", metavar="FILE", help="Write the figures as JSON; '-' for standard output."),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of the random split into folds.")]
FoldsOption = Annotated[int, typer.Option("--folds", min=2, help="Folds of cross-validation.")]
SkipBadOption = Annotated[
    bool, typer.Option("--skip-bad", help="Leave out rows that cannot be read, and list them.")
]
