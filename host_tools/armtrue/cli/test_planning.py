"""The command plan end to end on a simulated arm: what it writes, what it says, how it refuses."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest

SCENARIO = Path(__file__).resolve().parents[3] / "sim" / "scenarios" / "kr30-eccentric-gear.yaml"


def plan(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armtrue", *arguments]
    run = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120)
    assert "Traceback" not in run.stderr, run.stderr
    return run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("plan")
    armtrue_sim.cli_simulate(SCENARIO, made)
    fitted = plan(
        "fit", "data.csv", "--robot", "robot.yaml", "--model", "model.yaml", "--out", "fit.json", cwd=made
    )
    assert fitted.returncode == 0, fitted.stderr
    return made


def rows_of(path: Path) -> list[dict[str, float]]:
    with path.open(encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_a_first_campaign_is_written_and_said_beside_random_poses(folder):
    run = plan(
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
    assert figures["random_poses_per_planned"] > 1.2
    assert planned["eigenvalues_per_m2"] == sorted(planned["eigenvalues_per_m2"])
    assert len(planned["eigenvalues_per_m2"]) == figures["unknowns"]


def test_the_same_seed_gives_the_same_poses_and_another_one_others(folder):
    def poses(seed: str) -> str:
        run = plan(
            *("plan", "--robot", "robot.yaml", "--model", "model.yaml", "--poses", "10", "--out", "seed.csv"),
            *("--seed", seed, "--choose-from", "500"),
            cwd=folder,
        )
        assert run.returncode == 0, run.stderr
        return (folder / "seed.csv").read_text()

    assert poses("1") == poses("1")
    assert poses("1") != poses("2")


def test_poses_keep_to_the_box_and_the_limits(folder):
    run = plan(
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


def test_candidates_named_are_told_apart_with_the_evidence_expected(folder):
    run = plan(
        *("plan", "fit.json", "--candidates", "gear_harmonics:3", "joint_coupling:3,2"),
        *("--poses", "8", "--out", "apart.csv", "--json", "apart.json", "--choose-from", "1000"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    assert "ΔBIC of the cause less the rival" in run.stdout
    figures = json.loads((folder / "apart.json").read_text())
    assert figures["candidates"] == ["gear_harmonics 3", "joint_coupling 3,2"]
    for entry in figures["separations"]:
        assert entry["delta_bic_expected"] < entry["delta_bic_expected_random"]
    now = [entry["delta_bic_now"] for entry in figures["separations"]]
    assert now[0] == pytest.approx(-now[1])
    assert len(rows_of(folder / "apart.csv")) == 8


def test_sharpening_tells_more_than_the_fit_knows(folder):
    run = plan(
        *("plan", "fit.json", "--sharpen", "--poses", "10", "--out", "sharp.csv", "--json", "sharp.json"),
        *("--choose-from", "500"),
        cwd=folder,
    )
    assert run.returncode == 0, run.stderr
    information = json.loads((folder / "sharp.json").read_text())["information"]
    errors = [information[key]["prediction_rms_um"] for key in ("present", "random", "planned")]
    assert errors == sorted(errors, reverse=True)


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
    "effect already in": (
        ["fit.json", "--candidates", "joint_offset:2", "joint_scale:2", "--poses", "5"],
        "joint_offset",
    ),
}


@pytest.mark.parametrize("case", REFUSED, ids=list(REFUSED))
def test_bad_input_gets_one_sentence_and_nothing_is_written(folder, case):
    arguments, named = REFUSED[case]
    run = plan("plan", *arguments, "--out", "refused.csv", cwd=folder)
    assert run.returncode == 2, run.stdout + run.stderr
    assert named in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert not (folder / "refused.csv").exists()


def test_a_model_that_reads_directions_asks_for_their_levels(folder):
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
    refused = plan(*arguments, cwd=folder)
    assert refused.returncode == 2
    assert "dir2" in refused.stderr
    allowed = plan(*arguments, "--levels", "dir=-1,1", cwd=folder)
    assert allowed.returncode == 0, allowed.stderr
    assert {row["dir2"] for row in rows_of(folder / "b.csv")} == {-1.0, 1.0}
