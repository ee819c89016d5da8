"""Custom effects of a user-defined column and of time, from model.yaml to the exported tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import armtrue_sim
import numpy as np
import pytest
import yaml
from armtrue.cli.conftest import armtrue
from armtrue.workbench.conftest import do
from armtrue.workbench.engine import Engine
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import open_files

SLOPE = 3e-4  # rad of joint 5 for each unit of the column air
AIRY = {"effect": "custom", "name": "airy", "coordinate": "motor5", "expression": "air - 5"}
AS_OPTIONS = [
    word for key in ("name", "coordinate", "expression") for word in ("--option", f"{key}={AIRY[key]}")
]
FIT = ("fit", "data.csv", "--robot", "robot.yaml", "--model")


def with_air(source: Path, out: Path, header: str = "air") -> None:
    """Write the poses in `source` with a column air; q5 is shifted so that the effect leaves joint 5 where it was."""
    with source.open() as stream:
        rows = list(csv.DictReader(stream))
    air = 5.0 + 0.5 * np.random.default_rng(len(rows)).normal(size=len(rows))
    for row, value in zip(rows, air, strict=True):
        row[header] = f"{value:.6f}"
        row["q5"] = f"{float(row['q5']) - SLOPE * (value - 5.0):.10f}"
    with out.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def model_with(folder: Path, name: str, *customs: dict[str, object]) -> str:
    effects = yaml.safe_load((folder / "model.yaml").read_text())["effects"]
    (folder / name).write_text(yaml.safe_dump({"effects": [*effects, *customs]}))
    return name


def parameter(fit: Path, name: str) -> float:
    return next(p["value"] for p in json.loads(fit.read_text())["parameters"] if p["name"] == name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose joint 5 depends on a user-defined column, and airy.json, fitted to it."""
    made = tmp_path_factory.mktemp("own")
    plain = made / "plain"
    armtrue_sim.simulate({"arm": "kr30", "seed": 5, "poses": 120, "hidden": []}).write(plain)
    for name in ("robot.yaml", "model.yaml"):
        (made / name).write_text((plain / name).read_text())
    with_air(plain / "data.csv", made / "data.csv")
    with_air(plain / "test.csv", made / "test.csv")
    (made / "bare.csv").write_text((plain / "test.csv").read_text())
    run = armtrue(*FIT, model_with(made, "airy.yaml", AIRY), "--out", "airy.json", cwd=made)
    assert run.returncode == 0, run.stderr
    run = armtrue(*FIT, "model.yaml", "--out", "plain.json", cwd=made)
    assert run.returncode == 0, run.stderr
    return made


def test_fit_finds_a_custom_effect_of_a_user_column(folder):
    assert parameter(folder / "airy.json", "custom.airy") == pytest.approx(SLOPE, rel=0.05)


