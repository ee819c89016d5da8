"""Uncertainty of a fit's predictions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.fitting import Fit, refusals_about
from armtrue.io import Dataset


def position_covariance(fit: Fit, poses: Dataset) -> NDArray[np.float64]:
    """Covariance (N, 3, 3) [m²] of the predicted positions of `poses`: the model's own, without the instrument's noise.

    Errors: InputError where the fit's measurements are gone, or a column is missing.
    """
    columns = fit.columns_for(poses)
    with fit.lock, refusals_about(poses):
        covariance = _core.position_covariance(fit.core, columns)
    return np.asarray(covariance).reshape(-1, 3, 3)


def standard_deviation_m(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation (N,) [m] of a position: root of the sum of the variances along the three axes."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


def least_known_m(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """One standard deviation as a vector (N, 3) [m] along the direction of the largest variance."""
    variances, directions = np.linalg.eigh(covariance)
    return np.asarray(np.sqrt(np.maximum(variances[:, -1:], 0.0)) * directions[:, :, -1])
