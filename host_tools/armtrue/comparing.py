"""Compares a fit with measurements that it has not seen: is the error as expected from held-out poses, or larger?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array, rigid_motion
from armtrue.errors import InputError
from armtrue.extrapolation import is_joint
from armtrue.fitting import Fit, fingerprint
from armtrue.io import Dataset
from armtrue.units import plural
from armtrue.verdicts import ERROR_FIGURES, scored_mean_um

_WORST_ROWS = 10
# A mean error this many standard errors above the expected one is not due to chance.
_STANDARD_ERRORS = 3.0
_SAME_POSE = 1e-6
# Rows count as another region of joint space where at least this share lies outside the fitted joint ranges.
_MOST = 0.5
# Extrapolation may be the cause where clipping columns to their fitted ranges brings the mean error below this share.
_NOT_BY_EXTRAPOLATION = 0.9
_WAYS = {"random": "", "region": " region by region", "time": " one stretch of time after another"}
_LARGEST_EXPONENT = 700.0


@dataclass(frozen=True)
class Comparison:
    """`figures`: what `armtrue compare --json` writes. `elsewhere_um`: the mean error after a rigid motion of the
    measuring frame onto the predictions, if that brings the error within the limit; else None. `extrapolated`: where
    the error is worse, a sentence on columns other than joints that the fit extrapolates; else empty. `all_fitted`:
    True if every row was fitted, so that the comparison tells nothing.
    """

    figures: dict[str, Any]
    elsewhere_um: float | None
    extrapolated: str = ""
    all_fitted: bool = False

    @property
    def title(self) -> str:
        """The verdict in words."""
        if self.all_fitted:
            return "No verdict: these are the fit's own rows"
        return "As expected" if self.figures["verdict"] == "as_expected" else "Worse than expected"

    @property
    def sentences(self) -> list[str]:
        """What was found, the same in the terminal and on the workbench."""
        figures = self.figures
        count, fitted = figures["error"]["n"], figures["rows_fitted"]
        found = []
        if self.all_fitted:
            all_rows = "the only row is" if count == 1 else f"all {count} rows are"
            found.append(
                f"{all_rows} among those that were fitted, and a fit follows its own rows whatever the arm does: "
                "compare it with newly measured poses"
            )
        elif fitted:
            are = "was fitted and is" if fitted == 1 else "were fitted and are"
            found.append(f"{fitted} of {count + fitted} rows {are} left out of the comparison")
        found += [
            f"error on {plural(count, 'row')}: {error_words(figures['error'])}",
            f"expected from poses held out of the fit{_WAYS[figures['expected_by']]}: "
            f"{figures['expected_mean_um']:.1f} µm, by chance up to {figures['limit_um']:.1f} µm",
        ]
        if self.extrapolated:
            found.append(self.extrapolated)
        if self.elsewhere_um is not None:
            found.append(
                f"after moving the measuring frame {self.elsewhere_um:.1f} µm remain: the arm is unchanged, and base "
                "or instrument were moved"
            )
        return found


def compare(fit: Fit, data: Dataset) -> Comparison:
    """Compare the predictions of `fit` with the positions of `data`, on rows that were not fitted if there are any.

    Errors: InputError where a column is missing.
    """
    fitted = _fitted_rows(fit, data)
    if not fitted.all():
        data = data.take(~fitted)
    predicted = fit.predict(data)
    apart_um = 1e6 * np.linalg.norm(data.positions_m - predicted, axis=1)
    by, held_out, expected = _expected(fit, data)
    poses = len(np.unique(np.round(data.joints / _SAME_POSE), axis=0))
    spread = math.sqrt(max(0.0, float(held_out["rms_um"]) ** 2 - expected**2))
    chance = spread * math.sqrt(1.0 / poses + 1.0 / max(1, int(held_out.get("n") or data.count)))
    limit = expected + _STANDARD_ERRORS * chance
    figures = error_figures(apart_um)
    worst = np.argsort(apart_um)[::-1][:_WORST_ROWS]
    worse = figures["mean_um"] > limit
    elsewhere, extrapolated = None, ""
    if worse:
        extrapolated, of_the_fit = _extrapolated(fit, data, figures["mean_um"])
        if poses > 3 and not of_the_fit:
            motion = rigid_motion(data.positions_m, predicted)
            moved = data.positions_m @ motion[:3, :3].T + motion[:3, 3]
            moved_um = float(1e6 * np.linalg.norm(moved - predicted, axis=1).mean())
            elsewhere = moved_um if moved_um <= limit else None
    return Comparison(
        {
            "error": figures,
            "expected_mean_um": expected,
            "expected_by": by,
            "limit_um": limit,
            "verdict": "worse" if worse else "as_expected",
            "rows_fitted": int(fitted.sum()),
            "rows": [{"row": int(data.rows[at]), "error_um": float(apart_um[at])} for at in worst],
        },
        elsewhere,
        extrapolated,
        bool(fitted.all()),
    )


def _fitted_rows(fit: Fit, data: Dataset) -> NDArray[np.bool_]:
    """Mask (N,) of the rows of `data` that have the joints and the position of a fitted row."""
    try:
        own = fit.data
    except InputError:
        # Without the fit's measurement file, only its digest can tell whether all columns are the same.
        return np.full(data.count, fingerprint(data) == fit.document["data"]["sha256"])
    known = {row.tobytes() for row in np.column_stack([own.joints, own.positions_m])}
    return np.array([row.tobytes() in known for row in np.column_stack([data.joints, data.positions_m])])


def _expected(fit: Fit, data: Dataset) -> tuple[str, dict[str, Any], float]:
    """The cross-validation that predicts the error of `data` (random, region or time), its figures and mean [µm].

    Rows later than all fitted ones are compared with poses held out by time, rows outside the fitted joint ranges with
    poses held out by region; the largest mean counts, random included. Errors: InputError where none was scored.
    """
    held_out = fit.document["error"]["held_out"]
    mean = scored_mean_um(held_out)
    if mean is None:
        raise InputError(
            "compare: found a fit whose held-out error is not scored, expected one to compare with"
        )
    found = [("random", held_out, mean)]
    ways = fit.document["error"].get("held_out_by") or {}
    for way in _ways_that_apply(fit, data):
        of_way = scored_mean_um(ways.get(way) or {})
        if of_way is not None:
            found.append((way, ways[way], of_way))
    return max(found, key=lambda one: one[2])


def _ways_that_apply(fit: Fit, data: Dataset) -> list[str]:
    ways = []
    joints = [one.rows for one in fit.beyond(data) if is_joint(one.name)]
    if joints and np.any(joints, axis=0).mean() >= _MOST:
        ways.append("region")
    fitted = fit.document["data"].get("ranges", {}).get("time")
    if fitted and "time" in data.columns and data.columns["time"].min() > fitted[1]:
        ways.append("time")
    return ways


def _extrapolated(fit: Fit, data: Dataset, mean_um: float) -> tuple[str, bool]:
    """A sentence on the columns other than joints that `fit` extrapolates, and whether that may explain the error.

    `mean_um`: the mean error. It is compared with the mean error where the columns are clipped to their fitted ranges.
    """
    beyond = [one for one in fit.beyond(data) if not is_joint(one.name)]
    if not beyond:
        return "", False
    ranges = fit.document["data"]["ranges"]
    held = {one.name: np.clip(data.columns[one.name], *ranges[one.name]) for one in beyond}
    there = replace(data, columns={**data.columns, **held})
    held_um = float(1e6 * np.linalg.norm(data.positions_m - fit.predict(there), axis=1).mean())
    effects = list(dict.fromkeys(effect for one in beyond for effect in one.effects))
    of_the_fit = held_um < _NOT_BY_EXTRAPOLATION * mean_um
    read = f" (read by {', '.join(effects)})" if effects else ""
    far = ", ".join(one.words(fit.robot) for one in beyond)
    words = (
        f"the fit extrapolates {far}{read}: with the nearest value that was fitted in its place the mean error is "
        f"{held_um:.1f} µm"
    )
    if of_the_fit:
        words += (
            ", so that what is worse may be the fit's own extrapolation; compare a fit without these effects "
            "('armtrue remove') before you conclude anything about arm, base or instrument"
        )
    return words, of_the_fit


@dataclass(frozen=True)
class Difference:
    """Two fits on the rows that both have (N,), the largest distance between their predictions first.

    `rows`: numbers in the file. `first`: indices into the first fit's data. `apart_um`: distance between the
    predictions. `errors_um`: the error of each fit.
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
    """Probability of the first of two models of the same measurements from their BIC, if one of the two is right."""
    return 1.0 / (1.0 + math.exp(min(_LARGEST_EXPONENT, (first - second) / 2.0)))


def prediction_error(predicted: Array, data: Dataset) -> dict[str, float] | None:
    """The error of `predicted` (N, 3) [m] where `data` has positions; None where it has not."""
    if not data.has_positions:
        return None
    return error_figures(1e6 * np.linalg.norm(data.positions_m - predicted, axis=1))


def error_words(error: dict[str, float]) -> str:
    """Error figures in words."""
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
