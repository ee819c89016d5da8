"""The fits of a report as steps of one calibration: the changes and the residuals of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.arrays import Array
from armtrue.candidates import name
from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.verdicts import FLOOR_SOURCES, scored


@dataclass(frozen=True)
class Step:
    """One fit of a calibration.

    `number`: from 1; 0 where steps are not numbered. `title`: its file's name, or its changes where it was fitted for
    the report (`given` is False then). `added`, `removed`: names of effects, relative to the step before.
    `residual_m`: measured minus predicted (N, 3), measuring frame. `turned_rad`: measured relative to predicted
    orientation (N, 3) as a rotation vector in the measuring frame; None where no orientations were measured. `used`:
    mask of the rows that were fitted (N,).
    """

    number: int
    title: str
    fit: Fit
    given: bool
    added: list[str]
    removed: list[str]
    residual_m: Array
    turned_rad: Array | None
    used: NDArray[np.bool_]

    @property
    def called(self) -> str:
        """The step's number and changes."""
        if not self.number:
            return self.title
        did = self.title if self.number == 1 else _changes(self.added, self.removed)
        return f"step {self.number}: {did}"

    @property
    def error(self) -> dict[str, Any]:
        """`nominal`, `train` and `held_out` with mean_um, rms_um, p95_um, max_um; None where no pose was scored."""
        error = self.fit.document["error"]
        ways = {way: scored(figures) for way, figures in error["held_out_by"].items() if figures}
        return {**error, "held_out": scored(error["held_out"]), "held_out_by": ways}

    @property
    def noise_floor_um(self) -> float | None:
        """Mean distance that measurement noise and repeatability alone would leave; None where it is not known."""
        floor = self.fit.document["noise_floor"]["um"]
        return None if floor is None else float(floor)


def floor_source(step: Step) -> str:
    """The source of the noise floor, in words."""
    source = str(step.fit.document["noise_floor"]["source"])
    return FLOOR_SOURCES.get(source, source)


def check_same_data(fits: list[Fit]) -> None:
    """Raise InputError where there is no fit, or where two of them are of different measurements."""
    if not fits:
        raise InputError("report: found no fit, expected at least one")
    first = fits[0].document["data"]
    for fit in fits:
        if fit.document["data"]["sha256"] != first["sha256"]:
            raise InputError(
                f"{fit.path or 'fit'}: found measurements {fit.document['data']['path']}, expected those of the first"
                f" fit, {first['path']}: a report shows steps of one calibration"
            )


def titles_of(fits: list[Fit], names: list[str] | None) -> list[str]:
    """Titles of the given fits: `names`, or their file names, or `fit 1`, `fit 2` … where they have no file.

    Errors: InputError where there are more or fewer names than fits.
    """
    if names is None:
        return [f"fit {k}" if fit.path is None else fit.path.stem for k, fit in enumerate(fits, start=1)]
    if len(names) != len(fits):
        raise InputError(f"report: found {len(names)} names for {len(fits)} fits, expected one each")
    return list(names)


def steps_of(fits: list[tuple[Fit, str | None]], *, numbered: bool = True) -> list[Step]:
    """Steps from fits of the same measurements, in order; a title of None marks a fit that the report made."""
    steps: list[Step] = []
    for fit, title in fits:
        before = effects_of(steps[-1].fit) if steps else []
        after = effects_of(fit)
        added = _names([effect for effect in after if effect not in before]) if steps else []
        removed = _names([effect for effect in before if effect not in after])
        used = np.ones(int(fit.document["data"]["rows"]), dtype=np.bool_)
        used[[int(rejected["index"]) for rejected in fit.document["rejected"]]] = False
        steps.append(
            Step(
                number=len(steps) + 1 if numbered else 0,
                title=_changes(added, removed) if title is None else title,
                fit=fit,
                given=title is not None,
                added=added,
                removed=removed,
                residual_m=fit.residuals(),
                turned_rad=fit.turns(),
                used=used,
            )
        )
    return steps


def _names(effects: list[tuple[str, tuple[int, ...]]]) -> list[str]:
    """Names of effects with their joints; those of one effect on single joints are merged into one."""
    single: dict[str, list[int]] = {}
    for effect, joints in effects:
        if len(joints) == 1:
            single.setdefault(effect, []).append(joints[0])
    names = []
    for effect, joints in effects:
        whole = sorted(single[effect]) if len(joints) == 1 else list(joints)
        names.append(name({"effect": effect, "joints": whole}))
    return list(dict.fromkeys(names))


def _changes(added: list[str], removed: list[str]) -> str:
    changes = [*(f"+ {effect}" for effect in added), *(f"− {effect}" for effect in removed)]
    return "; ".join(changes) or "the same effects, fitted again"


def effects_of(fit: Fit) -> list[tuple[str, tuple[int, ...]]]:
    """Effects with joints, one for each set of joints that has parameters of its own."""
    found = ((str(p["effect"]), tuple(p["joints"])) for p in fit.document["parameters"])
    return list(dict.fromkeys(found))
