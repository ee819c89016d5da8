"""Everything that a report shows, gathered once: the page and the figures for notebooks draw the same."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.diagnosis import diagnose
from armtrue.fitting import Fit
from armtrue.progress import Progress
from armtrue.report.binned import Binned, binned
from armtrue.report.names import called
from armtrue.report.refits import between, with_candidate
from armtrue.report.spectrum import Spectrum, spectra_of
from armtrue.report.state import Direction, Variable, directions, variables
from armtrue.report.steps import Step, check_same_data, steps_of

Array = NDArray[np.float64]

_LEADING = 3
# A joint's variable is read as that joint's error unless another direction shows this much more.
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
    """Added-variable plot of a candidate, three readings a pose.

    `added_um` (M,): what it would add to the prediction beyond what the model can take over. `left_um` (M,): what is
    left over. Readings that it explains lie on the line of slope 1.
    """

    name: str
    candidate: dict[str, Any]
    added_um: Array
    left_um: Array

    @property
    def explained(self) -> float:
        """Share of Σ left² that the line through the origin takes away."""
        total = float(self.left_um @ self.left_um)
        square = float(self.added_um @ self.added_um)
        return (
            float(self.left_um @ self.added_um) ** 2 / (square * total)
            if square > 0.0 and total > 0.0
            else 0.0
        )


@dataclass(frozen=True)
class StepDiagnosis:
    """What one step lacks, with spectra and added variables of its leading candidates.

    `not_drawn`: leading candidates whose fit would take too long, or that are in the model on these joints already.
    """

    step: Step
    result: dict[str, Any]
    spectra: list[Spectrum]
    added_variables: list[AddedVariable]
    not_drawn: list[str]


@dataclass(frozen=True)
class Report:
    """Steps of one calibration with what is shown of them. `diagnoses`: of the first and the last step."""

    steps: list[Step]
    variables: list[Variable]
    directions: list[Direction]
    diagnoses: list[StepDiagnosis]

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


def gather(fits: list[Fit], progress: Progress | None = None) -> Report:
    """Everything that a report of these fits, first to last step, shows.

    Errors: InputError where measurements are gone or changed, or where the fits are not of the same ones.
    """
    steps = steps_of(_with_steps_between(fits))
    shown = [steps[0]] if len(steps) == 1 else [steps[0], steps[-1]]
    last = steps[-1].fit
    along = directions(last)
    return Report(steps, variables(last), along, [_diagnosed(step, along, progress) for step in shown])


def _with_steps_between(fits: list[Fit]) -> list[Fit]:
    check_same_data(fits)
    result = fits[:1]
    for before, after in pairwise(fits):
        result += [*between(before, after), after]
    return result


def _diagnosed(step: Step, along: list[Direction], progress: Progress | None) -> StepDiagnosis:
    result = diagnose(step.fit, progress)
    joints = step.fit.robot.joints
    by_name = {direction.name: direction for direction in along}
    independent = {
        number: by_name[f"motor{number}"].independent(step.residual_m)
        for number in range(1, len(joints) + 1)
        if f"motor{number}" in by_name
    }
    spectra = spectra_of(result, joints, independent)
    leading = result["candidates"][:_LEADING]
    plots = {called(candidate): _added_variable(step, candidate) for candidate in leading}
    drawn = [plot for plot in plots.values() if plot is not None]
    return StepDiagnosis(step, result, spectra, drawn, [name for name, plot in plots.items() if plot is None])


def _added_variable(step: Step, candidate: dict[str, Any]) -> AddedVariable | None:
    refitted = with_candidate(step.fit, candidate)
    if refitted is None:
        return None
    # By the Frisch–Waugh–Lovell theorem the candidate's own part, all that is fitted already projected out, is what the
    # prediction gains when everything is fitted together.
    left = step.residual_m[step.used]
    added = left - refitted.residuals()[step.used]
    return AddedVariable(called(candidate), candidate, 1e6 * added.ravel(), 1e6 * left.ravel())
