"""The commands predict and compare."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated

import typer

from armtrue.cli.shared.fits import load_measurements, load_with_data
from armtrue.cli.shared.options import (
    DataArgument,
    FitArgument,
    JsonOption,
    MovedDataOption,
    OutOption,
    PosesArgument,
    SkipBadOption,
)
from armtrue.cli.shared.output import Output, plain_table
from armtrue.errors import InputError
from armtrue.io import load_data
from armtrue.io.dataset import in_file_order
from armtrue.io.files import csv_text, refuse_to_lose, write_file
from armtrue.units import plural

_COVARIANCES = {"cxx": (0, 0), "cxy": (0, 1), "cxz": (0, 2), "cyy": (1, 1), "cyz": (1, 2), "czz": (2, 2)}


def predict(
    fit_file: FitArgument,
    poses: PosesArgument,
    out: OutOption,
    uncertainty: Annotated[
        bool,
        typer.Option(
            "--uncertainty",
            help="Add cxx, cxy, cxz, cyy, cyz, czz: the covariance in m² of the model's own uncertainty.",
        ),
    ] = False,
    data: MovedDataOption = None,
) -> None:
    """Predict where the tool point will be, row by row, in the measuring frame.

    POSES needs the columns that the fitted effects read; where it has x, y, z too, the error is printed.

    Example: armtrue predict fit.json poses.csv --out predicted.csv
    """
    import numpy as np

    from armtrue import comparing, fitting
    from armtrue.uncertainty import position_covariance, standard_deviation_m

    output = Output(None)
    if data is not None and not uncertainty:
        raise InputError(
            "--data: found it without --uncertainty, expected both: only the uncertainty reads the data"
        )
    result = load_with_data(fit_file, data, [out]) if uncertainty else fitting.Fit.load(fit_file)
    wanted = load_data(poses, result.robot, need_position=False)
    refuse_to_lose([wanted.file], [out])
    predicted = result.predict(wanted)
    texts = [[f"{value:.10f}" for value in row] for row in predicted]
    names = ["x", "y", "z"]
    if uncertainty:
        covariance = position_covariance(result, wanted)
        names += _COVARIANCES
        for text, one in zip(texts, covariance, strict=True):
            text += [f"{one[place]:.6e}" for place in _COVARIANCES.values()]
        typical = float(np.median(standard_deviation_m(covariance)))
        output.say(
            f"uncertainty of the model at these poses: {1e6 * typical:.1f} µm (median, one standard deviation)"
        )
        if result.document.get("verdict") in ("missing_effect", "unexplained_structure"):
            output.say(
                "the residual that 'refine' left in this fit is more than noise, and this uncertainty does not include "
                "it: predictions err by more"
            )
    write_file(out, csv_text(names, texts))
    output.items(result.assumed(wanted)[1])
    # The positions may be missing or unreadable, as a prediction does not need them.
    measured = None
    with suppress(InputError):
        measured = in_file_order(load_data(poses, result.robot, strict=False))
    if measured is not None and (error := comparing.prediction_error(predicted, measured)):
        output.say(f"error against the x, y, z of {wanted.file.name}: {comparing.error_words(error)}")
    if out.is_file():  # and no pipe, into which this line would go too
        output.say(f"written: {out} ({', '.join(names)} of {plural(wanted.count, 'row')})")


def compare(
    fit_file: FitArgument,
    data: DataArgument,
    skip_bad: SkipBadOption = False,
    json_to: JsonOption = None,
) -> None:
    """Compare a fit with new measurements: the error, the expected error, and the worst rows.

    Exit status 1 if the error is worse than the fit's held-out error predicts.

    Example: armtrue compare fit.json new.csv
    """
    from armtrue import comparing, fitting

    output = Output(json_to)
    result = fitting.Fit.load(fit_file)
    measurements = load_measurements(data, result.robot, [json_to], skip_bad=skip_bad)
    found = comparing.compare(result, measurements)
    output.items([*measurements.notes, *result.assumed(measurements)[1]])
    output.title(found.title)
    for sentence in found.sentences:
        output.say(sentence)
    table = plain_table("worst rows", "error [µm]")
    for row in found.figures["rows"]:
        table.add_row(f"row {row['row']}", f"{row['error_um']:.1f}")
    output.table(table)
    output.figures(found.figures)
    if found.figures["verdict"] == "worse":
        raise typer.Exit(1)
