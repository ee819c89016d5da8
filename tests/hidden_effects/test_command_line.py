"""The harness itself: it counts hangs, runs commands with and without a terminal, and its tables are right."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from armtrue_sim import simulate
from armtrue_sim.cases import hidden_cases
from by_command import run, run_program
from campaign import HEAD, row
from coefficients import deviations
from harness import Outcome, named, read_refinement, verdict_of, weighed_robot
from noise_parts import BAD, NoiseFound, scenario
from noise_parts import table as noise_table
from reliability import bins, expected_calibration_error, table


def test_hung_command_is_killed_with_its_children_at_the_limit() -> None:
    started = time.perf_counter()
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import time; time.sleep(60)'])"
    for terminal in (False, True):
        ran = run_program([sys.executable, "-c", child], 2.0, terminal)
        assert ran.hung
        assert ran.processor < 2.0
        assert verdict_of(outcome("one_hidden").ended(ran)) == "hang"
    assert time.perf_counter() - started < 30.0


@pytest.mark.parametrize("terminal", [False, True])
def test_run_program_gives_a_terminal_only_if_requested(terminal: bool) -> None:
    ran = run_program(
        [sys.executable, "-c", "import sys; print(sys.stdout.isatty()); sys.exit(3)"], 60.0, terminal
    )
    assert (ran.status, ran.said.strip()) == (3, str(terminal))


def test_run_executes_the_installed_armtrue() -> None:
    ran = run(["refine", "no-such-fit.json", "--out", "x.json"], 60.0)
    assert ran.status == 2
    assert "no-such-fit.json" in ran.said


def test_hang_and_failure_are_verdicts() -> None:
    hung = Outcome("one_hidden", "kr30", 0, {"backlash 2"}, trouble="hang")
    assert verdict_of(hung) == "hang"
    assert (
        verdict_of(Outcome("one_hidden", "kr30", 0, {"backlash 2"}, trouble="status 2: ['no']")) == "failed"
    )


def outcome(kind: str, **more: object) -> Outcome:
    return Outcome(kind, "kr30", 0, **{"hidden": set(), "verdict": "nothing_missing", **more})  # type: ignore[arg-type]


def test_verdict_accepts_only_effects_wrong_in_robot_yaml() -> None:
    real = {"accepted": {"mass_parameters", "gravity_direction"}}
    assert verdict_of(outcome("real_nothing", added={"mass_parameters"}, **real)) == "right"
    assert verdict_of(outcome("real_nothing", added={"bending_compliance 1"}, **real)) == "extra"


def test_foreign_truth_needs_its_cause_or_variable_named() -> None:
    foreign = {"hidden": {"dahl_friction 2"}, "causes": {"hysteresis 2", "backlash 2"}, "variables": {"dir2"}}
    assert verdict_of(outcome("foreign_truth", added={"backlash 2"}, **foreign)) == "right"
    assert verdict_of(outcome("foreign_truth", added={"backlash 3"}, **foreign)) == "extra"
    assert verdict_of(outcome("foreign_truth", **foreign)) == "unnamed"
    boast = outcome(
        "foreign_truth", added={"backlash 2", "warm_up"}, sure={"backlash 2", "warm_up"}, **foreign
    )
    assert boast.surely_false == {"warm_up"}
    for found in ({"variable": "dir2"}, {"variables": ["q1", "dir2"]}):
        assert verdict_of(outcome("foreign_truth", unexplained=[found], **foreign)) == "right"


def test_warm_up_is_right_if_the_hidden_heat_stays_possible() -> None:
    hidden = {"thermal_expansion", "thermal_joint_drift 2"}
    vague = outcome("thermal_pair_noise_x4", hidden=hidden, added={"warm_up"}, open=hidden)
    assert verdict_of(vague) == "right"
    assert verdict_of(outcome("thermal_pair_noise_x4", hidden=hidden, added={"warm_up"})) == "missed"


def test_read_refinement_collects_stated_probabilities() -> None:
    base = {"removed": [], "verdict": "nothing_missing", "unexplained": [], "untestable": [], "added": None}
    candidate = {"effect": "backlash", "joints": [3], "confounded_with": ["warm_up"], "probability": 0.2}
    step = base | {"effects": ["base_frame"], "candidates": [candidate], "probability_nothing": 0.7}
    final = step | {"effects": ["base_frame", {"effect": "backlash", "joints": [2]}]}
    final["added"] = {"effect": "backlash", "joints": [2], "confounded_with": []}
    effects = ["base_frame", {"effect": "backlash", "joints": [2], "probability": 0.97}]
    seen = outcome("one_hidden", hidden={"backlash 2"})
    read_refinement(seen, {"steps": [step, final], "effects": effects})
    assert sorted(seen.said) == [(0.2, False), (0.7, True), (0.97, True)]
    assert seen.added == {"backlash 2"}
    assert seen.open == {"backlash 3", "warm_up"}
    assert seen.sure == {"backlash 2"}
    assert seen.accounted


def test_calibration_error_of_honest_and_overconfident_answers() -> None:
    honest = [(0.9, i < 90) for i in range(100)] + [(0.1, i < 10) for i in range(100)]
    assert expected_calibration_error(honest) == pytest.approx(0.0, abs=1e-12)
    assert bins(honest) == [
        (100, pytest.approx(0.1), pytest.approx(0.1)),
        (100, pytest.approx(0.9), pytest.approx(0.9)),
    ]
    boastful = [(0.98, i < 50) for i in range(100)]
    assert expected_calibration_error(boastful) == pytest.approx(0.48)
    assert "of 100 said with 0.9 or more, 50 are true" in table(boastful)
    assert "no `probability`" in table([])


def test_noise_parts_are_judged_by_joint_and_size() -> None:
    good = NoiseFound("kr30", 0, 2, [4.0, 44.0, 3.0], 8.3)
    assert good.named
    assert good.within
    assert not NoiseFound("kr30", 0, 3, [4.0, 44.0, 3.0], 8.3).named
    assert not NoiseFound("kr30", 0, 2, [4.0, 60.0, 3.0], 8.3).within
    assert "joint named: 1 of 1" in noise_table([good])
    assert "no `noise`" in noise_table([NoiseFound("kr30", 0, 2)])
    given, bad = scenario("kr30", 5)
    assert given["repeatability"]["joints"] == {bad: BAD}


def test_deviations_compare_coefficients_with_truth_in_sigmas() -> None:
    campaign = simulate({"arm": "kr30", "poses": 40, "hidden": [{"effect": "gear_harmonics", "joints": [3]}]})
    true = {t.expression: t.value for t in campaign.arm.terms if t.effect == "gear_harmonics"}

    def parameter(effect: str, expression: str, value: float, weight: float) -> dict[str, object]:
        terms = [{"coordinate": "motor3", "expression": expression, "weight": weight}]
        return {
            "name": f"{effect} {expression}",
            "effect": effect,
            "value": value,
            "sigma": 1e-6,
            "terms": terms,
        }

    parameters = [
        parameter("gear_harmonics", "sin(q3)", 0.5 * true["sin(q3)"] + 3e-6, 2.0),
        parameter("gear_harmonics", "cos(q3*2)", true["cos(2*q3)"], 1.0),
        parameter("gear_harmonics", "sin(5*q3)", 0.0, 1.0),
        parameter("joint_offset", "1", 0.0, 1.0),
    ]
    found = deviations({"parameters": parameters}, campaign)
    assert found == {
        "gear_harmonics sin(q3)": pytest.approx(3.0),
        "gear_harmonics cos(q3*2)": pytest.approx(0.0, abs=1e-9),
    }


def test_table_row_counts_effects_cases_and_hangs() -> None:
    found = outcome(
        "one_hidden", hidden={"backlash 2"}, added={"backlash 2"}, first=[{"backlash 2"}], seconds=1.0
    )
    wrong = outcome("one_hidden", hidden={"backlash 2"}, added={"warm_up"}, sure={"warm_up"}, seconds=3.0)
    hung = outcome("one_hidden", hidden={"backlash 2"}, trouble="hang")
    cells = [cell.strip() for cell in row("one_hidden", [found, wrong, hung]).split("|")[1:-1]]
    heads = [cell.strip() for cell in HEAD.splitlines()[0].split("|")[1:-1]]
    assert len(cells) == len(heads)
    told = dict(zip(heads, cells, strict=True))
    assert told["right"] == "1"
    assert told["found"] == "1 of 3"
    assert told["false: all, surely"] == "1, 1"
    assert (told["missed"], told["hang"], told["failed"]) == ("2", "1", "0")
    assert told["s/case: median, worst"] == "2.00, 3.00"


def test_joint_order_is_ignored_only_for_symmetric_pairs() -> None:
    assert named("cross_compliance", [3, 2]) == named("cross_compliance", [2, 3]) == ["cross_compliance 2,3"]
    assert named("coupling_harmonics", [5, 4]) != named("coupling_harmonics", [4, 5])


def test_weighed_robot_has_true_masses_payload_and_gravity() -> None:
    real, plain = (hidden_cases(kind, "kr30", 1) for kind in ("real_nothing", "nothing_hidden"))
    weighed = weighed_robot(real)
    stated = [link["mass"] for link in real.campaign.robot["links"]]
    assert [link["mass"] / mass for link, mass in zip(weighed["links"], stated, strict=True)] == [
        pytest.approx(1.2) if link["mass"] > mass else pytest.approx(0.8)
        for link, mass in zip(weighed["links"], stated, strict=True)
    ]
    off = np.subtract(weighed["payload"]["com"], real.campaign.robot["tool"]["xyz"])
    assert np.linalg.norm(off) == pytest.approx(0.015)
    assert weighed["gravity"] != real.campaign.robot["gravity"]
    assert weighed_robot(plain) == plain.campaign.robot


def test_diagnose_prints_the_worst_joint_and_reading_noise(tmp_path: Path) -> None:
    given, bad = scenario("kr30", 4)
    simulate(given, tmp_path)
    fitted = str(tmp_path / "fit.json")
    files = [str(tmp_path / name) for name in ("data.csv", "robot.yaml", "model.yaml")]
    command = ["fit", files[0], "--robot", files[1], "--model", files[2], "--out", fitted]
    assert run(command, 60.0).status == 0
    said = run(["diagnose", fitted], 60.0).said
    told = re.search(
        r"joint (\d) repeats to ([\d.]+) µrad; readings scatter by ([\d.]+) µm", " ".join(said.split())
    )
    assert told, said
    assert int(told[1]) == bad
    assert float(told[2]) == pytest.approx(1e6 * BAD, abs=8.0)
    assert float(told[3]) == pytest.approx(8.0, abs=1.0)
