"""The part of a fit that goes into tables: exported terms, with 1-D tables and grids assembled from their nodes."""

from __future__ import annotations

import hashlib
import json
import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armtrue import _core
from armtrue.arrays import Array
from armtrue.errors import InputError
from armtrue.fit_file import at_average, not_for_a_device
from armtrue.io.catalogue import catalogue
from armtrue.io.columns import FAR_TRAVEL, TRAVEL
from armtrue.tables import expression
from armtrue.tables.chain import Chain, chain_from_robot, pose

# Variables that are a load per radian of the base's rotation about an axis (docs/model.md).
_TILT = re.compile(r"\btilt[xy]?_[0-9]+_([xyz])\b")


@dataclass(frozen=True)
class Axis:
    """One axis of a table: the state variable it reads and its nodes, ascending, in that variable's unit."""

    variable: str
    nodes: tuple[float, ...]


@dataclass
class Grid:
    """A 1-D table or multilinear grid on one coordinate.

    `values` has one dimension an axis; `covered` says which nodes were trained. Uncovered nodes are zero.
    """

    name: str
    coordinate: str
    axes: tuple[Axis, ...]
    values: Array
    covered: NDArray[np.bool_]

    def evaluate(self, columns: dict[str, Array]) -> Array:
        """Multilinear interpolation; neutral outside, fading to zero over the width of the outermost cell."""
        shape = columns[self.axes[0].variable].shape
        total = np.zeros(shape)
        places = [locate(np.asarray(axis.nodes), columns[axis.variable]) for axis in self.axes]
        for corner in np.ndindex(*(2,) * len(self.axes)):
            weight = np.ones(shape)
            index = []
            for far, (cell, within, fade) in zip(corner, places, strict=True):
                weight = weight * fade * (within if far else 1.0 - within)
                index.append(cell + far)
            total += weight * self.values[tuple(index)]
        return total


def locate(nodes: Array, at: Array) -> tuple[NDArray[np.intp], Array, Array]:
    """Cell, position within it (0 … 1), and the fade factor (1 inside the nodes, 0 a cell's width outside)."""
    cell = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, nodes.size - 2)
    within = (at - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    away = np.maximum(0.0, np.maximum(-within, within - 1.0))
    return cell, np.clip(within, 0.0, 1.0), np.clip(1.0 - away, 0.0, 1.0)


@dataclass
class FittedArm:
    """The exported part of a fit. `terms`: coordinate → {expression text: coefficient}, like terms added up."""

    name: str
    serial: str
    digest: bytes  # SHA-256 over everything here
    chain: Chain
    measuring_from_base: Array
    flange_from_tool: dict[str, Array]
    payload_point: Array  # in the flange, m
    payload_kg: float = 0.0  # the largest that was measured
    # Loads are those of the nominal arm at the commanded joints, not where the arm stands (fit.json `statics`).
    loads_act_at_command: bool = False
    terms: dict[str, dict[str, float]] = field(default_factory=dict)
    # Effects that a term comes from, by coordinate and expression: for messages.
    effects: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    grids: list[Grid] = field(default_factory=list)
    # Effects that belong to the measurement, with how far each moves what was measured [µm RMS].
    skipped: dict[str, float | None] = field(default_factory=dict)
    # Effects of the arm that the table omits, wholly or on short moves (a user's own by the names of their parameters):
    # the reason, and how far each moves the tool [µm RMS].
    stays_behind: dict[str, tuple[str, float | None]] = field(default_factory=dict)

    def payload_in_last_link(self) -> Array:
        """`payload_point` in the last link's frame, m."""
        return np.asarray((self.chain.end @ [*self.payload_point, 1.0])[:3])

    def variables(self) -> set[str]:
        """State variables that the exported terms read."""
        names: set[str] = set()
        for basis in self.terms.values():
            for text in basis:
                names |= expression.parse(text).variables()
        for grid in self.grids:
            names |= {axis.variable for axis in grid.axes}
        return names


def digest_of(document: dict[str, Any]) -> bytes:
    """SHA-256 of what a fit says about the arm: the same for the same fit, however its file is laid out."""
    parts = {
        key: document.get(key)
        for key in ("robot", "parameters", "measuring_from_base", "flange_from_tool", "payload_point")
    }
    # This part and the next exist only where they apply, so that digests in older tables still match.
    if document.get("statics") == "nominal":
        parts["statics"] = "nominal"
    if averaged := sorted(not_for_a_device(document)):
        parts["averaged"] = [averaged, document.get("data", {}).get("means")]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).digest()


def fitted_arm(document: dict[str, Any], path: object) -> FittedArm:
    """Read the content of a fit.json. `path` is for messages. Errors: InputError."""
    try:
        robot, point = document["robot"], document.get("payload_point")
        arm = FittedArm(
            name=str(robot.get("name", "robot")),
            serial=str(robot.get("serial", "")),
            digest=digest_of(document),
            chain=chain_from_robot(robot),
            measuring_from_base=pose(document["measuring_from_base"]),
            flange_from_tool={name: pose(entry) for name, entry in document["flange_from_tool"].items()},
            payload_point=pose(robot.get("tool"))[:3, 3]
            if point is None
            else np.array(point, dtype=np.float64),
            payload_kg=float(document.get("data", {}).get("ranges", {}).get("payload", [0.0])[-1]),
            loads_act_at_command=document.get("statics") == "nominal",
        )
        reflectors = document.get("data", {}).get("targets") or list(arm.flange_from_tool)
        _gather(document, arm, reflectors)
    except _core.ExpressionError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, IndexError) as error:
        raise InputError(f"{path}: found no {error}, expected a complete fit.json") from None
    return arm


