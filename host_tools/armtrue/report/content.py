"""Everything that a report shows, gathered once: the page, the workbench and notebooks draw the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.arrays import Array
from armtrue.candidates import name as called
from armtrue.diagnosis import diagnose
from armtrue.fitting import Fit
from armtrue.progress import Progress
from armtrue.report.gathered.binned import Binned, binned
from armtrue.report.gathered.refits import between, with_candidate
from armtrue.report.gathered.spectrum import Spectrum, spectra_of
from armtrue.report.gathered.state import (
    Direction,
    Variable,
    directions,
    independent,
    tiny_levers,
    turned_by,
    variables,
)
from armtrue.report.gathered.steps import Step, check_same_data, steps_of, titles_of
from armtrue.report.gathered.structure import Finding, findings_of

_LEADING = 3
_NOTHING = 1e-9  # rounding error, as a share of the largest reading
_AXES = 3
# A joint's variable is shown as that joint's error if that explains at least this share of the best direction's.
_OWN_JOINT = 0.75


@dataclass(frozen=True)
class View:
    """The residual over one variable along one direction. `first`: of the first step, None where there is but one."""

    variable: Variable
    direction: Direction
    last: Binned
    first: Binned | None

    @property
    def strongest(self) -> float:
        """The larger share of the variance that bins explain, first or last."""
        return max(self.last.explained, self.first.explained if self.first else 0.0)


@dataclass(frozen=True)
class AddedVariable:
    """Added-variable plot of a candidate: three readings a pose, six where orientations were measured.

    `added` (M,): change of the prediction when the candidate and the model are fitted together. `left` (M,): residual
    without it. Readings that it explains lie on the line of slope 1. `unit`: µm, or σ, standard deviations of the
    noise, where orientations were measured. `turned` (M,): mask of the readings that are angles.
    """

    name: str
    candidate: dict[str, Any]
    added: Array
    left: Array
    unit: str
    turned: NDArray[np.bool_]

    @property
    def explained(self) -> float:
        """Share of Σ left² that fitting the candidate removes."""
        total = float(self.left @ self.left)
        after = self.left - self.added
        return 1.0 - float(after @ after) / total if total > 0.0 else 0.0

    @property
    def adds_nothing(self) -> bool:
        """True where the model's parameters can do all that the candidate does, so that a fit holds it at nominal."""
        return bool(np.max(np.abs(self.added)) <= _NOTHING * np.max(np.abs(self.left)))


@dataclass(frozen=True)
class StepDiagnosis:
    """Diagnosis of one step, with spectra, added variables of its leading candidates, and unexplained findings.

    `not_drawn`: leading candidates whose fit would take too long, or that are in the model on these joints already.
    """

    step: Step
    result: dict[str, Any]
    spectra: list[Spectrum]
    added_variables: list[AddedVariable]
    not_drawn: list[str]
    findings: list[Finding]


@dataclass(frozen=True)
class Report:
    """Steps of one calibration with what is shown of them.

    `diagnoses`: of every step. `tiny_levers`: joints whose axis is so near to the reflector that no residual is read as
    their error, with the reflector's median distance from that axis [m].
    """

    steps: list[Step]
    variables: list[Variable]
    directions: list[Direction]
    diagnoses: list[StepDiagnosis]
    tiny_levers: dict[int, float]

    @property
    def first(self) -> Step:
        """The step that the report starts from."""
        return self.steps[0]

    @property
    def last(self) -> Step:
        """The step that the report is about."""
        return self.steps[-1]

    def view(self, variable: Variable, direction: Direction) -> View:
        """The residual over a variable along a direction, rejected rows left out."""

        def of(step: Step) -> Binned:
            used = step.used
            readings = direction.read(step.residual_m)[used]
            return binned(variable.values[used], readings, direction.weight[used])

        return View(variable, direction, of(self.last), of(self.first) if len(self.steps) > 1 else None)

    def telling_views(self) -> list[View]:
        """One view a variable, along the direction that shows most; the variable that shows most first."""
        return sorted(map(self._most_telling, self.variables), key=lambda view: -view.strongest)

    def _most_telling(self, variable: Variable) -> View:
        views = [self.view(variable, direction) for direction in self.directions]
        best = max(views, key=lambda view: view.strongest)
        own = next((view for view in views if view.direction.name == f"motor{variable.joint}"), best)
        return own if own.strongest >= _OWN_JOINT * best.strongest else best


