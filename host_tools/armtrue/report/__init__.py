"""The report of a calibration as one HTML page. `armtrue.report.figures` shows its sections in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armtrue.fitting import Fit
from armtrue.io.files import check_writable, write_file
from armtrue.progress import Progress
from armtrue.report.content import Report, gather
from armtrue.report.page import page

__all__ = ["Report", "gather", "write"]


def write(
    fits: list[Fit],
    path: str | Path,
    progress: Progress | None = None,
    names: list[str] | None = None,
    known: Sequence[dict[str, Any] | None] = (),
) -> None:
    """Write the report of `fits`, first to last step of one calibration, as one self-contained HTML page.

    `names`, `known`: as of `gather`. Errors: InputError where measurements are gone (it says where they were looked
    for) or changed, where the fits are not of the same ones, or where `path` cannot be written.
    """
    path = Path(path)
    check_writable(path)
    write_file(path, page(gather(fits, progress, names, known)))
