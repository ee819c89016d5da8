"""Check of the column `sigma` against the scatter of repeated poses and the residuals of a fit."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset

# A data sheet may state three to five times the scatter that is observed. Ten times or more means that `sigma` was
# written in another unit.
_TIMES_TOO_LARGE = 10.0
# A `sigma` of the instrument alone leaves out the arm's repeatability, which may double the scatter. A fourth of
# what is observed is too small for either.
_TIMES_TOO_SMALL = 4.0


def find(data: Dataset, repeats_m: float, fit_rms_m: float) -> Iterator[Finding]:
    """A warning if the column `sigma` is far from the observed scatter.

    Too large: far above the scatter of repeats, `repeats_m` (inf without repeats), or the residual of a geometry fit,
    `fit_rms_m`, both of all axes together [m]. Too small: far below `repeats_m`.
    """
    if "sigma" not in data.columns:
        return
    stated = float(np.median(data.columns["sigma"]))
    # sigma is of one axis, the others of all three together.
    seen = {
        "repeated poses scatter by": repeats_m / math.sqrt(3.0),
        "a fit of the geometry alone leaves": fit_rms_m / math.sqrt(3.0),
    }
    words, least = min(seen.items(), key=lambda entry: entry[1])
    found = f"{data.file.name} column sigma: found {stated * 1e6:.1f} µm (median)"
    evidence = {"sigma_m": stated, "seen_m": least}
    if stated > _TIMES_TOO_LARGE * least:
        yield Finding(
            "sigma_too_large",
            "warning",
            f"{found}, more than {_TIMES_TOO_LARGE:.0f} times what {words}: {least * 1e6:.1f} µm an axis",
            evidence,
            "Give sigma its unit in dataset.yaml, as in 'sigma: {column: sigma, unit: mm}', or one standard "
            "deviation in metres; if it is far too large, no effect is significant.",
        )
        return
    # Residuals of a fit may be errors of the arm, which sigma excludes: only repeats show that sigma is too small.
    if math.isfinite(repeats_m) and _TIMES_TOO_SMALL * stated < least:
        yield Finding(
            "sigma_too_small",
            "warning",
            f"{found}, less than 1/{_TIMES_TOO_SMALL:.0f} of what {words}: {least * 1e6:.1f} µm an axis",
            evidence,
            "Give the standard deviation in metres of repeated measurements, of the arm's repeatability and the "
            "instrument's noise together; if it is far too small, noise counts as significant.",
        )
