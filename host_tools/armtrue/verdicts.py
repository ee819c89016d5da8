"""Wording of a diagnosis and of errors, the same in the terminal, in a notebook and in the report."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from armtrue.candidates import spelled

_WORDS = {
    "nothing_missing": "Nothing is missing: what is left is noise.",
    "missing_effect": "An effect is missing.",
    "unexplained_structure": "What is left has structure that no effect of the catalogue explains.",
}

VERDICTS = tuple(_WORDS)

# Where a noise floor comes from, by its `source`.
FLOOR_SOURCES = {
    "repeats": "from poses measured again",
    "targets": "of the instrument alone, from distances between reflectors on one tool",
    "sigma": "from the stated sigma",
    "none": "nothing recorded tells it",
}

# Why the floor of `repeats` differs from one model to the next.
FLOOR_MOVES = (
    "The noise floor is the scatter of the errors at poses measured again. It falls when the model explains why two "
    "visits of a pose differ, such as by temperature; from few repeats it can come out above the held-out error."
)

# A candidate explains nearly as much as the first from this share of the first's `explained` on (docs/planning.md).
_NEARLY = 0.9
# A held-out error above this many noise floors is more than noise: many unknowns alone do not raise it as far.
_FAR_ABOVE = 2.0
# The same for the training error; the advice then says what may differ between visits of a pose.
_WELL_ABOVE = 1.5

OTHER_SENSOR_ADVICE = (
    "Thermometers are told apart by poses measured while they do not move together; "
    "armtrue plan chooses them."
)


NOT_SCORED = "not scored"
# Names of an error's figures by their keys, and of the parts of a fit's error.
ERROR_FIGURES = {"mean_um": "mean", "rms_um": "RMS", "p95_um": "95 %", "max_um": "max"}
PARTS_OF_ERROR = {
    "nominal": "nominal, base and tool fitted", "train": "training poses", "held_out": "held-out poses",
}  # fmt: skip


def with_signs(sentence: str) -> str:
    """A sentence of the diagnosis, which is plain ASCII, with names, units and arrows as they are printed."""
    return spelled(sentence).replace(" um", " µm").replace(" urad", " µrad").replace("->", "→")


def scored(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Error figures as they are; all None where no pose could be scored, for then they say nothing."""
    if figures.get("n") != 0:
        return dict(figures)
    return {key: None if key.endswith("_um") else value for key, value in figures.items()}


def scored_mean_um(figures: Mapping[str, Any]) -> float | None:
    """Mean of held-out error figures; None where no pose could be scored."""
    mean = scored(figures).get("mean_um")
    return None if mean is None else float(mean)


def length_words(value_um: float | None) -> str:
    """A length of an error table in µm, or that no pose was scored."""
    return NOT_SCORED if value_um is None else f"{value_um:.1f}"


def error_words(figures: Mapping[str, Any]) -> list[str]:
    """The ERROR_FIGURES of an error table in µm, or that no pose was scored."""
    return [length_words(scored(figures)[key]) for key in ERROR_FIGURES]


def chance(probability: float) -> str:
    """A probability in percent; near 0 and 1 as the bound that sampling can support."""
    if probability > 0.995:
        return "> 99 %"
    return "< 1 %" if probability < 0.005 else f"{100 * probability:.0f} %"


def needs_words(needs: Sequence[str]) -> str:
    """What an untestable effect needs: `the columns qr1 to qr6`, `linkage in robot.yaml`."""
    columns = [need for need in needs if " " not in need]
    parts = [need for need in needs if " " in need]
    if columns:
        numbers = [int(digits[0]) for column in columns if (digits := re.search(r"\d+$", column))]
        is_run = len(columns) > 2 and numbers == list(range(numbers[0], numbers[0] + len(columns)))
        listed = f"{columns[0]} to {columns[-1]}" if is_run else ", ".join(columns)
        parts.insert(0, f"the column{'s' if len(columns) > 1 else ''} {listed}")
    return ", ".join(parts)


def why_words(candidate: Mapping[str, Any]) -> str:
    """Why a candidate is recommended or not, its probability worded by `chance`: the library rounds it to percent."""
    said = f"probability {chance(candidate['probability'])}"
    return re.sub(r"^probability \d+ %", said, with_signs(candidate["why"]))


def verdict_words(diagnosis: dict[str, Any]) -> str:
    """The verdict of a diagnosis as a sentence. Residuals are called noise only where the noise floor is known."""
    verdict = str(diagnosis["verdict"])
    floor = diagnosis.get("noise_floor_um")
    if verdict != "nothing_missing":
        return _WORDS.get(verdict, verdict)
    if floor is None:
        return "Nothing to add was found; whether what is left is noise is not known."
    error = diagnosis.get("error", {})
    most = {"train": _WELL_ABOVE * floor, "held_out": _FAR_ABOVE * floor}
    if any((error.get(part, {}).get("mean_um") or 0.0) > limit for part, limit in most.items()):
        return "Nothing to add was found, but what is left is more than noise."
    return _WORDS[verdict]


def of_other_sensors(first: dict[str, Any], candidates: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Candidates that are `first` read from another thermometer and explain nearly as much.

    `confounded_with` does not list these, because its names do not contain the sensor.
    """
    return [
        other
        for other in candidates
        if (other["effect"], other["joints"]) == (first["effect"], first["joints"])
        and sensor_of(other) != sensor_of(first)
        and other["explained"] >= _NEARLY * first["explained"]
    ]


def sensor_of(candidate: dict[str, Any]) -> Any:
    """The thermometer that a candidate reads; None where it reads none, or the arm has only one."""
    return (candidate.get("options") or {}).get("sensor")
