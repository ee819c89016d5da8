"""An effect sketched in text: its terms on a sample arm as formulas, and their graphs over one variable."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.io.catalogue import EffectInfo
from armtrue.units import plural

_POINTS = 33
_BARS = "▁▂▃▄▅▆▇█"
_SHOWN = 4
# Where the joints of the sample arm stand while one of them turns [rad].
_AT_REST = (0.2, -0.4, 0.5, 0.3, 0.6, 0.1)
_SENSORS = ("arm", "base")
_HALF_TURN = math.pi


@dataclass(frozen=True)
class Sweep:
    """One recorded variable that runs from `low` to `high` while the others rest; `words` names it and its range."""

    columns: tuple[str, ...]
    low: float
    high: float
    words: str


def sample_arm() -> dict[str, Any]:
    """A six-axis arm that has all an effect may ask for: masses, gear ratios, thermometers, a parallelogram."""
    rows = [
        (0.0, 0.0, 0.4), (0.3, -90.0, 0.0), (0.8, 0.0, 0.0), (0.1, -90.0, 0.8), (0.0, 90.0, 0.0), (0.0, -90.0, 0.1),
    ]  # fmt: skip
    joints = [
        {"name": f"A{k}", "type": "revolute", "a": a, "alpha": math.radians(alpha), "d": d, "offset": 0.0,
         "gear_ratio": 100.0, "limits": [-_HALF_TURN, _HALF_TURN]}
        for k, (a, alpha, d) in enumerate(rows, start=1)
    ]  # fmt: skip
    return {
        "name": "sample",
        "kinematics": {"convention": "mdh", "joints": joints},
        "links": [{"mass": mass, "com": [0.1, 0.0, 0.05]} for mass in (100.0, 80.0, 50.0, 20.0, 10.0, 5.0)],
        "gravity": [0.0, 0.0, -9.81],
        "temperature": {"reference": 20.0, "sensors": list(_SENSORS)},
        "linkage": {"type": "parallelogram", "joints": [2, 3], "crank": 0.3, "rod": 0.8, "angle": 1.5},
    }


def _columns(sweep: Sweep) -> dict[str, Array]:
    columns: dict[str, Array] = {f"q{k}": np.full(_POINTS, rest) for k, rest in enumerate(_AT_REST, start=1)}
    columns |= {f"qr{name[1:]}": values for name, values in columns.items()}
    constant = {
        f"{stem}{k}": at for k in range(1, 7) for stem, at in (("dir", 1.0), ("travel", 0.1), ("duty", 0.1))
    }
    constant |= {f"temp_{name}": 20.0 for name in _SENSORS}
    constant |= {"x": 2.0, "y": 1.0, "z": 0.5, "time": 0.0, "payload": 0.0}
    columns |= {name: np.full(_POINTS, at) for name, at in constant.items()}
    # Two stations and nests of the instrument.
    columns |= {name: np.where(np.arange(_POINTS) < _POINTS // 2, 1.0, 2.0) for name in ("station", "nest")}
    for name in sweep.columns:
        columns[name] = np.linspace(sweep.low, sweep.high, _POINTS, dtype=np.float64)
        if name.startswith("dir"):
            columns[name] = np.where(columns[name] < 0.0, -1.0, 1.0)
    return columns


def _sweeps(joints: list[int]) -> list[Sweep]:
    """Variables that may drive an effect on `joints`, the likeliest first."""
    order = [*reversed(joints), *(k for k in range(1, 7) if k not in joints)]
    sweeps = [Sweep((f"q{k}", f"qr{k}"), -_HALF_TURN, _HALF_TURN, f"q{k} from -180° to 180°") for k in order]
    sweeps += [Sweep((f"dir{k}",), -1.0, 1.0, f"dir{k} from -1 to 1") for k in order]
    sweeps += [Sweep((f"qr{k}",), -1e-3, 1e-3, f"qr{k}, q{k} at rest") for k in order]
    sweeps += [Sweep((f"temp_{_SENSORS[0]}",), 10.0, 40.0, f"temp_{_SENSORS[0]} from 10 to 40 °C")]
    sweeps += [Sweep(("time",), 0.0, 14400.0, "time from 0 to 4 h")]
    return sweeps


def _terms(info: EffectInfo, joints: list[int], sweep: Sweep) -> dict[str, Any]:
    from armtrue import _core

    request: dict[str, Any] = {"effect": info.id, "joints": joints}
    if info.role == "custom":
        request["options"] = {"name": "mine", "coordinate": "motor2", "expression": "sin(3*q2)"}
    arm = sample_arm()
    for kind in ("revolute", "prismatic"):
        # Some effects exist on prismatic joints only.
        arm["kinematics"]["joints"][1]["type"] = kind
        try:
            return dict(json.loads(_core.effect_terms(json.dumps(arm), _columns(sweep), json.dumps(request))))
        except _core.ModelError as error:
            refused = str(error)
    raise InputError(refused)


def _joints(info: EffectInfo) -> list[int]:
    """Joints of the example, by the kind of joint list that the effect takes."""
    return {"each": [2], "all": [2], "pair": [6, 5]}.get(info.joints, [])


def formulas(info: EffectInfo) -> list[str]:
    """The effect's terms on the sample arm, one line a coordinate: `motor 2 [rad]: sin1·sin(q2) + …`."""
    joints = _joints(info)
    return formula_lines(_terms(info, joints, _sweeps(joints)[0]))


