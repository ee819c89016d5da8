"""Text that `armtrue diagnose` and `armtrue refine` print."""

from __future__ import annotations

import copy
import shlex
from pathlib import Path
from typing import Any

import pytest

from armtrue.candidates import name, parameter_lines
from armtrue.cli.shared.findings import present_added, present_diagnosis
from armtrue.cli.shared.output import Output


def parameter(name: str, value: float, sigma: float, unit: str) -> dict[str, Any]:
    return {"name": name, "value": value, "sigma": sigma, "unit": unit}


def candidate(effect: str, joints: list[int], **other: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "effect": effect,
        "joints": joints,
        "options": {},
        "parameters": [],
        "recommend": False,
        "explained": 0.03,
        "log10_p": 0.0,
        "delta_bic": -3.0,
        "separability": 0.5,
        "probability": 0.01,
        "held_out_mean_um_if_added": 65.4,
        "confounded_with": [],
        "why": "not significant among all that was tried",
    }
    return {**plain, **other}


RESULT: dict[str, Any] = {
    "verdict": "missing_effect",
    "probability_nothing": 0.0,
    "error": {"held_out": {"mean_um": 69.9, "rms_um": 78.7, "p95_um": 131.3, "max_um": 229.2}},
    "noise_floor_um": 14.57,
    "noise_floor_source": "repeats",
    "candidates": [
        candidate(
            "gear_harmonics",
            [3],
            recommend=True,
            probability=0.97,
            explained=0.966,
            log10_p=-219.7,
            delta_bic=-2416.0,
            separability=0.0987,
            held_out_mean_um_if_added=13.5,
            confounded_with=["transmission_pwl 3", "gear_mesh 3 orders [13.0]", "warm_up"],
            why="explains 96.6 % of the squared residual, held-out mean 69.9 um -> 13.5 um",
            parameters=[
                parameter("gear_harmonics[3].sin1", -1.830899e-4, 3.94e-6, "rad"),
                parameter("gear_harmonics[3].cos1", -2.042219e-4, 9.77e-6, "rad"),
            ],
        ),
        candidate(
            "joint_coupling",
            [2, 1],
            probability=0.02,
            explained=0.708,
            log10_p=-61.0,
            held_out_mean_um_if_added=45.0,
            why="stands in for structure that no effect of the catalogue names",
        ),
        candidate("gear_mesh", [2], options={"orders": [13.0]}),
        candidate("gear_mesh", [2], options={"cycles": [459.0]}),
        candidate("backlash", [2]),
    ],
    "unexplained": [],
    "untestable": [
        {"effect": "command_readback", "needs": ["qr1", "qr2", "qr3", "qr4"]},
        {"effect": "nest", "needs": ["nest"]},
        {"effect": "parallelogram", "needs": ["linkage in robot.yaml"]},
    ],
    "advice": ["add it: armtrue add FIT gear_harmonics --joints 3 --out FIT2"],
}


def printed(result: dict[str, Any], capsys: pytest.CaptureFixture[str], width: int = 100) -> list[str]:
    output = Output(None)
    output.console.width = width
    present_diagnosis(result, output, Path("fit.json"))
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert max(map(len, lines)) <= width
    return lines


def test_each_coefficient_keeps_its_name_sign_sigma_and_unit():
    lines = parameter_lines(
        [
            parameter("gear_harmonics[3].sin1", -1.830899e-4, 3.94e-6, "rad"),
            parameter("thermal_expansion.alpha", 1.873e-5, 6.522e-7, "1/K"),
            parameter("joint_coupling[2,3]", -2.05682e-4, 5.65e-6, "rad/rad"),
            parameter("stiffness_nonlinear[2].square", 3.1e-10, 2e-11, "rad/Nm^2"),
        ]
    )
    assert lines == [
        "gear_harmonics[3].sin1 = -37.77 ± 0.81 ″",
        "thermal_expansion.alpha = 18.73 ± 0.65 µm/(m K)",
        "joint_coupling[2,3] = -205.7 ± 5.7 ppm",
        "stiffness_nonlinear[2].square = 0.310 ± 0.020 nrad/Nm²",
    ]


