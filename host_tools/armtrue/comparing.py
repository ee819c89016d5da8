"""A fit against measurements that it has not seen: as good as was to be expected, or worse."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Dataset
from armtrue.verdicts import ERROR_FIGURES, scored_mean_um

_WORST_ROWS = 10
# The mean of so many standard errors above what was expected is no chance.
_STANDARD_ERRORS = 3.0
_SAME_POSE = 1e-6
_LARGEST_EXPONENT = 700.0


@dataclass(frozen=True)
class Comparison:
    """`figures`: what `armtrue compare --json` writes. `elsewhere_um`: the mean error after the measuring frame was
    moved onto the predictions, where that explains what is worse; else None.
    """

    figures: dict[str, Any]
    elsewhere_um: float | None

    @property
    def title(self) -> str:
        """The verdict in words."""
        return "As expected" if self.figures["verdict"] == "as_expected" else "Worse than expected"

    @property
    def sentences(self) -> list[str]:
        """What was found, the same in the terminal and on the workbench."""
        figures = self.figures
        found = [
            f"error on {figures['error']['n']} rows: {error_words(figures['error'])}",
            f"expected from poses held out of the fit: {figures['expected_mean_um']:.1f} µm, "
            f"by chance up to {figures['limit_um']:.1f} µm",
        ]
        if self.elsewhere_um is not None:
            found.append(
                f"after moving the measuring frame {self.elsewhere_um:.1f} µm stay: the arm is as it was, and base or "
                "instrument stand elsewhere"
            )
        return found


def compare(fit: Fit, data: Dataset) -> Comparison:
    """Compare the predictions of `fit` with the positions of `data`. Errors: InputError where a column is missing."""
    predicted = fit.predict(data)
    apart_um = 1e6 * np.linalg.norm(data.positions_m - predicted, axis=1)
    held_out = fit.document["error"]["held_out"]
    mean = scored_mean_um(held_out)
    if mean is None:
        raise InputError(
            "compare: found a fit whose held-out error is not scored, expected one to compare with"
        )
    expected = mean
    poses = len(np.unique(np.round(data.joints / _SAME_POSE), axis=0))
    spread = math.sqrt(max(0.0, float(held_out["rms_um"]) ** 2 - expected**2))
    chance = spread * math.sqrt(1.0 / poses + 1.0 / max(1, int(held_out.get("n") or data.count)))
    limit = expected + _STANDARD_ERRORS * chance
    figures = error_figures(apart_um)
    worst = np.argsort(apart_um)[::-1][:_WORST_ROWS]
    worse = figures["mean_um"] > limit
    elsewhere = float(_moved_frame_um(data.positions_m, predicted).mean()) if worse and poses > 3 else None
    return Comparison(
        {
            "error": figures,
            "expected_mean_um": expected,
            "limit_um": limit,
            "verdict": "worse" if worse else "as_expected",
            "rows": [{"row": int(data.rows[at]), "error_um": float(apart_um[at])} for at in worst],
        },
        elsewhere if elsewhere is not None and elsewhere <= limit else None,
    )


@dataclass(frozen=True)
class Difference:
    """Two fits at the measurements that both hold, those first where the predictions are farthest apart.

    `first`: places in the first fit's data. `apart_um`: between the predictions. `errors_um`: of either.
    """

    rows: NDArray[np.int64]
    first: NDArray[np.int64]
    apart_um: Array
    errors_um: tuple[Array, Array]


def difference(one: Fit, other: Fit) -> Difference:
    """Where the predictions of two fits of one file differ. Errors: InputError where the measurements are gone."""
    rows, first, second = np.intersect1d(one.data.rows, other.data.rows, return_indices=True)
    residuals = one.residuals()[first], other.residuals()[second]
    apart = 1e6 * np.linalg.norm(residuals[0] - residuals[1], axis=1)
    order = np.argsort(-apart)
    errors = [1e6 * np.linalg.norm(each, axis=1)[order] for each in residuals]
    return Difference(rows[order], first[order], apart[order], (errors[0], errors[1]))


def bayesian_information(fit: Fit) -> float:
    """BIC of a fit, up to a constant of its measurements."""
    with fit.lock:
        return float(fit.core.bayesian_information())


def probability_of_first(first: float, second: float) -> float:
    """Of two models of the same measurements, given their BIC, one of which is right: that the first is."""
    return 1.0 / (1.0 + math.exp(min(_LARGEST_EXPONENT, (first - second) / 2.0)))


def prediction_error(predicted: Array, data: Dataset) -> dict[str, float] | None:
    """The error of `predicted` (N, 3) [m] where `data` has positions; None where it has not."""
    if not data.has_positions:
        return None
    return error_figures(1e6 * np.linalg.norm(data.positions_m - predicted, axis=1))


def error_words(error: dict[str, float]) -> str:
    """Error figures as they are said."""
    return ", ".join(f"{word} {error[key]:.1f} µm" for key, word in ERROR_FIGURES.items())


def error_figures(apart_um: Array) -> dict[str, float]:
    """Mean, RMS, 95 % and largest of distances [µm]."""
    return {
        "mean_um": float(apart_um.mean()),
        "rms_um": float(np.sqrt((apart_um**2).mean())),
        "p95_um": float(np.quantile(apart_um, 0.95)),
        "max_um": float(apart_um.max()),
        "n": len(apart_um),
    }


def _moved_frame_um(measured: Array, predicted: Array) -> Array:
    """Distances [µm] after a rigid motion brought `measured` onto `predicted`."""
    middle, target = measured.mean(axis=0), predicted.mean(axis=0)
    u, _, vt = np.linalg.svd((measured - middle).T @ (predicted - target))
    rotation = (u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt).T
    moved = (measured - middle) @ rotation.T + target
    return np.asarray(1e6 * np.linalg.norm(moved - predicted, axis=1))
