"""How sure a fit's predictions are: the covariance of its parameters, carried to the poses by the same derivatives."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Dataset

Array = NDArray[np.float64]

# Step of the differences for a parameter without a standard deviation, in its SI unit.
_STEP = 1e-6


def position_covariance(fit: Fit, poses: Dataset) -> Array:
    """Covariance (N, 3, 3) [m²] of the predicted positions of `poses`: the model's own, without the instrument's noise.

    Errors: InputError where the fit's measurements are gone, or a column is missing.
    """
    noise_m = 1e-6 * float(fit.document["noise"].get("sigma_um") or 0.0)
    if noise_m <= 0.0:
        raise InputError(
            f"{fit.path or 'fit'}: noise.sigma_um: found none, expected what the readings scatter by"
        )
    kept = np.ones(fit.data.count, dtype=bool)
    kept[[rejected["index"] for rejected in fit.document["rejected"]]] = False
    free = [
        place
        for place, parameter in enumerate(fit.document["parameters"])
        if not parameter.get("held") and not parameter.get("fixed")
    ]
    bounds = np.array([fit.document["parameters"][place].get("bound") or np.inf for place in free])
    steps = np.array([_step(fit.document["parameters"][place]) for place in free])
    # In units of the steps, so that metres, radians and springs weigh alike in the inverse.
    measured = _derivatives(fit, fit.data, free, steps)[kept].reshape(-1, len(free)) / noise_m
    information = measured.T @ measured + np.diag((steps / bounds) ** 2)
    covariance = np.linalg.pinv(information, hermitian=True)
    wanted = _derivatives(fit, poses, free, steps)
    return np.asarray(wanted @ covariance @ np.swapaxes(wanted, 1, 2))


def _step(parameter: dict[str, Any]) -> float:
    sigma = parameter.get("sigma") or 0.0
    return float(sigma) if 0.0 < sigma < np.inf else _STEP


def _derivatives(fit: Fit, data: Dataset, free: list[int], steps: Array) -> Array:
    """What one step of each free parameter does to the positions: (N, 3, P) [m]."""
    document = copy.deepcopy(fit.document)
    moved = Fit(document, fit.path)
    columns = []
    for place, step in zip(free, steps, strict=True):
        parameter = document["parameters"][place]
        value = parameter["value"]
        parameter["value"] = value + step
        ahead = moved.predict(data)
        parameter["value"] = value - step
        columns.append((ahead - moved.predict(data)) / 2.0)
        parameter["value"] = value
    return np.stack(columns, axis=2)
