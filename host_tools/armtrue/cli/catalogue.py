"""The command effects."""

from __future__ import annotations

from typing import Annotated

import typer

from armtrue.cli.shared.options import JsonOption
from armtrue.cli.shared.output import Output
from armtrue.errors import InputError, did_you_mean
from armtrue.io.catalogue import EffectInfo, catalogue

_JOINTS = {
    "none": "no joints",
    "each": "any joints, each on its own",
    "all": "all joints together, or any of them",
    "pair": "driven and driving joint",
    "fixed": "the joints it acts on by itself",
}


def effects(
    effect: Annotated[
        str | None, typer.Argument(metavar="EFFECT", help="One effect, with its options.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """List the effects that a model.yaml may name, or show the formula, curve, physical bound and options of one.

    Example: armtrue effects gear_mesh
    """
    known = catalogue()
    if effect is not None and effect not in known:
        raise InputError(f"effects: found '{effect}', expected an effect{did_you_mean(effect, known)}")
    output = Output(json_to)
    chosen = known if effect is None else {effect: known[effect]}
    for info in chosen.values():
        output.fields(_description(info, full=effect is not None))
    output.figures({info.id: info.document() for info in chosen.values()})


def _description(info: EffectInfo, full: bool) -> list[tuple[str, str]]:
    lines = [(info.id, info.summary)]
    if not full:
        return lines
    from armtrue import sketching

    lines += [
        ("joints", _JOINTS[info.joints]),
        ("formula", "\n".join(sketching.formulas(info))),
        ("bound", info.bound_and_source[0]),
        ("source", info.bound_and_source[1]),
    ]
    drawn = sketching.sketch(info)
    if drawn:
        lines.append(("sketch", "\n".join(drawn)))
    lines += [(f"option {name}", f"{kind}: {help_text}") for name, (kind, help_text) in info.options.items()]
    if not info.exported:
        lines.append(("exported", "no: it belongs to the measurement"))
    return lines