def test_add_and_remove_accept_an_effect_of_a_user_column(folder):
    run = armtrue("add", "plain.json", "custom", *AS_OPTIONS, "--out", "added.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert parameter(folder / "added.json", "custom.airy") == pytest.approx(SLOPE, rel=0.05)
    run = armtrue("remove", "added.json", "custom", "--out", "removed.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    kept = json.loads((folder / "removed.json").read_text())["model"]
    assert kept == json.loads((folder / "plain.json").read_text())["model"]


def test_dataset_yaml_maps_a_user_column(folder):
    columns = (folder / "data.csv").read_text().splitlines()[0].split(",")
    with_air(folder / "plain" / "data.csv", folder / "foreign.csv", header="Luft [bar]")
    described = {
        "file": "foreign.csv",
        "columns": {name: name for name in columns if name != "air"},
        "variables": {"air": "Luft [bar]"},
    }
    (folder / "dataset.yaml").write_text(yaml.safe_dump(described))
    words = ("--robot", "robot.yaml", "--model", "airy.yaml", "--out", "foreign.json")
    run = armtrue("fit", "dataset.yaml", *words, cwd=folder)
    assert run.returncode == 0, run.stderr
    assert parameter(folder / "foreign.json", "custom.airy") == pytest.approx(SLOPE, rel=0.05)


def test_predict_compare_and_report_read_the_user_column(folder):
    run = armtrue("compare", "airy.json", "test.csv", "--json", "c.json", cwd=folder)
    assert run.returncode == 0, run.stdout + run.stderr
    assert json.loads((folder / "c.json").read_text())["verdict"] == "as_expected"
    run = armtrue("predict", "airy.json", "test.csv", "--uncertainty", "--out", "p.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    run = armtrue("report", "airy.json", "--out", "report.html", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "custom.airy" in (folder / "report.html").read_text()


@pytest.mark.parametrize("measurement", [False, True])
def test_poses_without_the_user_column_are_refused(folder, measurement):
    model = model_with(folder, "told.yaml", {**AIRY, "measurement": measurement})
    run = armtrue(*FIT, model, "--out", "told.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    for words in (
        ("predict", "told.json", "bare.csv", "--out", "refused.csv"),
        ("compare", "told.json", "bare.csv"),
    ):
        run = armtrue(*words, cwd=folder)
        assert run.returncode == 2, run.stdout
        assert "bare.csv: column air is missing or not recorded" in run.stderr
    assert not (folder / "refused.csv").exists()


@pytest.mark.parametrize(
    ("command", "place"),
    [
        (("fit", "data.csv", "--robot", "robot.yaml", "--model", "wrong.yaml"), "wrong.yaml: effects["),
        (("add", "plain.json", "custom", *AS_OPTIONS[:-1], "expression=iar - 5"), "plain.json: expression"),
    ],
)
def test_mistyped_user_column_suggests_the_right_name(folder, command, place):
    model_with(folder, "wrong.yaml", {**AIRY, "expression": "iar - 5"})
    run = armtrue(*command, "--out", "wrong.json", cwd=folder)
    assert run.returncode == 2
    assert place in run.stderr
    assert "'iar' is neither" in run.stderr
    assert "did you mean 'air'?" in run.stderr
    assert not (folder / "wrong.json").exists()


def test_parameter_named_like_a_user_column_is_refused(folder):
    clash = {**AIRY, "expression": "air*q1", "parameters": {"air": 1.0}}
    run = armtrue(*FIT, model_with(folder, "clash.yaml", clash), "--out", "clash.json", cwd=folder)
    assert run.returncode == 2
    assert "parameters.air: found the name of a" in run.stderr


def test_export_omits_user_column_effect_and_states_its_size(folder):
    run = armtrue("export", "airy.json", "--out", "airy.bin", "--json", "e.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    run_plain = armtrue("export", "plain.json", "--out", "plain.bin", cwd=folder)
    assert run_plain.returncode == 0, run_plain.stderr
    (left,) = json.loads((folder / "e.json").read_text())["stays_behind"].items()
    assert left[0] == "custom.airy"
    assert "a device does not know column air" in left[1]["why"]
    # Half a unit of air times the distance from joint 5 to the tool point.
    assert 10.0 < left[1]["effect_um"] < 150.0
    assert f"{left[1]['effect_um']:.1f} µm" in " ".join(run.stdout.split())
    run = armtrue("compensate", "airy.bin", "bare.csv", "--out", "c.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "air" not in run.stderr


@pytest.mark.full
def test_export_takes_the_average_of_an_omitted_column(folder):
    """Otherwise the joint zero that was fitted beside the term would be exported without the term."""
    corrected, sizes = [], []
    for name, expression in (("centred", "air - 5"), ("plain-air", "air")):
        model = model_with(folder, f"{name}.yaml", {**AIRY, "expression": expression})
        run = armtrue(*FIT, model, "--out", f"{name}.json", cwd=folder)
        assert run.returncode == 0, run.stderr
        run = armtrue(
            "export", f"{name}.json", "--out", f"{name}.bin", "--json", f"{name}-e.json", cwd=folder
        )
        assert run.returncode == 0, run.stderr
        left = json.loads((folder / f"{name}-e.json").read_text())["stays_behind"]["custom.airy"]
        assert "its average over the measurements is taken" in left["why"]
        sizes.append(left["effect_um"])
        run = armtrue("compensate", f"{name}.bin", "bare.csv", "--out", f"{name}.csv", cwd=folder)
        assert run.returncode == 0, run.stderr
        corrected.append(np.genfromtxt(folder / f"{name}.csv", delimiter=",", names=True)["q5"])
    assert np.abs(corrected[1] - corrected[0]).max() < 2e-5
    assert sizes[1] == pytest.approx(sizes[0], rel=0.02)


@pytest.mark.full
def test_export_states_the_size_of_each_custom_effect(folder):
    small = {**AIRY, "name": "small", "coordinate": "link1.tx", "expression": "1e-3*sin(3*q1)*air"}
    run = armtrue(*FIT, model_with(folder, "two.yaml", AIRY, small), "--out", "two.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    armtrue("export", "two.json", "--out", "two.bin", "--json", "two-e.json", cwd=folder)
    two = json.loads((folder / "two-e.json").read_text())["stays_behind"]
    alone = json.loads((folder / "airy.json").read_text())["effects_move_um"]["custom.airy"]
    assert two["custom.airy"]["effect_um"] == pytest.approx(alone, rel=0.1)
    assert two["custom.small"]["effect_um"] < 0.5 * alone


@pytest.mark.full
def test_workbench_opens_and_adds_an_effect_of_a_user_column(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    opened = open_files([folder / "data.csv"], folder / "robot.yaml", folder / "airy.yaml")
    assert AIRY in opened.model.effects
    engine = Engine(Drop(tmp_path / "drop"))
    engine.begin(open_files([folder / "plain.json"]))
    do(engine, "add", entry=AIRY)
    assert engine.session.node.effects[-1] == AIRY


CREEP = {"effect": "custom", "name": "creep", "coordinate": "base.tz", "expression": "time/3600"}
RATE = 6e-5  # m an hour


@pytest.fixture(scope="module")
def creeping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session during which the tracker sinks."""
    made = tmp_path_factory.mktemp("creep")
    armtrue_sim.simulate({"arm": "kr30", "seed": 6, "poses": 120, "hidden": []}).write(made)
    with (made / "data.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:
        row["z"] = f"{float(row['z']) + RATE * float(row['time']) / 3600.0:.9f}"
    with (made / "data.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return made


def exported(folder: Path, **more: bool) -> dict[str, object]:
    """Fit the creep as a custom effect, export it, and return export's JSON."""
    run = armtrue(
        *FIT, model_with(folder, "creep.yaml", {**CREEP, **more}), "--out", "creep.json", cwd=folder
    )
    assert run.returncode == 0, run.stderr
    assert parameter(folder / "creep.json", "custom.creep") == pytest.approx(RATE, rel=0.3)
    run = armtrue("export", "creep.json", "--out", "creep.bin", "--json", "e.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    return json.loads((folder / "e.json").read_text())


def corrections_change_with_time(folder: Path) -> bool:
    """True if the corrected joints differ a day later."""
    with (folder / "test.csv").open() as stream:
        rows = list(csv.DictReader(stream))[:20]
    corrected = []
    for seconds in (0, 86400):
        lines = [f"q{k}" for k in range(1, 7)]
        poses = [
            ",".join([*lines, "time"]),
            *(",".join([*(row[q] for q in lines), str(seconds)]) for row in rows),
        ]
        (folder / "poses.csv").write_text("\n".join(poses) + "\n")
        run = armtrue("compensate", "creep.bin", "poses.csv", "--out", "c.csv", cwd=folder)
        assert run.returncode == 0, run.stderr
        corrected.append(np.genfromtxt(folder / "c.csv", delimiter=",", names=True))
    return any(not np.array_equal(corrected[0][f"q{k}"], corrected[1][f"q{k}"]) for k in range(1, 7))


@pytest.mark.full
def test_export_omits_custom_time_effect_and_states_its_size(creeping):
    said = exported(creeping)
    (left,) = said["stays_behind"].items()
    assert left[0] == "custom.creep"
    assert "it depends on time" in left[1]["why"]
    assert "measurement: false" in left[1]["why"]
    assert 10.0 < left[1]["effect_um"] < 200.0
    assert not corrections_change_with_time(creeping)


@pytest.mark.full
def test_export_includes_time_effect_with_measurement_false(creeping):
    assert exported(creeping, measurement=False)["stays_behind"] == {}
    assert corrections_change_with_time(creeping)


@pytest.mark.full
def test_export_notes_a_time_effect_with_measurement_true(creeping):
    said = exported(creeping, measurement=True)
    assert said["stays_behind"] == {}
    assert any("belongs to the measurement" in note and "custom.creep" in note for note in said["notes"])
