"""Which effect is missing, and adding until none is. The numbers are made in `armtrue._core`."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from armtrue import _core
from armtrue.errors import InputError
from armtrue.fitting import Fit, from_core
from armtrue.progress import Progress

Step = Callable[[Fit, dict[str, Any]], None]


def diagnose(fit: Fit, progress: Progress | None = None) -> dict[str, Any]:
    """Return what `fit` lacks: the contract's `diagnose` JSON with spectra beside it.

    Errors: InputError where the measurements are gone or changed.
    """
    try:
        return dict(json.loads(_core.diagnose(fit.core, progress)))
    except _core.ModelError as error:
        raise InputError(f"{fit.data.path}: {error}") from None


def refine(
    fit: Fit, progress: Progress | None = None, on_step: Step | None = None
) -> tuple[Fit, dict[str, Any]]:
    """Diagnose and add until nothing is missing.

    `on_step(fit, step)` is called after every finished step, the first being `fit` as it stands. Returns the last
    fit and the contract's `refine` JSON. Errors: InputError where the measurements are gone or changed.
    """

    def forward(core: _core.Fit, step: str) -> None:
        if on_step is not None:
            on_step(from_core(fit, core), json.loads(step))

    try:
        core, result = _core.refine(fit.core, forward, progress)
    except _core.ModelError as error:
        raise InputError(f"{fit.data.path}: {error}") from None
    return from_core(fit, core), json.loads(result)
