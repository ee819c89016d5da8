"""Opens fits for commands, with their measurements, which may have moved."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from armtrue.errors import InputError, RowError
from armtrue.io.files import refuse_to_lose

if TYPE_CHECKING:
    from armtrue.fitting import Fit
    from armtrue.io import Dataset, Robot


def load_with_data(path: Path, data: Path | None, writes: Iterable[Path | str | None]) -> Fit:
    """Return the fit at `path` with its measurements read: from `data`, or from the place stored in the fit.

    `writes`: what the command will write. Errors: InputError that says where the measurements were looked for, that
    they have changed, or that one of `writes` is a file of them.
    """
    from armtrue.fitting import Fit

    fit = Fit.load(path)
    # With a resolved path, messages name places beside the fit in full, and each once.
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
        raise InputError(f"{error}; if they were moved, name them with --data DATA") from None
    # The fit names these files; the guard of all commands has checked only those of the command line.
    refuse_to_lose([fit.data.path, fit.data.file], writes)
    return fit


def load_measurements(
    path: Path, robot: Robot, writes: Iterable[Path | str | None], *, skip_bad: bool, strict: bool = True
) -> Dataset:
    """Return the measurements at `path`; without `skip_bad`, the refusal of a row says how to read the others.

    `writes`: as of `load_with_data`.
    """
    from armtrue.io import load_data

    try:
        measurements = load_data(path, robot, skip_bad=skip_bad, strict=strict)
    except RowError as error:
        raise InputError(f"{error}; --skip-bad reads the other rows") from None
    refuse_to_lose([measurements.file], writes)
    return measurements


def beyond_the_fit(tables: Path, fit: Path | None, poses: Path) -> list[str]:
    """Sentences, as of predict and compare, on where `poses` lie outside the measurements that `tables` were fitted to.

    `fit`: the fit that the table was made from; default: the copy beside it. Empty if there is none.
    """
    from armtrue.fitting import Fit
    from armtrue.io import load_data
    from armtrue.tables.compensate import sidecar
    from armtrue.tables.fitted import digest_of
    from armtrue.tables.image import Image

    try:
        made_from = Fit.load(fit or sidecar(tables))
        if digest_of(made_from.document) != Image.load(tables).header["fit_digest"]:
            return []
        return made_from.extrapolated(load_data(poses, made_from.robot, need_position=False), of_the_arm=True)
    except InputError:
        return []