def formula_lines(document: dict[str, Any]) -> list[str]:
    """As `formulas`, of terms that `armtrue._core.effect_terms` gave for some arm."""
    by_coordinate: dict[str, list[str]] = {}
    tables: set[str] = set()
    several = len(document["parameters"]) > 1
    for number, parameter in enumerate(document["parameters"], start=1):
        name = parameter["name"].rpartition("].")[2]
        if name == parameter["name"] or not name.isidentifier():
            name = f"c{number}" if several else "c"
        for term in parameter["terms"]:
            weight = "" if term["weight"] == 1.0 else f"{term['weight']:.4g}·"
            basis = "" if term["expression"] == "1" else f"·{_factor(term['expression'])}"
            by_coordinate.setdefault(term["coordinate"], []).append(f"{weight}{name}{basis}")
            if name.startswith("node"):
                tables.add(term["coordinate"])
    lines = []
    for coordinate, sums in list(by_coordinate.items())[:_SHOWN]:
        # The number of nodes of a table depends on the poses that it is fitted to.
        count = "a term for each node" if coordinate in tables else plural(len(sums), "term")
        more = f" + … ({count})" if len(sums) > _SHOWN else ""
        lines.append(f"{coordinate} += {' + '.join(sums[:_SHOWN])}{more}".replace(" + -", " - "))
    if len(by_coordinate) > _SHOWN:
        lines.append(f"… and {plural(len(by_coordinate) - _SHOWN, 'more coordinate')}")
    lines += [
        f"{p['name']} found from the data: {p['lower']:.4g} to {p['upper']:.4g} {p['unit']}".rstrip()
        for p in document["nonlinear"]
    ]
    return lines


def _factor(expression: str) -> str:
    """An expression as one factor: a sum stands in brackets."""
    text = _spaced(expression)
    bare = text
    while (inner := re.sub(r"\([^()]*\)", "", bare)) != bare:
        bare = inner
    return f"({text})" if re.search(r" [+-] ", bare) else text


def _spaced(expression: str) -> str:
    """An expression with numbers of readable length, without terms that are rounding errors of zero."""
    dust = r"-?\d(?:\.\d+)?e-1[2-9](?:\*\w+)?"
    without_dust = re.sub(rf" \+ {dust}|^{dust} \+ ", "", expression)
    shorter = re.sub(r"\d+\.\d{5,}(?:e-?\d+)?", lambda number: f"{float(number[0]):.4g}", without_dust)
    return shorter.replace(" + -", " - ")


def sketch(info: EffectInfo) -> list[str]:
    """Bar graphs of the first few terms, each over the variable that drives it; empty where all are constant."""
    joints = _joints(info)
    lines: list[str] = []
    drawn: set[str] = set()
    for sweep in _sweeps(joints):
        heading = [f"over {sweep.words}"]
        for parameter in _terms(info, joints, sweep)["parameters"]:
            for term in parameter["terms"]:
                values, name = np.asarray(term["values"]), _spaced(term["expression"])
                if len(drawn) < _SHOWN and name not in drawn and values.size > 1 and np.ptp(values) > 1e-12:
                    drawn.add(name)
                    lines += [*heading, f"{_bars(values)}  {name}"]
                    heading = []
        if len(drawn) == _SHOWN:
            break
    return lines


def _bars(values: Array) -> str:
    share = (values - values.min()) / np.ptp(values)
    return "".join(_BARS[round(float(s) * (len(_BARS) - 1))] for s in share)
