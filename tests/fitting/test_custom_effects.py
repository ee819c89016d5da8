"""A user's own effect from the file to the table: of a column of its own, and of time."""

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
    """The poses in `source` with a column air, commanded so that joint 5 stands where it stood without it."""
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
    """A campaign whose joint 5 follows a column of its own, and airy.json, fitted to it."""
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


def test_fit_reads_a_custom_effect_of_an_own_column(folder):
    assert parameter(folder / "airy.json", "custom.airy") == pytest.approx(SLOPE, rel=0.05)


def test_add_and_remove_take_a_custom_effect_of_an_own_column(folder):
    run = armtrue("add", "plain.json", "custom", *AS_OPTIONS, "--out", "added.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert parameter(folder / "added.json", "custom.airy") == pytest.approx(SLOPE, rel=0.05)
    run = armtrue("remove", "added.json", "custom", "--out", "removed.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    kept = json.loads((folder / "removed.json").read_text())["model"]
    assert kept == json.loads((folder / "plain.json").read_text())["model"]


def test_dataset_yaml_names_the_own_column(folder):
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


def test_predict_and_compare_read_the_own_column(folder):
    run = armtrue("compare", "airy.json", "test.csv", "--json", "c.json", cwd=folder)
    assert run.returncode == 0, run.stdout + run.stderr
    assert json.loads((folder / "c.json").read_text())["verdict"] == "as_expected"
    run = armtrue("predict", "airy.json", "test.csv", "--uncertainty", "--out", "p.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    run = armtrue("report", "airy.json", "--out", "report.html", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "custom.airy" in (folder / "report.html").read_text()


@pytest.mark.parametrize("measurement", [False, True])
def test_poses_without_the_own_column_are_refused(folder, measurement):
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
def test_an_own_column_that_is_mistyped_is_named_with_the_right_one(folder, command, place):
    model_with(folder, "wrong.yaml", {**AIRY, "expression": "iar - 5"})
    run = armtrue(*command, "--out", "wrong.json", cwd=folder)
    assert run.returncode == 2
    assert place in run.stderr
    assert "'iar' is neither" in run.stderr
    assert "did you mean 'air'?" in run.stderr
    assert not (folder / "wrong.json").exists()


def test_parameter_named_like_an_own_column_is_refused(folder):
    clash = {**AIRY, "expression": "air*q1", "parameters": {"air": 1.0}}
    run = armtrue(*FIT, model_with(folder, "clash.yaml", clash), "--out", "clash.json", cwd=folder)
    assert run.returncode == 2
    assert "parameters.air: found the name of a" in run.stderr


def test_export_leaves_out_what_reads_an_own_column_and_says_its_size(folder):
    run = armtrue("export", "airy.json", "--out", "airy.bin", "--json", "e.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    run_plain = armtrue("export", "plain.json", "--out", "plain.bin", cwd=folder)
    assert run_plain.returncode == 0, run_plain.stderr
    (left,) = json.loads((folder / "e.json").read_text())["stays_behind"].items()
    assert left[0] == "custom.airy"
    assert "column air is nothing that a device knows" in left[1]["why"]
    # Half a unit of air, and the reach from joint 5 to the tool point.
    assert 10.0 < left[1]["effect_um"] < 150.0
    assert f"{left[1]['effect_um']:.1f} µm" in " ".join(run.stdout.split())
    run = armtrue("compensate", "airy.bin", "bare.csv", "--out", "c.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "air" not in run.stderr


@pytest.mark.full
def test_a_column_that_stays_out_of_tables_is_taken_at_its_average(folder):
    """Otherwise the zero that the fit gives a joint beside the term would be exported without it."""
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
def test_sizes_of_several_custom_effects_are_each_its_own(folder):
    small = {**AIRY, "name": "small", "coordinate": "link1.tx", "expression": "1e-3*sin(3*q1)*air"}
    run = armtrue(*FIT, model_with(folder, "two.yaml", AIRY, small), "--out", "two.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    armtrue("export", "two.json", "--out", "two.bin", "--json", "two-e.json", cwd=folder)
    two = json.loads((folder / "two-e.json").read_text())["stays_behind"]
    alone = json.loads((folder / "airy.json").read_text())["effects_move_um"]["custom.airy"]
    assert two["custom.airy"]["effect_um"] == pytest.approx(alone, rel=0.1)
    assert two["custom.small"]["effect_um"] < 0.5 * alone


@pytest.mark.full
def test_workbench_opens_and_adds_a_custom_effect_of_an_own_column(folder, tmp_path, monkeypatch):
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
    """A session over which the tracker sinks."""
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
    """Fit the creep as a custom effect, export it, and return what export says."""
    run = armtrue(
        *FIT, model_with(folder, "creep.yaml", {**CREEP, **more}), "--out", "creep.json", cwd=folder
    )
    assert run.returncode == 0, run.stderr
    assert parameter(folder / "creep.json", "custom.creep") == pytest.approx(RATE, rel=0.3)
    run = armtrue("export", "creep.json", "--out", "creep.bin", "--json", "e.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    return json.loads((folder / "e.json").read_text())


def corrections_change_with_time(folder: Path) -> bool:
    """True where the table asks for other joints a day later."""
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
def test_export_leaves_out_a_custom_effect_of_time_and_says_its_size(creeping):
    said = exported(creeping)
    (left,) = said["stays_behind"].items()
    assert left[0] == "custom.creep"
    assert "it reads time" in left[1]["why"]
    assert "measurement: false" in left[1]["why"]
    assert 10.0 < left[1]["effect_um"] < 200.0
    assert not corrections_change_with_time(creeping)


@pytest.mark.full
def test_export_takes_a_custom_effect_of_time_that_is_said_to_be_the_arms(creeping):
    assert exported(creeping, measurement=False)["stays_behind"] == {}
    assert corrections_change_with_time(creeping)


@pytest.mark.full
def test_export_leaves_a_custom_effect_of_the_measurement_to_it(creeping):
    said = exported(creeping, measurement=True)
    assert said["stays_behind"] == {}
    assert any("belongs to the measurement" in note and "custom.creep" in note for note in said["notes"])
