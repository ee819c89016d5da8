"""Trials of plans on simulated arms: measure the planned poses and as many random ones, and compare the results.

`./dev plan` prints the table and writes it into docs/results.md.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import armtrue_sim
import numpy as np
from armtrue import Fit, Model, fit, load_data, load_robot
from armtrue.diagnosis import Diagnosis, diagnose
from armtrue.planning import SETTLED, Ambiguity, Plan, ambiguity, plan_campaign
from armtrue.planning import plan as plan_poses
from armtrue_sim.campaign import joints_of
from numpy.typing import NDArray

Array = NDArray[np.float64]
GEOMETRY = ["base_frame", "tool_offset", "joint_offset", "link_geometry"]
TRACKER_SIGMA = 8e-6  # m, as the scenarios' instrument


@dataclass
class Case:
    """A short campaign over a part of the joint ranges, whose data cannot tell which effect is missing."""

    hidden: str
    joint: int
    share: float  # of the joint ranges, about their middle
    scale: float = 1.0
    poses: int = 40
    seeds: tuple[int, ...] = (1, 2, 3)  # some of these campaigns leave an ambiguity


CASES = (
    Case("gear_harmonics", 2, 0.4, seeds=(4, 10, 11)),
    Case("joint_compliance", 2, 0.3, scale=0.3, poses=30),
    Case("bending_compliance", 1, 0.4, scale=0.6, poses=30),
)


@dataclass
class Outcome:
    """Result on one ambiguity, as ΔBIC of the true cause less its best rival, refitted to all measurements."""

    case: Case
    seed: int
    rivals: list[str]
    before: float
    planned: float
    random: float
    expected: float


def campaign_of(case: Case, seed: int, folder: Path) -> tuple[armtrue_sim.Campaign, Fit]:
    """The short campaign and the fit of its geometry."""
    scenario: dict[str, Any] = {
        "arm": "kr30",
        "seed": seed,
        "poses": case.poses,
        "repeats": {},
        "payloads": [0.0],
        "test_poses": 0,
        "believed": GEOMETRY,
        "hidden": [{"effect": case.hidden, "joints": [case.joint], "scale": case.scale}],
    }
    limits = np.array(armtrue_sim.simulate(scenario).arm.chain.limits)
    middle, half = limits.mean(axis=1), 0.5 * case.share * np.diff(limits, axis=1)[:, 0]
    scenario["joint_range"] = np.stack([middle - half, middle + half], axis=1).tolist()
    campaign = armtrue_sim.simulate(scenario, folder)
    robot = load_robot(folder / "robot.yaml")
    return campaign, fit(load_data(folder / "data.csv", robot), robot, _model(GEOMETRY))


def _model(effects: list[Any]) -> Model:
    return Model([{"effect": e} if isinstance(e, str) else e for e in effects])


def measured(campaign: armtrue_sim.Campaign, poses: dict[str, Array], seed: int) -> dict[str, Array]:
    """Measured rows at `poses`, with drive and tracker noise; other columns as in the campaign's last row."""
    rng = np.random.default_rng(seed)
    count = len(poses["q1"])
    rows = {name: np.repeat(values[-1:], count) for name, values in campaign.data.items()}
    rows |= {name: poses[name] for name in poses if name in rows}
    rows["repeat"] = 10000 + np.arange(count)
    q = joints_of(rows, campaign.arm.chain.n)
    error = campaign.truth["drive_repeatability"] * rng.standard_normal(q.shape)
    place = campaign.arm.true_position(q, rows, motor_error=error)
    place += TRACKER_SIGMA * rng.standard_normal((count, 3))
    return rows | {axis: place[:, i] for i, axis in enumerate("xyz")}


def fit_rows(columns: dict[str, Array], effects: list[Any], folder: Path) -> Fit:
    """Fit `columns`, written to a CSV file and read back."""
    path = folder / "measured.csv"
    rows = zip(*columns.values(), strict=True)
    path.write_text(
        "\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n"
    )
    robot = load_robot(folder / "robot.yaml")
    return fit(load_data(path, robot), robot, _model(effects))


def measure_more(campaign: armtrue_sim.Campaign, poses: dict[str, Array], seed: int, folder: Path) -> Fit:
    """Fit the geometry to the campaign's rows and to `poses`, measured in addition."""
    more = measured(campaign, poses, seed)
    columns = {name: np.concatenate([campaign.data[name], more[name]]) for name in campaign.data}
    return fit_rows(columns, GEOMETRY, folder)


def random_columns(campaign: armtrue_sim.Campaign, count: int, seed: int) -> dict[str, Array]:
    """Random poses as a plan would give them."""
    q = armtrue_sim.random_poses(
        campaign.arm.robot, campaign.arm.chain, count, np.random.default_rng([seed, 9])
    )
    return {f"q{k + 1}": q[:, k] for k in range(q.shape[1])}