def test_parameter_lines_put_all_nodes_of_a_table_in_one_line():
    nodes = [
        parameter(f"transmission_pwl[{joint}].node{k}", joint * k * 1e-5, 1e-6, "rad")
        for joint in (2, 3)
        for k in range(1, 5)
    ]
    lines = parameter_lines([*nodes[:2], parameter("backlash[2].dir", 1e-4, 1e-6, "rad"), *nodes[2:]])
    spread = "typically ± 0.2063 ″; a fit chooses its own nodes"
    assert lines == [
        "backlash[2].dir = 20.63 ± 0.21 ″",
        f"transmission_pwl[2]: 4 nodes from 4.125 ″ to 16.50 ″, {spread}",
        f"transmission_pwl[3]: 4 nodes from 6.188 ″ to 24.75 ″, {spread}",
    ]
    # A table over a joint that does not move has a single node.
    (alone,) = parameter_lines(nodes[:1])
    assert alone.startswith("transmission_pwl[2]: 1 node")


def test_diagnosis_shows_separability_reasons_and_predicted_error(capsys):
    lines = printed(RESULT, capsys)
    rows = {line[4:].split("  ")[0]: line.split() for line in lines if line[:2].strip().isdigit()}
    assert rows["gear_harmonics 3"][3:5] == ["97", "%"]
    assert rows["gear_harmonics 3"][-5:] == ["9.9", "%", "≈", "13.5", "★"]
    assert rows["joint_coupling 2,1"][-4:] == ["50.0", "%", "≈", "45.0"]
    assert rows["backlash 2"][-4:] == ["50.0", "%", "≈", "65.4"]
    assert "gear_mesh 2 (order 13)" in rows
    assert "gear_mesh 2 (459 cycles a turn)" in rows
    reasons = lines[lines.index("Not recommended") + 1 :]
    assert reasons[0] == "  · 2: stands in for structure that no effect of the catalogue names"
    assert reasons[1] == "  · 3–5: not significant among all that was tried"
    assert any("cannot imitate; ≈: predicted" in line for line in lines)
    assert (
        "  · at least 90 % of it is also explained by: transmission_pwl 3; gear_mesh 3 (order 13); warm_up"
        in lines
    )
    assert "  · gear_harmonics[3].cos1 = -42.1 ± 2.0 ″" in lines
    assert "  · command_readback needs the columns qr1 to qr4" in lines
    assert "  · nest needs the column nest" in lines
    assert "  · parallelogram needs linkage in robot.yaml" in lines
    assert "error on held-out poses: mean 69.9 µm, RMS 78.7 µm, 95 % 131.3 µm, max 229.2 µm" in lines


def test_open_question_leads_to_a_plan_that_can_be_pasted(capsys):
    result = {
        **RESULT,
        "advice": ["A or B: the data do not decide; armtrue plan chooses poses that separate them"],
    }
    present_diagnosis(result, Output(None), Path("my arm/first try.json"), Path("my arm/data.csv"))
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  armtrue plan ")]
    words = shlex.split(line)
    assert words[2] == "my arm/first try.json"
    assert words[-4:] == ["--out", "my arm/poses.csv", "--data", "my arm/data.csv"]


def test_candidates_above_50_percent_are_listed_as_missing(capsys):
    result = copy.deepcopy(RESULT)
    result["candidates"][1]["probability"] = 0.93
    result["candidates"][3]["probability"] = 0.51
    lines = printed(result, capsys)
    beside = lines[lines.index("Probably also missing") + 1]
    assert (
        beside == "  · 2, 4: probability above 50 %; armtrue refine adds those that lower the held-out error"
    )
    reasons = lines[lines.index("Not recommended") + 1 :]
    assert reasons[0] == "  · 3, 5: not significant among all that was tried"


