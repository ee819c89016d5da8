"""Effects of the measurement and not of the arm, and effects that a user or a test writes as an expression."""

from __future__ import annotations

from collections.abc import Iterator

from ..arm import Term
from ..errors import ScenarioError
from ..mechanics.expression import variables
from .base import EffectContext, Sizes, driven_joints, effect, no_joint

DAY = 86400.0


@effect("time_drift", no_joint)
def time_drift(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """Tracker or base creeps by 30 to 130 um a day along each axis, and turns by 10 to 40 urad a day."""
    for c in ("tx", "ty", "tz", "rx", "ry", "rz"):
        drawn = sizes.signed(3e-5, 1.3e-4) if c[0] == "t" else sizes.signed(1e-5, 4e-5)
        value = sizes.value(c, drawn / DAY)
        yield Term("time_drift", (), f"base.{c}", "time", value, "m/s" if c[0] == "t" else "rad/s")


@effect("command_readback", driven_joints)
def command_readback(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """The arm really stood at the joints read back, not at the commanded ones: coefficient -1 on q - qr."""
    for k in joints:
        value = sizes.value("value", -1.0, k)
        yield Term("command_readback", (k,), f"motor{k}", f"q{k} - qr{k}", value, "1")


@effect("custom", no_joint)
def custom(context: EffectContext, joints: list[int], sizes: Sizes) -> Iterator[Term]:
    """`value` times `expression` (grammar of docs/model.md) on `coordinate`: for effects outside the catalogue."""
    coordinate, expression = sizes.option("coordinate", None), sizes.option("expression", None)
    if coordinate is None or expression is None or "value" not in sizes.given:
        raise ScenarioError("custom: needs name, coordinate, expression and value")
    sizes.option("name", "custom")
    variables(str(expression))
    unit = "m" if str(coordinate).partition(".")[2].startswith("t") else "rad"
    yield Term("custom", tuple(joints), str(coordinate), str(expression), sizes.value("value", 0.0), unit)