def gather(
    fits: list[Fit],
    progress: Progress | None = None,
    names: list[str] | None = None,
    known: Sequence[dict[str, Any] | None] = (),
) -> Report:
    """Everything that a report of these fits, first to last step, shows.

    `known`: the `diagnose` JSON of each fit where that was worked out before; others are diagnosed.
    `names`: what the fits are called; otherwise their files, or `fit 1`, `fit 2` … where they are not saved. Errors:
    InputError where measurements are gone or changed, or where the fits are not of the same ones.
    """
    check_same_data(fits)
    titles = titles_of(fits, names)
    shown: list[tuple[Fit, str | None]] = [(fits[0], titles[0])]
    for (before, after), title in zip(pairwise(fits), titles[1:], strict=True):
        shown += [*((fit, None) for fit in between(before, after)), (after, title)]
    steps = steps_of(shown)
    of_given = iter([*known, *[None] * len(fits)])
    last = steps[-1].fit
    along = directions(last)
    diagnoses = []
    for step in steps:
        known_of_step = next(of_given) if step.given else None
        inner = step not in (steps[0], steps[-1])
        diagnoses.append(_diagnosed(step, known_of_step, along, progress, inner))
    return Report(steps, variables(last), along, diagnoses, tiny_levers(last))


def shown_again(fits: list[Fit], names: list[str], results: list[dict[str, Any]]) -> Report:
    """A report of fits whose diagnoses, with spectra, are known already; nothing is fitted for it.

    It has no added variables. `results`: the `diagnose` JSON of each fit, or none at all where no section that needs
    one is drawn.
    """
    check_same_data(fits)
    steps = steps_of(list(zip(fits, names, strict=True)), numbered=False)
    along = directions(fits[-1])
    diagnoses = [_shown(step, result, along) for step, result in zip(steps, results, strict=bool(results))]
    return Report(steps, variables(fits[-1]), along, diagnoses, tiny_levers(fits[-1]))


def added_variable(fit: Fit, candidate: dict[str, Any]) -> AddedVariable | None:
    """The added-variable plot of a candidate of `fit`; None where its fit would take too long."""
    (step,) = steps_of([(fit, "")])
    return _added_variable(step, candidate)


def _diagnosed(
    step: Step, known: dict[str, Any] | None, along: list[Direction], progress: Progress | None, between: bool
) -> StepDiagnosis:
    """A diagnosis with added variables of its leading candidates; if `between`, only of those that it recommends."""
    shown = _shown(step, known or diagnose(step.fit, progress), along)
    result = shown.result
    leading = result["candidates"][:_LEADING]
    if between:
        leading = [candidate for candidate in result["candidates"] if candidate["recommend"]]
    plots = [(called(candidate), _added_variable(step, candidate)) for candidate in leading]
    drawn = [plot for _, plot in plots if plot is not None]
    not_drawn = [name for name, plot in plots if plot is None]
    return replace(shown, added_variables=drawn, not_drawn=not_drawn)


def _shown(step: Step, result: dict[str, Any], along: list[Direction]) -> StepDiagnosis:
    """A diagnosis with its spectra and findings, and without added variables."""
    joints = step.fit.robot.joints
    readings = {number: _independent(step, number, along) for number in range(1, len(joints) + 1)}
    spectra = spectra_of(result, joints, readings)
    return StepDiagnosis(step, result, spectra, [], [], findings_of(step, result))


def _independent(step: Step, number: int, along: list[Direction]) -> float:
    """Number of independent readings of a joint (1-based) among the rows used, which exclude gross errors."""
    used, fit = step.used, step.fit
    visit = np.arange(int(used.sum()))
    if "target" in fit.data.columns:
        # Reflectors measured at one pose all see the same error of the joints: they are one visit.
        visit = np.unique(fit.data.joints[used], axis=0, return_inverse=True)[1].ravel()
    lever = fit.coordinate_column(f"motor{number}")
    if step.turned_rad is not None:
        noise = fit.document["noise"]
        position, turn = 1e-6 * noise["sigma_um"], noise["sigma_rotation_rad"]
        residual = np.hstack([step.residual_m / position, step.turned_rad / turn])
        both = np.hstack([lever / position, turned_by(fit, number) / turn])
        return independent(residual[used], both[used], visit)
    # Positions alone do not show a joint whose axis runs through the reflector.
    shown = any(direction.name == f"motor{number}" for direction in along)
    return independent(step.residual_m[used], lever[used], visit) if shown else float(used.sum())


def _added_variable(step: Step, candidate: dict[str, Any]) -> AddedVariable | None:
    refitted = with_candidate(step.fit, candidate)
    if refitted is None:
        return None
    # By the Frisch–Waugh–Lovell theorem the candidate's columns, with all fitted columns projected out, contribute
    # exactly the change of the prediction when everything is fitted together.
    used = step.used
    if step.fit.document["noise"]["sigma_rotation_rad"] is None:
        left, after, unit = 1e6 * step.residual_m[used], 1e6 * refitted.residuals()[used], "µm"
    else:
        left, unit = step.fit.residuals_in_noise()[used], "σ"
        with step.fit.lock:
            after = np.asarray(_core.residuals_in_noise(refitted.core, step.fit.core))[used]
    turned = np.tile(np.arange(left.shape[1]) >= _AXES, len(left))
    return AddedVariable(called(candidate), candidate, (left - after).ravel(), left.ravel(), unit, turned)