def test_nothing_missing_prints_nearest_candidate_and_its_reason(capsys):
    result = copy.deepcopy(RESULT)
    result.update(
        verdict="nothing_missing",
        probability_nothing=0.93,
        candidates=RESULT["candidates"][4:],
        noise_floor_um=None,
    )
    lines = printed(result, capsys)
    assert "noise floor not known" in lines
    assert "probability that nothing is missing: 93 %" in lines
    assert (
        "nearest candidate: backlash 2, probability 1 %, explains 3.0 % of the squared residual: "
        "not significant among all that was tried" in " ".join(lines)
    )
    assert not any("separable" in line for line in lines)


def test_structure_precedes_candidates_and_lists_a_variable_once(capsys):
    result = copy.deepcopy(RESULT)
    shape = {"log10_p": -30.0, "shape": "a joint function of q1 and q3", "joints": [1, 3]}
    result.update(
        verdict="unexplained_structure",
        unexplained=[
            {"variable": "q1*q3", "coordinate": "motor2", **shape},
            {"variable": "q1*q3", "coordinate": "motor3", **shape},
            {"variable": "none recorded", **shape, "joints": []},
        ],
    )
    lines = printed(result, capsys)
    at = lines.index("Left over")
    assert lines[at + 1].startswith("  · depends on q1*q3 (joints 1, 3): a joint function")
    assert lines[at + 2].startswith("  · depends on no recorded variable: ")
    assert at < next(k for k, line in enumerate(lines) if "separable" in line)


def test_joints_are_spelled_as_the_option_takes_them():
    assert name({"effect": "thermal_expansion", "joints": [1, 2, 3, 4]}) == "thermal_expansion 1,2,3,4"
    assert name({"effect": "joint_coupling", "joints": [3, 2]}) == "joint_coupling 3,2"


def test_candidates_that_differ_only_in_sensor_name_the_sensor(capsys):
    result = copy.deepcopy(RESULT)
    hot = [
        candidate("thermal_base", [], options={"sensor": "arm"}, explained=0.90, recommend=True),
        candidate("thermal_base", [], options={"sensor": "stand"}, explained=0.89),
        candidate("thermal_base", [], options={"sensor": "cellar"}, explained=0.5),
    ]
    result["candidates"] = hot
    lines = printed(result, capsys)
    assert any(line.startswith(" 2  thermal_base (sensor stand)") for line in lines)
    assert "Recommended: thermal_base (sensor arm)" in lines
    assert any(
        line.endswith("at least 90 % of it is also explained by: thermal_base (sensor stand)")
        for line in lines
    )
    result["candidates"] = hot[:1]
    assert "Recommended: thermal_base (sensor arm)" in printed(result, capsys), (
        "one name, whatever else is listed"
    )


def _refined(effect, *, beside, joints=()):
    added = {"effect": effect, "joints": list(joints), "options": {}, "confounded_with": list(beside)}
    entry = {"effect": effect, "joints": list(joints), "probability": 0.8}
    return {"steps": [{"added": None}, {"added": added}], "effects": [{"effect": "joint_offset"}, entry]}


def test_refine_warns_if_instrument_effect_may_be_of_the_arm(capsys):
    present_added(_refined("tracker_scale", beside=["joint_scale 1", "tracker_angles"]), Output(None))
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "tracker_scale can hardly be distinguished from joint_scale 1 by these poses" in said
    assert "tracker_angles" not in said, "tables leave that out too"


@pytest.mark.parametrize(
    ("effect", "joints", "beside"),
    [
        ("joint_scale", [1], ["tracker_scale"]),
        ("tracker_scale", [], []),
        ("tracker_scale", [], ["joint_offset"]),
    ],
)
def test_refine_does_not_warn_if_no_arm_effect_is_in_doubt(capsys, effect, joints, beside):
    present_added(_refined(effect, beside=beside, joints=joints), Output(None))
    assert "hardly be distinguished" not in capsys.readouterr().out
