"""The next poses to measure: as a file to run, in sentences, and drawn as the arm will stand."""

from __future__ import annotations

from typing import Any

import numpy as np

from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.planning import plan
from armtrue.progress import Progress
from armtrue.report.markup import tag
from armtrue.report.pictures.effect_picture import arms_picture
from armtrue.units import plural
from armtrue.workbench.outputs import Made
from armtrue.workbench.showing.further import Result

_MOST_POSES = 200
_MOST_SHOWN = 12


def planned(
    fit: Fit, words: dict[str, Any], rivals: list[dict[str, Any]] | None, progress: Progress
) -> Result:
    """Poses that tell `rivals` (entries of model.yaml) apart; None: candidates that the diagnosis leaves
    open, or else poses for the model's parameters.
    """
    count = words.get("poses", _MOST_SHOWN)
    if not isinstance(count, int) or not 1 <= count <= _MOST_POSES:
        raise InputError(f"poses: found {count!r}, expected 1 to {_MOST_POSES}")
    chosen = plan(fit, count, rivals=rivals, progress=progress)
    rows = np.column_stack(list(chosen.columns.values()))
    sentences = [*chosen.decisions(), *filter(None, [chosen.precision()])]
    heads = [tag("th", name, scope="col") for name in chosen.columns]
    body = [tag("tr", [tag("td", f"{value:.4f}") for value in row]) for row in rows[:_MOST_SHOWN]]
    table = tag("table", tag("caption", "Planned poses [rad, m]"), tag("tr", heads), body)
    still = np.zeros(len(rows))
    numbers, passive = range(1, fit.robot.joint_count + 1), fit.robot.passive
    joints = np.column_stack([still if k in passive else chosen.columns[f"q{k}"] for k in numbers])
    picture, said = arms_picture(fit, joints[:_MOST_SHOWN])
    link = tag("a", "poses.csv", href="file?name=result", download="poses.csv")
    shown = tag(
        "div",
        [tag("p", sentence) for sentence in sentences],
        tag("p", link, ": all of them, to run."),
        tag("figure", picture, tag("figcaption", said)),
        tag("div", table, class_="scroll", tabindex="0", role="region", aria_label="Planned poses"),
    )
    made = Made("poses.csv", chosen.csv().encode(), "text/csv; charset=utf-8")
    said = f"{plural(count, 'pose')} planned: run poses.csv, then drop what was measured. {' '.join(sentences[:1])}"
    return Result(shown, said.strip(), made)