def _with_reflector(coordinate: str, reflectors: list[str]) -> str:
    """A fit numbers reflectors from 0 in the order of `reflectors`; tables know them by name."""
    if not coordinate.startswith("tool["):
        return coordinate
    number, rest = coordinate[5:].split("]", 1)
    return f"tool[{reflectors[int(number)]}]{rest}"


def _gather(document: dict[str, Any], arm: FittedArm, reflectors: list[str]) -> None:
    nodes: dict[tuple[str, str], list[tuple[dict[str, Any], float]]] = defaultdict(list)
    skipped: dict[str, None] = {}
    behind: dict[str, str] = {}
    left_out = not_for_a_device(document)
    means = document.get("data", {}).get("means", {})
    gravity = arm.chain.gravity.copy()
    for parameter in document["parameters"]:
        effect = parameter["effect"]
        if parameter.get("name") in left_out:
            behind[parameter["name"]] = left_out[parameter["name"]]
            if not means:  # the fit has none stored
                continue
            parameter = at_average(parameter, means)
        if not parameter.get("exported", True):
            info = catalogue().get(effect)
            if info is None or not info.exported:
                skipped[effect] = None
            elif info.role == "custom":
                skipped[parameter["name"]] = None
            else:
                behind[effect] = "it depends on a quantity that a device does not know"
            continue
        tilts = [_TILT.findall(term["expression"]) for term in parameter["terms"]]
        if tilts and all(tilts):
            # Loads are linear in gravity, so such a parameter is equivalent to another direction of gravity.
            about = np.eye(3)["xyz".index(tilts[0][0])]
            gravity += float(parameter["value"]) * np.cross(arm.chain.gravity, about)
            continue
        for term in parameter["terms"]:
            coefficient = float(parameter["value"]) * float(term["weight"])
            coordinate = _with_reflector(term["coordinate"], reflectors)
            table = term.get("table")
            text = TRAVEL.sub(f"{FAR_TRAVEL:g}", term["expression"])
            if text != term["expression"]:
                behind[effect] = (
                    "a device does not know the travel of a joint since its last reversal, and assumes a long one"
                )
            if table and _is_node(text, table):
                nodes[table["id"], coordinate].append((table, coefficient))
            else:
                expression.parse(text)
                basis = arm.terms.setdefault(coordinate, {})
                basis[text] = basis.get(text, 0.0) + coefficient
                sources = arm.effects.setdefault((coordinate, text), [])
                if effect not in sources:
                    sources.append(effect)
    arm.chain = replace(arm.chain, gravity=gravity)
    arm.terms = {
        coordinate: kept
        for coordinate, basis in arm.terms.items()
        if (kept := {text: c for text, c in basis.items() if c != 0.0})
    }
    arm.grids = [_grid(name, coordinate, entries) for (name, coordinate), entries in nodes.items()]
    moves = document.get("effects_move_um", {})
    arm.skipped = {name: moves.get(name) for name in skipped}
    arm.stays_behind = {
        name: (why, moves.get(name, moves.get(name.partition(".")[0]))) for name, why in behind.items()
    }


def _is_node(text: str, table: dict[str, Any]) -> bool:
    """True where `text` is the product of hats that `table` describes; any other text is compiled as an expression."""
    axes = [axis for axis in table["axes"] if len(axis["nodes"]) > 1]
    if not axes or len(axes) != len(table["axes"]):
        return False
    number, factors = expression.factors(expression.parse(text))
    if number != 1.0 or len(factors) != len(axes):
        return False
    for (factor, exponent), axis, index in zip(factors, axes, table["index"], strict=True):
        nodes = axis["nodes"]
        # Beyond the ends a node's hat falls to zero over the width of the outermost cell, as the firmware's tables do.
        padded = [nodes[0] - (nodes[1] - nodes[0]), *nodes, nodes[-1] + (nodes[-1] - nodes[-2])]
        hat = padded[index : index + 3]
        if factor.op != "hat" or exponent != 1 or factor.args[0].name != axis["variable"]:
            return False
        if [argument.value for argument in factor.args[1:]] != hat:
            return False
    return True


def _grid(name: str, coordinate: str, entries: list[tuple[dict[str, Any], float]]) -> Grid:
    axes = tuple(Axis(axis["variable"], tuple(axis["nodes"])) for axis in entries[0][0]["axes"])
    values = np.zeros([len(axis.nodes) for axis in axes])
    covered = np.zeros(values.shape, dtype=np.bool_)
    for table, coefficient in entries:
        index = tuple(table["index"])
        values[index] += coefficient
        covered[index] = table.get("covered", True)
    values[~covered] = 0.0
    return Grid(name, coordinate, axes, values, covered)