def evidence(fitted: Fit, case: Case, rivals: list[dict[str, Any]]) -> float:
    """ΔBIC of the true cause less that of its best rival, each added to `fitted`."""
    named = {(rival["effect"], tuple(rival.get("joints", []))) for rival in rivals}
    figures: dict[tuple[str, tuple[int, ...]], float] = {}
    for candidate in diagnose(fitted)["candidates"]:
        key = candidate["effect"], tuple(candidate["joints"])
        if key in named:  # the form (beam shape, thermometer) that explains most
            figures[key] = min(candidate["delta_bic"], figures.get(key, 0.0))
    true = figures.pop((case.hidden, (case.joint,)), 0.0)
    return float(true - min(figures.values(), default=0.0))


def try_case(case: Case, seed: int, count: int, folder: Path) -> Outcome | None:
    """Plan, measure, refit. None if no ambiguity is open that poses can settle, or if it lacks the true cause."""
    campaign, fitted = campaign_of(case, seed, folder)
    # The owner knows that this arm has no balancer, which with a free phase equals a first harmonic of gear 2.
    found = ambiguity(fitted, diagnose(fitted))
    rivals = [rival for rival in (found.open if found else []) if rival["effect"] != "gravity_balancer"]
    names = [f"{rival['effect']} {rival.get('joints', '')}" for rival in rivals]
    if f"{case.hidden} {[case.joint]}" not in names or len(rivals) < 2:
        return None
    # The plan states which pairs no pose can separate: only the others can be settled.
    plan = plan_poses(fitted, count, rivals=rivals, seed=seed)
    truth = f"{case.hidden} {case.joint}"
    told = {
        entry["rival"]: entry["delta_bic_expected"]
        for entry in plan.figures["separations"]
        if entry["truth"] == truth and entry["delta_bic_expected"] < -SETTLED
    }
    if not told:
        return None
    told_apart = [
        rival
        for rival, label in zip(rivals, plan.figures["candidates"], strict=True)
        if label in told or label == truth
    ]
    before = evidence(fitted, case, told_apart)
    if settled(before):
        return None  # the ambiguity is with another candidate, not between these
    return Outcome(
        case,
        seed,
        names,
        before,
        evidence(measure_more(campaign, plan.columns, seed, folder), case, told_apart),
        evidence(
            measure_more(campaign, random_columns(campaign, count, seed), seed, folder), case, told_apart
        ),
        max(told.values()),
    )


HEAT = ("thermal_expansion", "warm_up")
# Growth without joint drift, which a thermometer that rises with it explains as well.
_GROWTH = {"warm_up": {"growth": 2.5e-4, "tau": 2000.0} | {f"motor{k}": 0.0 for k in range(1, 7)}}


@dataclass
class HeatOutcome:
    """Temperature or time: the ambiguity of a session in which both rose together, the plan, and its result.

    first: the session's diagnosis; recommended: the effect recommended after the planned rows; after: what is then
    still open.
    """

    first: Diagnosis
    before: Ambiguity
    plan: Plan
    recommended: str
    after: Ambiguity


def try_heat(cause: str, seed: int, count: int, folder: Path) -> HeatOutcome:
    """Plan, measure and diagnose again on an arm that grows by temperature or by time."""
    return _try_hot({"effect": cause} | _GROWTH.get(cause, {}), seed, count, folder)


def _try_hot(hidden: dict[str, Any], seed: int, count: int, folder: Path) -> HeatOutcome:
    scenario = {
        "arm": "kr30",
        "seed": seed,
        "poses": 60,
        "repeats": {},
        "test_poses": 0,
        "believed": GEOMETRY,
        "hidden": [hidden],
        "payloads": [0.0],
        "temperature": {"jitter": 0.0},
    }
    campaign = armtrue_sim.simulate(scenario, folder)
    robot = load_robot(folder / "robot.yaml")
    fitted = fit(load_data(folder / "data.csv", robot), robot, _model(GEOMETRY))
    first = diagnose(fitted)
    before = ambiguity(fitted, first)
    assert before is not None
    plan = plan_poses(fitted, count, rivals=before.open, seed=seed)
    told = measure_more(campaign, plan.columns, seed, folder)
    diagnosis = diagnose(told)
    after = ambiguity(told, diagnosis)
    assert after is not None
    recommended = [entry for entry in diagnosis["candidates"] if entry["recommend"]]
    assert len(recommended) == 1
    return HeatOutcome(first, before, plan, recommended[0]["effect"], after)


