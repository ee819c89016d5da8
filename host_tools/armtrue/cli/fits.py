"""Fits as commands open them: with their measurements, which may have moved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from armtrue.errors import InputError

if TYPE_CHECKING:
    from armtrue.fitting import Fit


def load_with_data(path: Path, data: Path | None) -> Fit:
    """Return the fit at `path` with its measurements read: from `data`, or from where they lay.

    Errors: InputError that says where they were looked for, or that they have changed.
    """
    from armtrue.fitting import Fit

    fit = Fit.load(path)
    # Places beside the fit are then named whole, and each once.
    fit.path = path.parent.resolve() / path.name
    if data is not None:
        if not data.is_file():
            raise InputError(
                f"--data: found no file '{data.absolute()}', expected the measurements of {path}"
            )
        fit.document["data"]["path"] = str(data.resolve())
    try:
        fit.data  # noqa: B018
    except InputError as error:
        if data is not None:
            raise
        raise InputError(f"{error}; where they lie elsewhere, name them with --data DATA") from None
    return fit
