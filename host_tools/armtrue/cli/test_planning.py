"""`armtrue plan` end to end on a simulated arm: its file, its text and its refusals."""

from __future__ import annotations

import csv
import json
import shlex
from itertools import pairwise, permutations, product
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest
import yaml

from armtrue.candidates import argument_of, entry_of
from armtrue.cli.conftest import FIT, SCENARIO, armtrue
from armtrue.cli.planning import _present_ambiguity, outlook, preference
from armtrue.cli.shared.output import Output
from armtrue.planning import Ambiguity, Plan, Rival


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open(encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


@pytest.mark.full
def test_first_campaign_is_compared_with_random_poses(folder):
    run = armtrue(
        *("plan", "--robot", "robot.yaml", "--model", "model.yaml", "--poses", "40", "--out", "poses.csv"),
        *("--levels", "payload=0,8,16", "--json", "plan.json"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    rows = rows_of(folder / "poses.csv")
    assert len(rows) == 40
    assert len({tuple(row.values()) for row in rows}) == 40
    assert {row["payload"] for row in rows} <= {0.0, 8.0, 16.0}
    changes = sum(a["payload"] != b["payload"] for a, b in pairwise(rows))
    assert changes <= 2
    for words in ("40 random poses", "these poses", "Fisher information", "Weakest direction"):
        assert words in run.stdout
    figures = json.loads((folder / "plan.json").read_text())
    planned, random = (figures["information"][key] for key in ("planned", "random"))
    assert planned["log_determinant"] > random["log_determinant"]
    as_good = 40 * figures["random_poses_per_planned"]
    assert as_good > 44
    assert f"40 planned poses give the precision of {as_good:.0f} random ones." in run.stdout
    assert planned["eigenvalues_per_m2"] == sorted(planned["eigenvalues_per_m2"])
    assert len(planned["eigenvalues_per_m2"]) == figures["unknowns"]


def test_same_seed_gives_same_poses_and_another_seed_does_not(folder):
    def poses(seed: str) -> str:
        run = armtrue(
            *("plan", "--robot", "robot.yaml", "--model", "model.yaml", "--poses", "10", "--out", "seed.csv"),
            *("--seed", seed, "--choose-from", "500"),
            cwd=folder,
        )
        assert run.returncode == 0, run.stderr
        return (folder / "seed.csv").read_text()

    assert poses("1") == poses("1")
    assert poses("1") != poses("2")


def test_poses_stay_inside_the_box_and_the_joint_limits(folder):
    run = armtrue(
        *("plan", "--robot", "robot.yaml", "--model", "model.yaml", "--poses", "12", "--out", "boxed.csv"),
        *("--box", "0.5", "2.0", "-1.0", "1.0", "0.3", "1.5", "--choose-from", "400"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    campaign = armtrue_sim.simulate(SCENARIO)
    chain = campaign.arm.chain
    q = np.array([[row[f"q{k}"] for k in range(1, 7)] for row in rows_of(folder / "boxed.csv")])
    limits = np.array(chain.limits)
    assert np.all((q > limits[:, 0]) & (q < limits[:, 1]))
    frames = chain.frames(chain.link_variables(q))
    tool = np.array(campaign.robot["tool"]["xyz"])
    place = frames.flange_origin + np.einsum("nij,j->ni", frames.flange_rotation, tool)
    assert np.all((place > [0.5, -1.0, 0.3]) & (place < [2.0, 1.0, 1.5]))


def test_poses_separate_named_candidates_better_than_random_ones(folder):
    run = armtrue(
        *("plan", "fit.json", "--candidates", "gear_harmonics:3", "joint_coupling:3,2"),
        *("--poses", "8", "--out", "apart.csv", "--json", "apart.json", "--choose-from", "1000"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    assert "ΔBIC of the cause minus its rival" in run.stdout
    figures = json.loads((folder / "apart.json").read_text())
    assert figures["candidates"] == ["gear_harmonics 3", "joint_coupling 3,2"]
    for entry in figures["separations"]:
        assert entry["delta_bic_expected"] < entry["delta_bic_expected_random"]
    now = [entry["delta_bic_now"] for entry in figures["separations"]]
    assert now[0] == pytest.approx(-now[1])
    assert len(rows_of(folder / "apart.csv")) == 8


@pytest.mark.parametrize("instrument", ["tracker_scale", "tracker_angles"])
def test_instrument_effect_as_candidate_needs_no_position_column(folder, instrument):
    # The effect reads the reflector's position, which planned poses lack: plan failed with "column x is missing".
    run = armtrue(
        *(
            "plan",
            "fit.json",
            "--candidates",
            instrument,
            "joint_scale:2",
            "--poses",
            "6",
            "--out",
            "instrument.csv",
        ),
        *("--choose-from", "500"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    assert len(rows_of(folder / "instrument.csv")) == 6


@pytest.mark.full
def test_plan_prints_the_ambiguity_set_of_the_diagnosis(folder):
    diagnosed = armtrue("diagnose", "fit.json", "--json", "diagnosis.json", cwd=folder)
    assert diagnosed.returncode == 0, diagnosed.stderr
    lead = json.loads((folder / "diagnosis.json").read_text())["candidates"][0]
    assert lead["confounded_with"], "nothing to compare"
    run = armtrue("plan", "fit.json", "--poses", "5", "--out", "open.csv", "--json", "open.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    figures = json.loads((folder / "open.json").read_text())
    assert figures["ambiguity"]["candidate"] == "gear_harmonics 3"
    assert {r["candidate"] for r in figures["ambiguity"]["rivals"]} == set(lead["confounded_with"])
    for rival in figures["ambiguity"]["rivals"]:
        assert rival["candidate"] in run.stdout
        assert f"(ΔBIC {rival['delta_bic']:+.0f})" in run.stdout
    # A table fits the harmonics too, but with more parameters: plan must print that the data decide this.
    assert "favour the first decisively" in run.stdout
    assert "separations" not in figures
    (line,) = [line for line in run.stdout.splitlines() if line.startswith("  armtrue plan ")]
    asked = armtrue(*shlex.split(line)[1:], "--json", "named.json", cwd=folder)
    assert asked.returncode == 0, asked.stderr
    figures = json.loads((folder / "named.json").read_text())
    assert figures["candidates"] == ["gear_harmonics 3", "transmission_pwl 3"]


def test_three_candidates_are_separated_pair_by_pair(folder):
    run = armtrue(
        *("plan", "fit.json", "--candidates", "gear_harmonics:3", "joint_scale:3", "--also"),
        *("gear_mesh:3:cycles=13,26", "--poses", "5", "--out", "three.csv", "--json", "three.json"),
        *("--choose-from", "500"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    figures = json.loads((folder / "three.json").read_text())
    named = ["gear_harmonics:3", "joint_scale:3", "gear_mesh:3:cycles=13,26"]
    assert list(map(entry_of, figures["candidates"])) == list(map(entry_of, named))
    assert len(figures["separations"]) == 6


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("warm")
    armtrue_sim.simulate(
        {"arm": "cobot", "seed": 4, "poses": 80, "repeats": {}, "hidden": ["thermal_expansion"]}, made
    )
    fitted = armtrue(*FIT, "--out", "fit.json", cwd=made)
    assert fitted.returncode == 0, fitted.stderr
    return made


@pytest.mark.full
@pytest.mark.parametrize("seed", ["0", "1", "2"])
@pytest.mark.parametrize(
    "levels",
    [
        (),
        ("--levels", "temp_arm=18,24,30,36", "--levels", "time=0,900,9000"),
    ],
)
def test_poses_for_thermal_effects_are_in_a_feasible_order(warm, levels, seed):
    run = armtrue(
        *("plan", "fit.json", "--candidates", "thermal_expansion:1,2,3,4,5,6", "warm_up", "--poses", "15"),
        *("--out", "heat.csv", "--seed", seed, *levels),
        cwd=warm,
    )
    assert run.returncode == 0, run.stderr
    rows = rows_of(warm / "heat.csv")
    assert len(rows) == 15

    def changes(column: str) -> int:
        return sum(a[column] != b[column] for a, b in pairwise(rows))

    assert all(a["time"] <= b["time"] for a, b in pairwise(rows))
    assert len({row["temp_arm"] for row in rows}) > 1
    assert changes("temp_arm") == len({row["temp_arm"] for row in rows}) - 1
    # A change of temperature takes time: each time has one temperature.
    assert len({(row["temp_arm"], row["time"]) for row in rows}) == len({row["time"] for row in rows})
    stretches: dict[tuple[float, float], set[float]] = {}
    for row in rows:
        stretches.setdefault((row["temp_arm"], row["time"]), set()).add(row["payload"])
    orders = product(*(permutations(payloads) for payloads in stretches.values()))
    least = min(sum(a != b for a, b in pairwise(sum(order, ()))) for order in orders)
    assert changes("payload") == least


PREFERENCES = {
    "even": (1.0, 1.0, False, "do not decide (ΔBIC +1)"),
    "leaning": (6.0, 6.0, False, "favour the first slightly (ΔBIC +6)"),
    "leaning back": (-6.0, -6.0, False, "favour the second slightly (ΔBIC -6)"),
    "decided": (49.0, 40.0, False, "favour the first decisively (ΔBIC +49)"),
    "for its size": (49.0, -3.0, False, "only because it has fewer parameters"),
    "table": (196.0, -3.0, True, "a table"),
    "close table": (1.0, -90.0, True, "do not decide (ΔBIC +1); the second is a table"),
    "the other": (-49.0, -40.0, False, "favour the second decisively (ΔBIC -49)"),
    "not fitted": (None, None, False, "cannot be fitted"),
}


@pytest.mark.parametrize("case", PREFERENCES, ids=list(PREFERENCES))
def test_preference_wording_follows_delta_bic(case):
    delta_bic, misfit, table, words = PREFERENCES[case]
    assert words in preference(Rival("warm_up", {"effect": "warm_up"}, delta_bic, misfit, table))


def test_open_set_excludes_decided_rivals_and_tables():
    def rival(name: str, delta_bic: float | None, misfit: float | None, *, table: bool = False) -> Rival:
        return Rival(name, {"effect": name}, delta_bic, misfit, table)

    decided = [
        rival("by misfit", 30.0, 20.0),
        rival("table", 30.0, -5.0, table=True),
        rival("none", None, None),
    ]
    assert all(r.decided for r in decided)
    undecided = [rival("even", 1.0, 1.0), rival("by its size", 30.0, 0.0)]
    close_table = rival("close table", 5.0, -90.0, table=True)
    assert not any(r.decided for r in [*undecided, close_table])
    first = {"effect": "first"}
    assert Ambiguity("first", first, decided).open == []
    both = Ambiguity("first", first, [*decided, *undecided, close_table])
    assert both.open == [first, *({"effect": r.candidate} for r in undecided)]
    assert len(Ambiguity("first", first, undecided * 3).open) == 4


def test_plan_says_whether_data_decide_or_a_table_stays_possible(capsys):
    decided = Rival("B", {"effect": "B"}, None, None, table=False)
    table = Rival("T", {"effect": "T"}, 5.0, -90.0, table=True)
    for rivals, why in (
        ([decided], "The data decide already: "),
        ([decided, table], "No pose rules out a table: "),
    ):
        ambiguity = Ambiguity("A", {"effect": "A"}, rivals)
        _present_ambiguity(ambiguity, Plan({"q1": np.zeros(8)}), "armtrue plan fit.json", "", Output(None))
        assert why + "these poses are for the fit's own parameters." in capsys.readouterr().out


def outlook_of(expected: float, now: float = 0.0) -> str | None:
    return outlook({"truth": "A", "rival": "B", "delta_bic_now": now, "delta_bic_expected": expected})


def test_outlook_wording_follows_expected_delta_bic():
    assert outlook_of(-30.0) is None
    assert outlook_of(-0.3) is None
    assert "about as good (ΔBIC -4)" in str(outlook_of(-4.0))
    assert "about as good (ΔBIC +4)" in str(outlook_of(4.0))
    against = str(outlook_of(211.0, now=196.0))
    assert "preferred nevertheless (ΔBIC +211)" in against
    assert "as good" not in against
    assert "the present data favour B (ΔBIC +196)" in against


def decision(now: float, expected: tuple[float, float], poses: int = 8) -> str:
    pairs = (("A", "B", now, expected[0]), ("B", "A", -now, expected[1]))
    entries = [
        {
            "truth": truth,
            "rival": rival,
            "delta_bic_now": n,
            "delta_bic_expected": e,
            "delta_bic_expected_random": e,
        }
        for truth, rival, n, e in pairs
    ]
    (sentence,) = Plan({"q1": np.zeros(poses)}, {"separations": entries}).decisions()
    return sentence


def test_plan_states_whether_poses_or_existing_data_decide():
    assert decision(-2.0, (-30.0, -25.0)).startswith("These 8 poses decide between A and B: whichever")
    assert decision(-2.0, (-8.0, -4.0)).startswith("These 8 poses help to decide between A and B: whichever")
    assert decision(-2.0, (-8.0, 4.0)).startswith("These 8 poses cannot decide between A and B")
    even = decision(-2.0, (-0.4, -0.2))
    assert even.startswith("These 8 poses cannot decide between A and B: whichever is the cause")
    assert "Quantities that may decide and are not varied in them: payload" in even
    assert decision(-300.0, (-30.0, -25.0)).startswith("These 8 poses decide")
    assert decision(-300.0, (-320.0, 280.0)) == (
        "The data decide already between A and B: if the arm has one of the two, it is A with a probability of more "
        "than 99.9 %, which these 8 poses would hardly change; armtrue diagnose states whether the arm has either."
    )
    assert "of 99.3 %, which" in decision(-10.0, (-12.0, 8.0))


def test_plan_of_one_pose_is_worded_in_the_singular():
    assert decision(-2.0, (-30.0, -25.0), poses=1).startswith("This pose decides between A and B: whichever")
    assert decision(-2.0, (-8.0, -4.0), poses=1).startswith("This pose helps to decide between A and B")
    assert decision(-2.0, (-8.0, 4.0), poses=1).startswith("This pose cannot decide between A and B")
    assert "which this pose would hardly change" in decision(-300.0, (-320.0, 280.0), poses=1)
    plan = Plan({"q1": np.zeros(1)}, {"random_poses_per_planned": 1.2})
    assert plan.precision() == "1 planned pose gives the precision of 1 random one."


def test_candidates_are_read_in_diagnosis_and_in_shell_spelling():
    cases = {
        "warm_up": ("warm_up", {"effect": "warm_up"}),
        "gear_harmonics 3": ("gear_harmonics:3", {"effect": "gear_harmonics", "joints": [3]}),
        "joint_coupling 3,2": ("joint_coupling:3,2", {"effect": "joint_coupling", "joints": [3, 2]}),
        "gear_mesh 2 cycles [16.1,24]": (
            "gear_mesh:2:cycles=16.1,24",
            {"effect": "gear_mesh", "joints": [2], "cycles": [16.1, 24]},
        ),
        "gear_mesh 2 orders [1,2]": (
            "gear_mesh:2:orders=1,2",
            {"effect": "gear_mesh", "joints": [2], "orders": [1, 2]},
        ),
        "thermal_base sensor arm": ("thermal_base:sensor=arm", {"effect": "thermal_base", "sensor": "arm"}),
        "thermal_expansion 1,2 sensor link 2": (
            "thermal_expansion:1,2:sensor=link 2",
            {"effect": "thermal_expansion", "joints": [1, 2], "sensor": "link 2"},
        ),
    }
    for label, (argument, entry) in cases.items():
        assert argument_of(label) == argument
        assert entry_of(label) == entry_of(argument) == entry
    for text in (
        "gear_harmonics:x",
        "gear_mesh:2:cycles=",
        "",
        "gear_mesh:2:tau=3",
        "gear_mesh:2:cycles=1-2",
    ):
        with pytest.raises(ValueError, match="."):
            entry_of(text)


def test_sharpen_lowers_prediction_error_more_than_random_poses(folder):
    run = armtrue(
        *("plan", "fit.json", "--sharpen", "--poses", "10", "--out", "sharp.csv", "--json", "sharp.json"),
        *("--choose-from", "500"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    information = json.loads((folder / "sharp.json").read_text())["information"]
    present, random, planned = (
        information[key]["prediction_rms_um"] for key in ("present", "random", "planned")
    )
    assert planned < random < present


REFUSED = {
    "neither fit nor robot": (["--poses", "5"], "expected one or the other"),
    "fit and robot": (["fit.json", "--robot", "robot.yaml", "--poses", "5"], "--robot"),
    "unknown effect": (
        ["fit.json", "--candidates", "gear_harmonic:3", "joint_scale:2", "--poses", "5"],
        "gear_harmonics",
    ),
    "joint that is not": (
        ["fit.json", "--candidates", "gear_harmonics:9", "joint_scale:2", "--poses", "5"],
        "9",
    ),
    "joints no numbers": (
        ["fit.json", "--candidates", "gear_harmonics:x", "joint_scale:2", "--poses", "5"],
        "gear_harmonics:x",
    ),
    "levels without values": (["fit.json", "--levels", "payload", "--poses", "5"], "payload=0,8,16"),
    "levels no numbers": (["fit.json", "--levels", "payload=a,b", "--poses", "5"], "payload=a,b"),
    "box turned round": (
        ["fit.json", "--sharpen", "--box", "1", "0", "0", "1", "0", "1", "--poses", "5"],
        "box",
    ),
    "box out of reach": (
        ["fit.json", "--sharpen", "--box", "50", "51", "0", "1", "0", "1", "--poses", "5"],
        "hardly any pose",
    ),
    "no clearance": (["fit.json", "--clearance", "0", "--poses", "5"], "--clearance"),
    "too few to choose from": (
        ["fit.json", "--sharpen", "--choose-from", "8", "--poses", "5"],
        "8 candidates",
    ),
    "more without two": (["fit.json", "--also", "joint_scale:2", "--poses", "5"], "--also"),
    "effect already in": (
        ["fit.json", "--candidates", "joint_offset:2", "joint_scale:2", "--poses", "5"],
        "fit.json joint_offset --joints 2 --out without.json' writes it",
    ),
}


@pytest.mark.parametrize("case", REFUSED, ids=list(REFUSED))
def test_bad_input_is_refused_in_one_sentence_without_output_file(folder, case):
    arguments, named = REFUSED[case]
    run = armtrue("plan", *arguments, "--out", "refused.csv", cwd=folder)
    assert run.returncode == 2, run.stdout + run.stderr
    assert named in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert not (folder / "refused.csv").exists()


def fitted_campaign(folder, **scenario):
    """Write a campaign without hidden effects, and its fit.json, into `folder`; `scenario`: further keys of it."""
    base = {"arm": "kr30", "seed": 5, "poses": 60, "repeats": {}, "hidden": []}
    armtrue_sim.simulate(base | scenario).write(folder)
    made = armtrue(*FIT, "--out", "fit.json", cwd=folder)
    assert made.returncode == 0, made.stderr


def test_planned_poses_name_their_reflector(tmp_path):
    fitted_campaign(tmp_path, targets={"names": ["B", "A"], "order": "cycle"})
    run = armtrue(
        *("plan", "fit.json", "--sharpen", "--poses", "4", "--choose-from", "300", "--out", "p.csv"),
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "4 poses of reflector B" in run.stdout
    with (tmp_path / "p.csv").open(encoding="utf-8") as file:
        assert [row["target"] for row in csv.DictReader(file)] == ["B"] * 4
    # Other commands can read the file of poses.
    predicted = armtrue("predict", "fit.json", "p.csv", "--out", "predicted.csv", cwd=tmp_path)
    assert predicted.returncode == 0, predicted.stderr


def test_first_campaign_uses_the_first_tool_of_robot_yaml(folder, tmp_path):
    robot = yaml.safe_load((folder / "robot.yaml").read_text())
    robot["tools"] = {"low": robot.pop("tool"), "high": {"xyz": [0.0, 0.0, 0.4]}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False))
    run = armtrue(
        *("plan", "--robot", "robot.yaml", "--model", str(folder / "model.yaml"), "--poses", "5"),
        *("--choose-from", "300", "--out", "p.csv"),
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    assert "5 poses of reflector low" in run.stdout


def test_plan_refuses_measured_torques_if_link_masses_are_missing(tmp_path):
    fitted_campaign(tmp_path, columns={"add": ["tau"]}, robot_file={"omit": ["links"]})
    run = armtrue(
        *("plan", "fit.json", "--candidates", "backlash:2", "gear_harmonics:2", "--poses", "4"),
        *("--choose-from", "300", "--out", "p.csv"),
        cwd=tmp_path,
    )
    assert run.returncode == 2
    assert "tau2" in run.stderr
    assert "only be computed from masses" in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1


def test_model_with_backlash_needs_levels_of_the_direction(folder):
    (folder / "backlash.yaml").write_text(
        "effects: [base_frame, tool_offset, {effect: backlash, joints: [2]}]\n"
    )
    arguments = (
        "plan",
        "--robot",
        "robot.yaml",
        "--model",
        "backlash.yaml",
        "--poses",
        "5",
        "--out",
        "b.csv",
    )
    refused = armtrue(*arguments, cwd=folder)
    assert refused.returncode == 2
    assert "dir2" in refused.stderr
    assert "--levels" in refused.stderr
    allowed = armtrue(*arguments, "--levels", "dir=-1,1", cwd=folder)
    assert allowed.returncode == 0, allowed.stderr
    assert {row["dir2"] for row in rows_of(folder / "b.csv")} == {-1.0, 1.0}
