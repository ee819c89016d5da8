"""The IRB2400 paper's ladder on the simulated arm: `./dev ladder` prints it and writes it into docs/results.md.

Joint level (parallelogram), kinematic level, grid level; every level is fitted to the same 400 measured poses and tried
on 284 others. The paper: multilevel calibration of an IRB2400 with parallelogram, 284 configurations over the common
workspace, max/mean 1.583/0.420 mm nominal and 0.172/0.066 mm after the last level. Beyond the paper: what `refine`
finds in place of the grid, and the grid on top of it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import armtrue_sim
import numpy as np
from armtrue import _core
from armtrue_sim.campaign import joints_of
from armtrue_sim.instrument import Instrument
from armtrue_sim.mechanics.transforms import rot_z
from grids import Grid, fit_grid
from numpy.typing import NDArray

SCENARIO = Path(__file__).resolve().parents[2] / "sim" / "scenarios" / "irb2400-ladder.yaml"
LEVELS = (
    ("nominal, base and tool fitted", ["base_frame", "tool_offset"]),
    ("joint level: parallelogram", ["parallelogram"]),
    ("kinematic level", ["joint_offset", "link_geometry"]),
    ("grid level", ["residual_grid"]),
)
KINEMATIC, GRID = 2, 3
REFINED = "kinematic level, refined"
REFINED_GRID = "kinematic level, refined, and the grid"
PAPER = {0: (1.583, 0.420), GRID: (0.172, 0.066)}  # level: max, mean [mm]

Array = NDArray[np.float64]


@dataclass
class Level:
    """One level: distances (284,) [m] from the predicted tool position to the exact and to the measured one."""

    name: str
    document: dict[str, Any]
    exact: Array
    measured: Array


@dataclass
class Ladder:
    """All levels, and the arm's repeatability (284,) [m]: distances from its mean positions, tracker included."""

    campaign: armtrue_sim.Campaign
    levels: list[Level]
    repeatability: Array


def columns_of(table: dict[str, Any]) -> dict[str, Array]:
    """A simulated table as the fitter takes it."""
    return {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in table.items()}


def positions(table: dict[str, Any]) -> Array:
    """Columns x, y, z as (N, 3)."""
    return np.stack([table[axis] for axis in "xyz"], axis=1)


def climb(scenario: Path | dict[str, Any] = SCENARIO) -> Ladder:
    """Fit level after level and try each on the test poses; then refine the kinematic level."""
    campaign = armtrue_sim.simulate(scenario)
    robot = json.dumps(campaign.robot)
    data, test = columns_of(campaign.data), columns_of(campaign.test)
    exact = positions(campaign.test)
    found = measure_again(campaign)
    levels: list[Level] = []

    def add_level(name: str, core: _core.Fit) -> None:
        document = json.loads(core.document())
        predicted = np.asarray(_core.predict(json.dumps({**document, "robot": campaign.robot}), test))
        distances = [np.linalg.norm(predicted - place, axis=1) for place in (exact, found)]
        levels.append(Level(name, document, *distances))

    fits = []
    effects: list[Any] = []
    for name, added in LEVELS:
        effects = [*effects, *added]
        fits.append(_core.fit(robot, data, json.dumps({"effects": effects})))
        add_level(name, fits[-1])
    refined, _ = _core.refine(fits[KINEMATIC])
    add_level(REFINED, refined)
    effects = [*json.loads(refined.specification())["effects"], "residual_grid"]
    add_level(REFINED_GRID, _core.fit(robot, data, json.dumps({"effects": effects})))
    return Ladder(campaign, levels, np.linalg.norm(found - exact, axis=1))


def measure_again(campaign: armtrue_sim.Campaign) -> Array:
    """Test positions (284, 3) [m] measured once more, with drive repeatability and tracker noise."""
    rng = np.random.default_rng(campaign.truth["seed"] + 1)
    q = joints_of(campaign.test, campaign.arm.chain.n)
    error = campaign.truth["drive_repeatability"] * rng.standard_normal(q.shape)
    place = campaign.arm.true_position(q, campaign.test, motor_error=error)
    instrument = Instrument(
        **{k: tuple(v) if isinstance(v, list) else v for k, v in campaign.truth["instrument"].items()}
    )
    return np.asarray(place + instrument.noise(place, rng))


