"""A stated standard deviation that the measurements themselves contradict."""

from __future__ import annotations

import math

import numpy as np

from armtrue.checking.motion import pose_keys, scatter_m
from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset

# A sigma so many times what is seen is in another unit; a careful data sheet overstates by three or five.
_TIMES = 10.0


def find(data: Dataset, fit_rms_m: float) -> list[Finding]:
    """A warning where `sigma` is far above what repeats scatter by, or `fit_rms_m`, what a fit of geometry leaves."""
    if "sigma" not in data.columns:
        return []
    stated = float(np.median(data.columns["sigma"]))
    keys = pose_keys(data)
    poses = np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    # Rows that were copied are no measurements of their own.
    own = np.unique(np.column_stack([keys, data.positions_m]), axis=0, return_index=True)[1]
    # sigma is of one axis, the others of all three together.
    seen = {
        "poses measured again scatter by": scatter_m(data.positions_m[own], poses[own]) / math.sqrt(3.0),
        "a fit of the geometry alone leaves": fit_rms_m / math.sqrt(3.0),
    }
    words, least = min(seen.items(), key=lambda entry: entry[1])
    if stated <= _TIMES * least:
        return []
    return [
        Finding(
            "sigma_too_large",
            "warning",
            f"{data.file.name} column sigma: found {stated * 1e6:.1f} µm (median), more than {_TIMES:.0f} times what "
            f"{words}: {least * 1e6:.1f} µm an axis",
            {"sigma_m": stated, "seen_m": least},
            "Give sigma its unit in dataset.yaml, as in 'sigma: {column: sigma, unit: mm}', or one standard deviation "
            "in metres; with one far too large nothing counts as significant.",
        )
    ]
