"""The standard deviation of the model's prediction at the measured poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Dataset
from armtrue.report.gathered.steps import Step
from armtrue.report.gathered.thinning import spread_rows
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import figure, grid, micrometres, minus, section, table
from armtrue.report.pictures.arm import scene
from armtrue.report.pictures.panel import Panel
from armtrue.report.scales import Scale, around
from armtrue.report.sections.residual_sections import viewer
from armtrue.uncertainty import least_known_m, position_covariance, standard_deviation_m

_MOST_POSES = 300
_WORST = 5
_LEAD = (
    "One standard deviation of the predicted position, of the model's own uncertainty without the instrument's noise. "
    "On the arm, an arrow at each pose is one standard deviation along the direction that is known least. "
    "Where it is large, further poses tell most: Plan poses chooses them."
)


def certainty_section(fit: Fit) -> Markup:
    """The uncertainty of the prediction over the reflector's position, and where it is largest."""
    rows = spread_rows(fit.data.count, _MOST_POSES)
    chosen = fit.data.take(rows)
    try:
        covariance = position_covariance(fit, chosen)
    except InputError as error:
        return tag("p", str(error))
    sigma = 1e6 * standard_deviation_m(covariance)
    figures = [
        figure(f"Over {axis}", _panel(chosen.positions_m[:, k], sigma, f"reflector's {axis} [m]"))
        for k, axis in enumerate("xyz")
    ]
    worst: list[list[Content]] = []
    for k in np.argsort(-sigma)[:_WORST]:
        place = minus(", ".join(f"{value:.3f}" for value in chosen.positions_m[k]))
        worst.append([str(int(chosen.rows[k])), micrometres(float(sigma[k])), place])
    headers = ["row", "standard deviation [µm]", "place [m]"]
    words = f"Median {micrometres(float(np.median(sigma)))} µm, largest {micrometres(float(sigma.max()))} µm."
    return section(
        "certainty",
        "How well each place is known",
        tag("p", _LEAD, class_="lead"),
        tag("p", words),
        viewer(_over_the_arm(fit, chosen, covariance), f"The prediction's uncertainty over the arm. {words}"),
        grid(figures),
        table(headers, worst, "Poses that are known least", words=(0, 2)),
    )


def _over_the_arm(fit: Fit, poses: Dataset, covariance: Array) -> dict[str, Any]:
    """A scene with an arrow at each pose: one standard deviation along the direction that is known least."""
    shown = Step(
        number=0,
        title="one standard deviation",
        fit=Fit(fit.document, None, poses),
        given=True,
        added=[],
        removed=[],
        residual_m=least_known_m(covariance),
        turned_rad=None,
        used=np.ones(poses.count, dtype=np.bool_),
    )
    return scene([shown], "standard deviation")


def _panel(place: Array, sigma: Array, label: str) -> Markup:
    low, high = float(sigma.min()), float(sigma.max())
    words = f"Uncertainty of the prediction over {label}: {micrometres(low)} to {micrometres(high)} µm."
    panel = Panel(around(place), Scale(0.0, 1.1 * high or 1.0), label, "standard deviation [µm]", words)
    panel.points(place, sigma, "dots strong-dots")
    return panel.render()
