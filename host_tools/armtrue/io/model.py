"""model.yaml: the effects of the model, prior knowledge of their parameters, and the instrument."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue.errors import InputError, did_you_mean, shorten
from armtrue.io.catalogue import catalogue
from armtrue.io.columns import ColumnNames
from armtrue.io.robot import LARGEST_LEAD_M, Robot
from armtrue.io.yamlfile import Section, load_yaml

# Highest order in waves per turn; no encoder resolves more.
_HIGHEST_ORDER = 10_000.0
# Weak enough not to bias parameters that the data determine, strong enough to hold the others (docs/files.md).
DEFAULT_PRIORS = {"angle_deg": 0.3, "length_mm": 2.0}

# Functions and constants of expressions (docs/model.md).
EXPRESSION_WORDS = frozenset([
    "pi", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "sqrt", "abs", "sign", "tanh", "atan2", "min",
    "max", "hat",
])  # fmt: skip


@dataclass(frozen=True)
class Model:
    """Normalised model.yaml.

    `effects`: a list of {effect, joints?, …options}. `parameters`: NAME → {fixed} or {prior, sigma}, SI units.
    `priors`: standard deviations of the weak priors on geometry. `instrument`: {position, radial, angular} or None.
    """

    effects: list[dict[str, Any]]
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    priors: dict[str, float] = field(default_factory=lambda: dict(DEFAULT_PRIORS))
    instrument: dict[str, Any] | None = None
    path: Path | None = field(default=None, compare=False)


def load_model(path: str | Path, robot: Robot, columns: Collection[str] = ()) -> Model:
    """Read and check the model file at `path` for `robot`.

    `columns`: those of the measurements (`data.columns`); a custom effect may read those outside the contract. Errors:
    InputError naming file and key path, what was found and what was expected.
    """
    path = Path(path)
    top = load_yaml(path)
    effects: list[dict[str, Any]] = []
    for number, entry in enumerate(top.entries("effects", "a list of effects"), start=1):
        place = f"effects[{number}]"
        section = Section({"effect": entry} if isinstance(entry, str) else entry, str(path), place)
        effect = _effect(section, robot, columns)
        for earlier, other in enumerate(effects, start=1):
            if _is_repeat(effect, other):
                raise InputError(
                    f"{section.place()}: found {effect['effect']} a second time (first as effects[{earlier}]), "
                    "expected it once"
                )
        effects.append(effect)
    if not effects:
        raise top.fail("effects", "at least one effect")
    model = Model(effects, _parameters(top), _priors(top), _instrument(top), path)
    top.finish()
    return model


def check_effect(
    effect: dict[str, Any],
    robot: Robot,
    origin: str,
    already: Sequence[dict[str, Any]] = (),
    columns: Collection[str] = (),
) -> dict[str, Any]:
    """Return one effect entry normalised, as `armtrue add` builds it from its arguments.

    `already`: the effects that it must not repeat. `columns`: those of the measurements. Errors: InputError that
    begins with `origin`.
    """
    checked = _effect(Section(effect, origin), robot, columns)
    if any(_is_repeat(checked, other) for other in already):
        raise InputError(
            f"{origin}: found {checked['effect']} in the model already, expected an effect that is not"
        )
    return checked


def refusal_words(
    message: str, effects: Sequence[dict[str, Any]], parameters: Collection[str], rows: NDArray[np.int64]
) -> str:
    """The numerical library's refusal of a model, in words that name the key of model.yaml.

    `message`: "effect …" or "model: …". `effects`: those of the model; `parameters`: the names that these have;
    `rows`: the file row of each measurement.
    """
    if unknown := re.fullmatch(r"model: parameters names '(.+)', which .*", message):
        hint = did_you_mean(unknown[1], parameters) or f" (known: {shorten(', '.join(parameters), 120)})"
        return f"parameters: found '{unknown[1]}', expected the name of a parameter of its effects{hint}"
    if undefined := re.fullmatch(
        r"model: term .* of custom\.(.+) is not finite at measurement ([0-9]+)", message
    ):
        for number, entry in enumerate(effects, start=1):
            if entry.get("name") == undefined[1]:
                return (
                    f"effects[{number}].expression: found {shorten(entry['expression'])}, expected an expression with "
                    f"a finite value at every pose: that of row {rows[int(undefined[2]) - 1]} has none"
                )
    return message.removeprefix("model: ")


def _effect(section: Section, robot: Robot, columns: Collection[str]) -> dict[str, Any]:
    known = catalogue()
    effect_id = section.text("effect", expected="the name of an effect")
    if effect_id not in known:
        hint = did_you_mean(effect_id, known) or f" (known: {', '.join(known)})"
        raise InputError(
            f"{section.place('effect')}: found '{effect_id}', expected an effect of the catalogue{hint}"
        )
    info = known[effect_id]
    effect: dict[str, Any] = {"effect": effect_id}
    if section.has("joints"):
        if info.joints == "none":
            raise section.fail("joints", f"no joints, as {info.id} belongs to none")
        effect["joints"] = section.joints("joints", robot.joint_count, 2 if info.joints == "pair" else None)
    if info.role == "custom":
        effect.update(_custom(section, robot, columns))
    for option, (kind, _) in info.options.items():
        if section.has(option) and option not in effect:
            effect[option] = _option(section, option, kind)
    section.finish()
    return effect


def _option(section: Section, option: str, kind: str) -> Any:
    """Read one option; `kind` as in the catalogue: string, bool, [int], [number], [m], or a unit for a number."""
    if kind == "string":
        return section.text(option)
    if kind == "bool":
        return section.flag(option, default=False)
    if kind == "[number]":
        numbers = section.numbers(option, None, "a list of numbers such as [1,2]")
        if option in ("orders", "cycles") and not all(0.0 < value <= _HIGHEST_ORDER for value in numbers):
            raise section.fail(option, f"numbers above 0 and up to {_HIGHEST_ORDER:g}, cycles a turn")
        return numbers
    if kind == "[m]":
        lengths = section.numbers(option, None, "a list of lengths in metres such as [0.02]")
        if not all(0.0 < value <= LARGEST_LEAD_M for value in lengths):
            raise section.fail(option, f"lengths in metres above 0 and up to {LARGEST_LEAD_M:g}")
        return lengths
    if kind == "[string]":
        return section.texts(option, "a list of texts")
    if kind == "[int]":
        expected = "a list of whole numbers such as [1,2]"
        values = section.numbers(option, None, expected)
        if any(value != int(value) for value in values):
            raise section.fail(option, expected)
        return [int(value) for value in values]
    if kind == "{name: value}":
        named = section.section(option)
        return {name: named.number(name) for name in named}
    return section.number(option, expected="a number" if kind == "number" else f"a number in {kind}")


def _custom(section: Section, robot: Robot, columns: Collection[str]) -> dict[str, Any]:
    from armtrue import _core

    custom: dict[str, Any] = {
        "name": section.text("name", expected="a name for the parameters"),
        "coordinate": section.text("coordinate", expected="a coordinate, such as motor3 or link2.rz"),
        "expression": section.text("expression", expected="an expression of the state"),
    }
    if section.has("parameters"):
        custom["parameters"] = _option(section, "parameters", "{name: value}")
    known = variables_of(robot, columns)
    taken = {*known, *EXPRESSION_WORDS}
    for name in custom.get("parameters", {}):
        if name in taken:
            raise InputError(
                f"{section.place('parameters')}.{name}: found the name of a state variable, column, function or "
                "constant, expected a name of its own"
            )
    coordinates = coordinate_names(robot.joint_count)
    if custom["coordinate"] not in coordinates:
        raise section.fail(
            "coordinate", "a coordinate of the arm" + did_you_mean(custom["coordinate"], coordinates)
        )
    own = custom.get("parameters", {})
    try:
        _core.check_expression(custom["expression"], known, sorted(own))
    except ValueError as error:
        unknown = [name for name in names_in(custom["expression"]) if name not in {*taken, *own}]
        hint = _hint(unknown[0], known, robot, columns) if unknown else ""
        raise InputError(
            f"{section.place('expression')}: found {shorten(custom['expression'])}, "
            f"expected arithmetic of the state: {error}{hint}"
        ) from None
    return custom


def _hint(unknown: str, known: list[str], robot: Robot, columns: Collection[str]) -> str:
    """A suggestion for a name in an expression that is not known."""
    if not columns:
        return f", nor known for a column, as no measurements are read here ('armtrue plan' takes --levels {unknown}=…)"
    # Regressors have hundreds of names, which users do not type.
    typed = [name for name in known if not name.startswith(("u", "tilt"))]
    return did_you_mean(unknown, [*typed, *own_columns(robot, columns)])


def names_in(expression: str) -> list[str]:
    """The names that an expression reads, functions and constants left out, in order of appearance."""
    names = re.findall(r"\b[A-Za-z_]\w*", expression)
    return list(dict.fromkeys(name for name in names if name not in EXPRESSION_WORDS))


def coordinate_names(joint_count: int) -> list[str]:
    """The coordinates that a term may act on (docs/model.md)."""
    frames = ["base", *(f"link{k}" for k in range(1, joint_count + 1)), "tool"]
    sixes = [f"{frame}.{axis}" for frame in frames for axis in ("tx", "ty", "tz", "rx", "ry", "rz")]
    return [*(f"motor{k}" for k in range(1, joint_count + 1)), *sixes]


def state_names(robot: Robot, sensors: Sequence[str] = ()) -> list[str]:
    """The state variables that an expression may read (docs/model.md); `sensors`: besides those of robot.yaml."""
    from armtrue import _core

    variables = json.loads(_core.state_variables(robot.joint_count, [*robot.sensors, *sensors]))
    return [variable["name"] for variable in variables]


def own_columns(robot: Robot, columns: Iterable[str]) -> list[str]:
    """Those of `columns` outside the contract, which are variables under their own names."""
    names = ColumnNames(robot)
    return [name for name in columns if names.kind(name) is None]


def variables_of(robot: Robot, columns: Collection[str]) -> list[str]:
    """The state variables that an expression may read where the measurements have `columns`."""
    sensors = [name.removeprefix("temp_") for name in columns if name.startswith("temp_")]
    return [*state_names(robot, sensors), *own_columns(robot, columns)]


def _is_repeat(effect: dict[str, Any], other: dict[str, Any]) -> bool:
    """True if the two entries are equal and share joints, or the pair; the fitter itself checks other overlaps."""
    if {**effect, "joints": []} != {**other, "joints": []}:
        return False
    if catalogue()[effect["effect"]].joints == "pair" or "joints" not in effect or "joints" not in other:
        return effect.get("joints") == other.get("joints")
    return bool(set(effect["joints"]) & set(other["joints"]))


def _parameters(top: Section) -> dict[str, dict[str, float]]:
    section = top.optional("parameters")
    result: dict[str, dict[str, float]] = {}
    for name in section:
        entry = section.section(name)
        if entry.has("fixed"):
            result[name] = {"fixed": entry.number("fixed", expected="a value in SI units")}
        else:
            sigma = entry.number("sigma", above=0.0, expected="a standard deviation above 0")
            result[name] = {"prior": entry.number("prior"), "sigma": sigma}
    return result


def _priors(top: Section) -> dict[str, float]:
    section = top.optional("priors")
    return {
        name: section.number(name, default, above=0.0, expected="a standard deviation above 0")
        for name, default in DEFAULT_PRIORS.items()
    }


def _instrument(top: Section) -> dict[str, Any] | None:
    if not top.has("instrument"):
        return None
    section = top.section("instrument")
    laws = {}
    for part in ("radial", "angular"):
        law = section.section(part)
        expected = "metres per metre of distance, not negative"
        laws[part] = {
            "a": law.number("a", above=0.0, expected="a standard deviation in metres, above 0"),
            "b": law.number("b", default=0.0, minimum=0.0, expected=expected),
        }
    position = section.numbers("position", 3, "a list [x, y, z] in metres", default=[0.0, 0.0, 0.0])
    return {"position": position, **laws}