def try_sensors(cause: str, seed: int, count: int, folder: Path) -> HeatOutcome:
    """Plan, measure and diagnose again on an arm whose links grow by one of two thermometers, `cause`."""
    return _try_hot({"effect": "thermal_expansion", "sensor": cause}, seed, count, folder)


@dataclass
class CampaignOutcome:
    """Errors [m] of fits on fresh exact poses: of a planned first campaign, and of one of random poses."""

    poses: int
    seed: int
    planned: float
    random: float
    random_poses_per_planned: float


def try_campaign(count: int, seed: int, folder: Path) -> CampaignOutcome:
    """A first campaign of `count` poses, planned and random, on an arm with geometry and joint compliance."""
    effects = [*GEOMETRY, {"effect": "joint_compliance", "joints": [2, 3]}]
    scenario = {"arm": "kr30", "seed": seed, "believed": effects, "payloads": [0.0], "test_poses": 200}
    campaign = armtrue_sim.simulate(scenario, folder)
    robot = load_robot(folder / "robot.yaml")
    plan = plan_campaign(robot, _model(effects), count, seed=seed)
    test = load_data(folder / "test.csv", robot)
    exact = np.stack([campaign.test[axis] for axis in "xyz"], axis=1)

    def error_of(poses: dict[str, Array]) -> float:
        fitted = fit_rows(measured(campaign, poses, seed), effects, folder)
        return float(np.linalg.norm(fitted.predict(test) - exact, axis=1).mean())

    return CampaignOutcome(
        count,
        seed,
        error_of(plan.columns),
        error_of(random_columns(campaign, count, seed)),
        plan.figures["random_poses_per_planned"],
    )


def text_of(
    separations: list[Outcome],
    heat: dict[str, list[HeatOutcome]],
    campaigns: list[CampaignOutcome],
    count: int,
) -> str:
    """The section of docs/results.md."""
    lines = [
        f"Ambiguities settled by {count} further poses; ΔBIC of the true cause less its best rival:",
        "",
        "| cause | cases | settled: planned | random | wrong: planned | random "
        "| median ΔBIC before | expected | planned | random |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        group = [o for o in separations if o.case == case]
        if not group:
            continue
        shares = [str(sum(settled(getattr(o, which)) for o in group)) for which in ("planned", "random")] + [
            str(sum(getattr(o, which) > 0.0 for o in group)) for which in ("planned", "random")
        ]
        medians = [
            f"{np.median([getattr(o, which) for o in group]):.0f}"
            for which in ("before", "expected", "planned", "random")
        ]
        lines.append(f"| {case.hidden} {case.joint} | {len(group)} | {' | '.join([*shares, *medians])} |")
    lines += [
        "",
        f"Growth by temperature or by time, which rose together in 60 poses, and {count} poses that go against that:",
        "",
        "| cause | cases | recommended before | recommended after | open after |",
        "|---|---|---|---|---|",
    ]
    for cause, tried in heat.items():
        right = [
            sum(o.before.entry["effect"] == cause for o in tried),
            sum(o.recommended == cause for o in tried),
        ]
        still_open = sum(bool(o.after.open) for o in tried)
        lines.append(f"| {cause} | {len(tried)} | {right[0]} | {right[1]} | {still_open} |")
    lines += [
        "",
        "First campaigns, mean error on 200 fresh exact poses (median over seeds):",
        "",
        "| poses | planned [µm] | random [µm] | one planned pose in random ones |",
        "|---|---|---|---|",
    ]
    for poses in sorted({o.poses for o in campaigns}):
        group = [o for o in campaigns if o.poses == poses]
        planned, random = (
            1e6 * np.median([getattr(o, which) for o in group]) for which in ("planned", "random")
        )
        worth = np.median([o.random_poses_per_planned for o in group])
        lines.append(f"| {poses} | {planned:.1f} | {random:.1f} | {worth:.2f} |")
    return "\n".join(lines) + "\n"


def settled(delta_bic: float) -> bool:
    """True where the evidence for the true cause is decisive."""
    return delta_bic < -SETTLED


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--poses", type=int, default=8, help="further poses of a separation")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        tried = [
            try_case(case, seed, given.poses, Path(made)) for case in CASES for seed in range(given.seeds)
        ]
        campaigns = [
            try_campaign(count, seed, Path(made))
            for count in (20, 30, 50)
            for seed in range(given.seeds // 2)
        ]
        heat = {
            cause: [try_heat(cause, seed, given.poses, Path(made)) for seed in range(given.seeds)]
            for cause in HEAT
        }
    section = text_of([outcome for outcome in tried if outcome], heat, campaigns, given.poses)
    print(section)


if __name__ == "__main__":
    main()