@dataclass
class Comparison:
    """Joint-space and Cartesian grids of equal node count on the residuals of the kinematic level. Distances [m]."""

    nodes: tuple[int, ...]
    before: Array
    joint: Array
    cartesian: Array
    joint_grid: Grid
    cartesian_grid: Grid


def compare_grids(ladder: Ladder) -> Comparison:
    """Same data, smoothing and node count: fan-shaped cells of joint space against Cartesian boxes."""
    campaign, kinematic = ladder.campaign, ladder.levels[KINEMATIC]
    document = {**kinematic.document, "robot": campaign.robot}
    model = json.dumps(document)
    turn = _rotation(document["measuring_from_base"]["rpy"])
    axes = {"joint": [], "cartesian": []}
    errors = {"joint": [], "cartesian": []}
    for table in (campaign.data, campaign.test):
        predicted = np.asarray(_core.predict(model, columns_of(table)))
        q = joints_of(table, campaign.arm.chain.n)
        left = (positions(table) - predicted) @ turn
        place = (predicted - document["measuring_from_base"]["xyz"]) @ turn
        axes["joint"].append(q[:, :3])
        axes["cartesian"].append(place)
        # The joint grid's corrections turn with axis 1, as the fan-shaped cells do.
        errors["joint"].append(np.einsum("nji,nj->ni", np.stack([rot_z(a) for a in q[:, 0]]), left))
        errors["cartesian"].append(left)
    nodes = grid_nodes(ladder.levels[GRID].document)
    grids = {
        space: min(
            (
                fit_grid(axes[space][0], errors[space][0], counts)
                for counts in ({nodes} if space == "joint" else set(itertools.permutations(nodes)))
            ),
            key=lambda grid: grid.held_out_rms,
        )
        for space in axes
    }
    after = {
        space: np.linalg.norm(errors[space][1] - grids[space].evaluate(axes[space][1]), axis=1)
        for space in axes
    }
    return Comparison(
        nodes,
        np.linalg.norm(errors["joint"][1], axis=1),
        after["joint"],
        after["cartesian"],
        grids["joint"],
        grids["cartesian"],
    )


def grid_nodes(document: dict[str, Any]) -> tuple[int, int, int]:
    """Nodes on each axis of the fitted residual_grid."""
    for parameter in document["parameters"]:
        if parameter["effect"] == "residual_grid":
            first, second, third = (len(axis["nodes"]) for axis in parameter["terms"][0]["table"]["axes"])
            return first, second, third
    raise ValueError("the fit has no residual_grid")


def _rotation(rpy: list[float]) -> Array:
    """Rotation of fixed-axes roll, pitch, yaw [rad]."""
    roll, pitch, yaw = rpy
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    result: Array = rot_z(yaw) @ about_y @ about_x
    return result


def _cells(distances: Array) -> str:
    return f"{distances.max() * 1e3:.3f} | {distances.mean() * 1e3:.3f}"


def text_of(ladder: Ladder) -> str:
    """The section of docs/results.md."""
    lines = [
        "| level | max [mm] | mean [mm] | as measured: max [mm] | mean [mm] | paper: max [mm] | mean [mm] |",
        "|---|---|---|---|---|---|---|",
    ]
    for number, level in enumerate(ladder.levels):
        paper = "{:.3f} | {:.3f}".format(*PAPER[number]) if number in PAPER else "|"
        lines.append(f"| {level.name} | {_cells(level.exact)} | {_cells(level.measured)} | {paper} |")
    lines.append(
        f"| the arm's own repeatability, tracker included | | | {_cells(ladder.repeatability)} | 0.157 | |"
    )
    return "\n".join(lines) + "\n"


def grids_told(comparison: Comparison) -> str:
    """Table for developers that shows why the product's grid is over joint space."""
    lines = [
        f"Joint-space against Cartesian grid, {'×'.join(map(str, comparison.nodes))} nodes, the same 400 poses, what "
        "the kinematic level leaves on the 284 others:",
        "",
        "| grid | nodes that data reach | max [mm] | mean [mm] |",
        "|---|---|---|---|",
        f"| none | | {_cells(comparison.before)} |",
        f"| joint space, fan-shaped cells | {comparison.joint_grid.covered.sum()} | {_cells(comparison.joint)} |",
        f"| Cartesian | {comparison.cartesian_grid.covered.sum()} | {_cells(comparison.cartesian)} |",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the ladder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    ladder = climb()
    print(text_of(ladder))
    print(grids_told(compare_grids(ladder)), file=sys.stderr)


if __name__ == "__main__":
    main()
