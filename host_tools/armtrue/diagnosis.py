"""Diagnosis of missing effects, and refinement until none is missing. `armtrue._core` computes the numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from armtrue import _core, notebook
from armtrue.candidates import name
from armtrue.fitting import Fit, from_core, refusals_about
from armtrue.progress import Progress
from armtrue.verdicts import length_words, scored_mean_um, verdict_words, why_words


class Diagnosis(dict[str, Any]):
    """What a fit lacks: the `diagnose` JSON (docs/files.md, In a notebook) with properties for its main entries."""

    @property
    def verdict(self) -> str:
        """`nothing_missing`, `missing_effect` or `unexplained_structure`."""
        return str(self["verdict"])

    @property
    def candidates(self) -> list[dict[str, Any]]:
        """Effects that were tried, most evidence first."""
        return list(self["candidates"])

    @property
    def recommended(self) -> dict[str, Any] | None:
        """The candidate to add; None where there is none."""
        return next((candidate for candidate in self["candidates"] if candidate["recommend"]), None)

    @property
    def unexplained(self) -> list[dict[str, Any]]:
        """Variables on which the residuals depend though no effect explains it, most evidence first."""
        return list(self["unexplained"])

    @property
    def advice(self) -> list[str]:
        """What to do next, in sentences."""
        return list(self["advice"])

    def _repr_html_(self) -> str:
        return notebook.diagnosis_html(self)

    def __str__(self) -> str:
        lines = [verdict_words(self)]
        if (best := self.recommended) is not None:
            lines.append(f"{name(best)}: {why_words(best)}")
        lines += [
            f"left over, depends on {entry['variable']}: {entry['shape']}" for entry in self.unexplained
        ]
        return "\n".join(dict.fromkeys([*lines, *(f"– {sentence}" for sentence in self.advice)]))


class Refinement(dict[str, Any]):
    """The `refine` JSON (docs/files.md, In a notebook) with properties for its main entries."""

    @property
    def steps(self) -> list[Diagnosis]:
        """The diagnosis of every step, first that of the given fit; each also has `added` and `removed`."""
        return [Diagnosis(step) for step in self["steps"]]

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The effects of the last step as entries of a model; self["effects"] also has probabilities of added ones."""
        return [
            {key: entry[key] for key in entry if key not in ("probability", "why")}
            for entry in self["effects"]
        ]

    def _repr_html_(self) -> str:
        return notebook.html_table(
            ["held-out mean and change"], [[line] for line in str(self).splitlines()], "Steps"
        )

    def __str__(self) -> str:
        lines = []
        for step in self["steps"]:
            put = [f"+ {name(step['added'])}"] if step.get("added") else []
            changes = "; ".join(put + [f"− {name(entry)}" for entry in step.get("removed") or []])
            mean = length_words(scored_mean_um(step["error"]["held_out"]))
            lines.append(f"{mean:>10} µm  {changes or 'as it stood'}")
        return "\n".join(lines)


Step = Callable[[Fit, Diagnosis], None]


def diagnose(fit: Fit, progress: Progress | None = None) -> Diagnosis:
    """Return what `fit` lacks: the contract's `diagnose` JSON with spectra beside it.

    Errors: InputError where the measurements are gone or changed.
    """
    with fit.lock, refusals_about(fit.data):
        known = set(fit.searched), set(fit.document.get("left_out_effects", []))
        return Diagnosis(json.loads(_core.diagnose(fit.core, progress, *known)))


def refine(fit: Fit, progress: Progress | None = None, on_step: Step | None = None) -> tuple[Fit, Refinement]:
    """Diagnose and add until nothing is missing.

    `on_step(fit, step)` is called after every finished step, the first being `fit` as it stands. Returns the last
    fit and the contract's `refine` JSON. Errors: InputError where the measurements are gone or changed.
    """

    def forward(core: _core.Fit, step: str) -> None:
        if on_step is not None:
            on_step(from_core(fit, core), Diagnosis(json.loads(step)))

    with fit.lock, refusals_about(fit.data):
        core, text = _core.refine(fit.core, forward, progress, set(fit.searched))
    result = json.loads(text)
    refined = from_core(fit, core)
    refined.document["left_out_effects"] = result.pop("left_out")
    refined.document["verdict"] = result["steps"][-1]["verdict"]
    return refined, Refinement(result)
