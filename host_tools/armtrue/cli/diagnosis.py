"""The commands diagnose, refine and report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from armtrue.cli.shared.findings import present_added, present_diagnosis
from armtrue.cli.shared.fits import load_with_data
from armtrue.cli.shared.options import FitArgument, JsonOption, MovedDataOption, OutOption
from armtrue.cli.shared.output import Output, waiting
from armtrue.cli.shared.waterfall import Waterfall


def diagnose(fit_file: FitArgument, data: MovedDataOption = None, json_to: JsonOption = None) -> None:
    """Name the physical effect that a fit lacks, its joint, its probability, and alternative explanations.

    Example: armtrue diagnose fit.json
    """
    from armtrue import diagnosis

    output = Output(json_to)
    fit = load_with_data(fit_file, data, [json_to])
    with waiting(output) as progress:
        result = diagnosis.diagnose(fit, progress=progress)
    present_diagnosis(result, output, fit_file, data)
    output.figures(result)


def refine(
    fit_file: FitArgument, out: OutOption, data: MovedDataOption = None, json_to: JsonOption = None
) -> None:
    """Diagnose and add until nothing is missing, printing how the error falls step by step.

    Interrupted (Ctrl-C), the last finished step is kept in FILE, and --json holds those finished, "interrupted": true.

    Example: armtrue refine fit.json --out best.json
    """
    from armtrue import diagnosis, fitting

    output = Output(json_to)
    fit = load_with_data(fit_file, data, [out, json_to])
    waterfall = Waterfall(output)

    def keep(fit_so_far: fitting.Fit, step: dict[str, Any]) -> None:
        fit_so_far.save(out)
        waterfall.add(step)

    try:
        with waiting(output) as progress:

            def tell(share: float, stage: str) -> None:
                progress(share, "fitting again" if share >= 1.0 else stage)

            refined, result = diagnosis.refine(fit, progress=tell, on_step=keep)
    except KeyboardInterrupt:
        if not waterfall.steps:
            output.say("\nstopped: no step was finished, nothing is written")
            raise
        effects = waterfall.steps[-1]["effects"]
        output.figures({"steps": waterfall.steps, "effects": effects, "interrupted": True})
        output.say(f"\nstopped: {out} holds the last finished step")
        raise
    refined.save(out)
    if result.get("steps"):
        present_added(result, output)
        present_diagnosis(result["steps"][-1], output, out, data)
    output.items(refined.document["warnings"], "Warnings")
    output.say(f"\nwritten: {out}")
    output.figures(result)


def report(
    fit_files: Annotated[list[Path], typer.Argument(metavar="FIT…", help="Fits, first to last step.")],
    out: OutOption,
    data: MovedDataOption = None,
) -> None:
    """Write one self-contained HTML page: where it fails, what is missing, how the error fell.

    Example: armtrue report fit.json best.json --out report.html
    """
    from armtrue import report as report_writer

    fits = [load_with_data(path, data, [out]) for path in fit_files]
    output = Output(None)
    with waiting(output) as progress:
        report_writer.write(fits, out, progress)
    output.say(f"written: {out}")
