"""Campaigns: the contract's form, exactness, reproducibility, and the disturbances of a real session."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from . import ScenarioError, cli_simulate, simulate
from .arm import Arm
from .build import build_arm
from .campaign import joints_of, measure
from .mechanics.transforms import exp_so3
from .scenario import Scenario

SCENARIOS = sorted((Path(__file__).parents[1] / "scenarios").glob("*.yaml"))
FILES = ["data.csv", "hidden.json", "model.yaml", "robot.yaml", "test.csv", "truth.json"]


def read(path):
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def positions(table):
    return np.stack([np.asarray(table[c], dtype=float) for c in "xyz"], axis=1)


def columns_of(table):
    return {k: np.asarray(v) if k == "target" else np.asarray(v, dtype=float) for k, v in table.items()}


@pytest.mark.quick("irb2400-ladder", "cobot-waves")
@pytest.mark.parametrize("path", SCENARIOS, ids=lambda p: p.stem)
def test_every_committed_scenario_is_reproducible_and_exact(path, tmp_path):
    campaign = cli_simulate(path, tmp_path / "a")
    cli_simulate(path, tmp_path / "b")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == FILES
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    # The columns of the file reproduce its positions to their nine decimals.
    test = columns_of(read(tmp_path / "a" / "test.csv"))
    n = campaign.arm.chain.n
    assert np.abs(campaign.arm.true_position(joints_of(test, n), test) - positions(test)).max() < 6e-10
    data = read(tmp_path / "a" / "data.csv")
    assert {k: len(v) for k, v in campaign.data.items()} == {k: len(v) for k, v in data.items()}
    assert np.allclose(positions(data), campaign.positions, atol=1e-12)


def test_campaign_files_have_the_form_of_the_contract(tmp_path):
    simulate({"arm": "kr30", "seed": 5, "hidden": [{"effect": "gear_harmonics", "joints": [3]}]}, tmp_path)
    data, test = read(tmp_path / "data.csv"), read(tmp_path / "test.csv")
    joints = range(1, 7)
    header = [f"q{k}" for k in joints] + ["x", "y", "z", "temp_arm", "payload"]
    header += [f"dir{k}" for k in joints] + ["time", "repeat"]
    assert list(data) == list(test) == header
    assert len(data["q1"]) == 240
    assert len(test["q1"]) == 60
    # The first four poses come back three times at the end.
    assert data["repeat"][-12:].tolist() == ["3", "2", "1", "0"] * 3
    assert data["q1"][-1] == data["q1"][0]
    assert len(set(data["repeat"])) == 228
    assert set(data["repeat"]).isdisjoint(test["repeat"])
    assert json.loads((tmp_path / "hidden.json").read_text()) == [{"effect": "gear_harmonics", "joints": [3]}]
    model = yaml.safe_load((tmp_path / "model.yaml").read_text())
    assert model == {
        "effects": ["base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance"]
    }
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    assert list(robot) == ["name", "kinematics", "links", "gravity", "temperature", "tool", "base"]
    assert list(robot["kinematics"]["joints"][0]) == [
        "name",
        "a",
        "alpha",
        "d",
        "offset",
        "gear_ratio",
        "limits",
    ]
    limits = np.array([joint["limits"] for joint in robot["kinematics"]["joints"]])
    q = joints_of(columns_of(data), 6)
    assert np.all((q >= limits[:, 0]) & (q <= limits[:, 1]))


def test_hidden_json_names_each_effect_as_a_candidate_does():
    hidden = [
        "parallelogram",
        "gravity_balancer",
        "base_compliance",
        "joint_coupling",
        "gear_mesh",
        "warm_up",
    ]
    listed = simulate({"arm": "irb2400", "hidden": hidden}).hidden
    assert [(e["effect"], e["joints"]) for e in listed] == [
        ("parallelogram", [2, 3]),
        ("gravity_balancer", [2]),
        ("base_compliance", []),
        ("joint_coupling", [5, 4]),
        ("joint_coupling", [6, 4]),
        ("joint_coupling", [6, 5]),
        ("gear_mesh", [1, 2, 3, 4, 5, 6]),
        ("warm_up", []),
    ]
    assert listed[6]["orders"] == [1]


def test_truth_json_rebuilds_the_arm(tmp_path):
    campaign = simulate({"arm": "irb2400", "seed": 5, "hidden": ["parallelogram"]}, tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert {t["effect"] for t in truth["terms"]} == {"joint_offset", "link_geometry", "joint_compliance"}
    assert len(truth["terms"]) == 6 + 30 + 2
    assert truth["linkage"]["first_order"] == campaign.arm.linkage.first_order()
    assert truth["flange_from_tool"][""]["xyz"] == list(campaign.arm.flange_from_tool[""].translation)


def test_noise_matches_stated_instrument_and_repeatability():
    campaign = simulate(
        {
            "arm": "kr30",
            "seed": 8,
            "poses": 4000,
            "instrument": {"sigma": 8e-6},
            "repeatability": {"drive": 0.0},
        }
    )
    noise = campaign.positions - campaign.arm.true_position(campaign.q, campaign.data)
    assert noise.std(axis=0) == pytest.approx([8e-6] * 3, rel=0.05)
    still = simulate(
        {
            "arm": "kr30",
            "seed": 8,
            "poses": 400,
            "instrument": {"sigma": 0.0},
            "repeatability": {"tool_mean": 6.26e-6},
        }
    )
    spread = np.linalg.norm(still.positions - still.arm.true_position(still.q, still.data), axis=1)
    assert spread.mean() == pytest.approx(6.26e-6, rel=0.1)


def test_hiding_an_effect_changes_nothing_else():
    bare = simulate({"arm": "kr30", "seed": 9})
    more = simulate({"arm": "kr30", "seed": 9, "hidden": [{"effect": "backlash", "joints": [2]}]})
    assert more.arm.terms[:-1] == bare.arm.terms
    assert np.array_equal(more.q, bare.q)
    noise = [c.positions - c.exact for c in (bare, more)]
    assert np.allclose(*noise, atol=1e-9)


def test_reflectors_share_drive_scatter_and_keep_distance():
    campaign = simulate(
        {
            "arm": "cobot",
            "seed": 2,
            "poses": 30,
            "targets": {"names": ["A", "B", "C"]},
            "instrument": {"sigma": 0.0},
            "repeatability": {"drive": 5e-5},
        }
    )
    target = campaign.data["target"]
    assert len(target) == 90
    assert target[:4].tolist() == ["A", "B", "C", "A"]
    poses = campaign.arm.flange_from_tool
    expected = np.linalg.norm(poses["A"].translation - poses["B"].translation)
    apart = np.linalg.norm(campaign.positions[target == "A"] - campaign.positions[target == "B"], axis=1)
    assert apart == pytest.approx(expected, abs=2e-9)
    cycled = simulate(
        {"arm": "cobot", "poses": 30, "test_poses": 0, "targets": {"names": ["A", "B"], "order": "cycle"}}
    )
    assert cycled.data["target"][:3].tolist() == ["A", "B", "A"]
    assert len(cycled.data["target"]) == 30


def test_directions_follow_the_order_of_poses():
    campaign = simulate({"arm": "kr30", "seed": 2, "directions": "order"})
    step = np.sign(np.diff(campaign.q, axis=0))
    sides = np.stack([campaign.data[f"dir{k}"] for k in range(1, 7)], axis=1)
    assert np.array_equal(sides[1:][step != 0], step[step != 0].astype(int))
    assert set(np.unique(sides)) == {-1, 1}


def test_directions_up_gives_every_joint_direction_plus_1():
    data = simulate({"arm": "kr30", "poses": 30, "directions": "up"}).data
    assert all(np.all(data[f"dir{k}"] == 1) for k in range(1, 7))


def test_sensors_after_the_first_vary_by_their_wave():
    def difference(wave: float) -> np.ndarray:
        scenario = {
            "arm": "kr30",
            "seed": 3,
            "sensors": ["arm", "top", "bottom"],
            "temperature": {"rise": 0.0, "jitter": 0.0, "wave": wave},
        }
        data = simulate(scenario).data
        assert np.ptp(data["temp_arm"]) == 0.0
        return data["temp_top"] - data["temp_bottom"]

    assert np.ptp(difference(0.0)) == 0.0
    assert 2.0 < np.ptp(difference(2.0)) < 8.0


def test_temperature_history_and_payload_blocks():
    campaign = simulate(
        {
            "arm": "kr30",
            "payload_order": "blocks",
            "interval": 20.0,
            "temperature": {"ambient": 22.0, "rise": 9.0, "time_constant": 600.0, "jitter": 0.0},
        }
    )
    warm = campaign.data["temp_arm"]
    assert warm[0] == 22.0
    assert warm[30] == pytest.approx(22.0 + 9.0 * (1 - np.exp(-1.0)), abs=1e-3)
    payload = campaign.data["payload"][:228]
    assert np.all(np.diff(payload) >= 0.0)
    assert set(payload) == {0.0, 8.0, 16.0}


def test_added_columns_match_pose_sigma_torque_and_readback():
    campaign = simulate(
        {
            "arm": "lbr",
            "seed": 3,
            "instrument": {"sigma": 9e-6, "orientation": 0.0},
            "repeatability": {"drive": 0.0},
            "torque_noise": 0.3,
            "columns": {"add": ["sigma", "tau", "qr", "orientation"]},
        }
    )
    data, arm, q = campaign.data, campaign.arm, campaign.q
    w, x, y, z = (data[f"q{c}"] for c in "wxyz")
    rotation = arm.true_pose(q, data)[0]
    angle = 2 * np.arctan2(np.linalg.norm([x, y, z], axis=0), w)
    axis = np.stack([x, y, z], axis=1) / np.linalg.norm([x, y, z], axis=0)[:, None]
    assert np.allclose(exp_so3(angle[:, None] * axis), rotation, atol=1e-8)
    assert np.all(data["sigma"] == 9e-6)
    torque = np.stack([data[f"tau{k}"] for k in range(1, 8)], axis=1)
    assert (torque - arm.state(q, data).loads.motor_torque).std() == pytest.approx(0.3, rel=0.1)
    behind = (data["q1"] - data["qr1"]) * data["dir1"]
    assert behind.mean() == pytest.approx(2e-4, rel=0.3)


def test_truth_lists_the_rows_of_gross_errors():
    scenario = {"arm": "kr30", "seed": 4, "gross_errors": {"count": 6, "size": [1e-3, 2e-3]}}
    campaign = simulate(scenario)
    off = np.linalg.norm(campaign.positions - campaign.exact, axis=1)
    assert campaign.truth["gross_error_rows"] == [int(r) + 1 for r in np.flatnonzero(off > 5e-4)]
    assert len(campaign.gross_rows) == 6
    bumped = simulate(
        {"arm": "kr30", "seed": 4, "gross_errors": {"bump": {"row": 201, "shift": [0, 0, 3e-3]}}}
    )
    assert bumped.gross_rows == list(range(200, 240))
    assert np.median((bumped.positions - bumped.exact)[200:, 2]) == pytest.approx(3e-3, abs=1e-5)


def test_unrecorded_columns_still_affect_positions():
    scenario = {
        "arm": "kr30",
        "seed": 4,
        "columns": {"omit": ["dir", "temp_arm"]},
        "hidden": [{"effect": "backlash", "joints": [2]}],
        "robot_file": {"omit": ["links", "tool", "base"]},
    }
    campaign = simulate(scenario)
    assert not {"dir1", "dir6", "temp_arm"} & (set(campaign.data) | set(campaign.test))
    withheld = {"temp_arm", *(f"{name}{k}" for name in ("dir", "travel", "duty") for k in range(1, 7))}
    assert set(campaign.unrecorded) == withheld
    assert set(campaign.robot) == {"name", "kinematics", "gravity", "temperature"}
    everything = simulate({**scenario, "columns": {}})
    assert np.array_equal(campaign.positions, everything.positions)


def test_statics_are_those_of_the_deflected_arm_by_default():
    exact = {s: simulate({"arm": "kr30", "statics": s}).exact for s in ("nominal", "deflected")}
    assert 1e-6 < np.linalg.norm(exact["nominal"] - exact["deflected"], axis=1).max() < 1e-3
    assert np.array_equal(simulate({"arm": "kr30"}).exact, exact["deflected"])


def test_true_position_is_vectorised_and_needs_no_columns():
    arm = build_arm(
        Scenario(arm="irb2400", hidden=["parallelogram", "thermal_expansion", {"effect": "backlash"}])
    )
    campaign = measure(Scenario(arm="irb2400", poses=30), arm)
    together = arm.true_position(campaign.q, campaign.data)
    singly = [
        arm.true_position(campaign.q[i], {k: v[i : i + 1] for k, v in campaign.data.items()})[0]
        for i in range(30)
    ]
    assert np.allclose(together, singly, atol=1e-14)
    bare = Arm(arm.robot, [], arm.nominal_base, {"": arm.nominal_tool})
    assert np.allclose(bare.true_position(campaign.q), arm.nominal_position(campaign.q), atol=1e-14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"arm": "puma"}, "arm is 'puma', expected one of kr30"),
        ({"robots": 1}, "unknown key 'robots'"),
        ({"poses": "many"}, "'poses' is 'many', expected a whole number"),
        ({"poses": 10}, "12 repeats do not fit into 10 poses"),
        ({"convention": "hayati"}, "'convention' is 'hayati', expected mdh or dh"),
        ({"hidden": ["rust"]}, "hidden: unknown effect 'rust'"),
        ({"hidden": [{"joints": [1]}]}, r"hidden\[0\]"),
        ({"hidden": [{"effect": "backlash", "joints": 2}]}, r"hidden\[0\].joints is 2, expected a list"),
        ({"hidden": [{"effect": "custom", "coordinate": "motor1", "expression": "q8", "value": 1}]}, "'q8'"),
        (
            {"hidden": [{"effect": "custom", "coordinate": "motor1", "expression": "q1+", "value": 1}]},
            "does not parse",
        ),
        ({"hidden": ["parallelogram"]}, "no `linkage`"),
        ({"instrument": {"sigma": -1.0}}, "negative"),
        ({"columns": {"add": ["colour"]}}, "'colour'"),
        ({"temperature": {"humidity": 1}}, "'temperature' has 'humidity'"),
        ({"robot_file": {"omit": ["kinematics"]}}, "robot_file.omit holds 'kinematics'"),
        ({"payloads": []}, "'payloads' is empty"),
        ({"gross_errors": {"count": 1000}}, "gross_errors.count is 1000"),
        ({"joint_range": [[0, 1]]}, "expected 6 pairs"),
        ({"joint_range": [[-9, 9]] * 6}, "inside the joint limits"),
        ({"floor": 9.0}, "floor 9.0"),
        ({"base": {"rpy": [0, 0, 0]}}, "'base' has no xyz"),
        ({"targets": ["A"]}, "'targets' is"),
    ],
)
def test_invalid_scenario_gives_one_line_and_writes_nothing(change, message, tmp_path):
    path = tmp_path / "mistake.yaml"
    path.write_text(yaml.safe_dump({"arm": "kr30"} | change))
    with pytest.raises(ScenarioError, match=message) as caught:
        cli_simulate(path, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("arm: [", "is not YAML"),
        ("- kr30", "expected a mapping"),
        ("seed: 1", "no key 'arm'"),
        ("", "expected a mapping"),
    ],
)
def test_file_that_is_no_scenario_is_named(text, message, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message) as caught:
        cli_simulate(path, tmp_path / "out")
    assert str(path) in str(caught.value)


def test_missing_file_and_occupied_folder_are_named(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        cli_simulate(tmp_path / "none.yaml", tmp_path / "out")
    occupied = tmp_path / "file"
    occupied.write_text("")
    with pytest.raises(ScenarioError, match="is a file"):
        cli_simulate(SCENARIOS[0], occupied)


def test_shipped_scenario_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert Scenario.from_file("kr30-eccentric-gear").name == "kr30-eccentric-gear"
    with pytest.raises(ScenarioError, match="kr31: cannot be read"):
        Scenario.from_file("kr31")
    Path("kr30").write_text("arm: cobot\n")
    assert Scenario.from_file("kr30").arm == "cobot"


def test_full_disk_leaves_neither_files_nor_a_new_folder(tmp_path, monkeypatch):
    campaign = simulate({"arm": "kr30", "seed": 3, "poses": 60})
    write_text = Path.write_text

    def on_a_full_disk(path, text, **options):
        write_text(path, text[:100], **options)
        if "test.csv" in path.name:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", on_a_full_disk)
    with pytest.raises(OSError, match="No space left"):
        campaign.write(tmp_path / "made")
    assert list(tmp_path.iterdir()) == []
