"""Mistakes of users: an edited fit.json, an output that is also an input, a mistyped command or option."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armtrue import Fit, InputError
from armtrue.cli.conftest import armtrue
from armtrue.verdicts import verdict_words


def refused(*arguments: str, cwd: Path) -> str:
    """Run a command that must end with status 2 and change no file; return its one-line message."""
    before = {path: path.read_bytes() for path in cwd.iterdir() if path.is_file()}
    run = armtrue(*arguments, cwd=cwd)
    assert run.returncode == 2, run.stdout + run.stderr
    assert len(run.stderr.strip().splitlines()) == 1, run.stderr
    assert {path: path.read_bytes() for path in cwd.iterdir() if path.is_file()} == before
    return run.stderr


@pytest.mark.parametrize(
    ("keys", "value", "named"),
    [
        (["parameters", 0, "value"], "x", "parameters[1].value: found 'x'"),
        (["parameters", 9, "value"], float("nan"), "parameters[10].value: found nan"),
        (["parameters"], None, "parameters: found None"),
        (
            ["parameters", 0, "terms", 0, "coordinate"],
            "motor9",
            "parameters[1].terms[1].coordinate: found 'motor9'",
        ),
        (
            ["parameters", 0, "terms", 0, "expression"],
            "sin(q9)",
            "parameters[1].terms[1].expression: found 'sin(q9)'",
        ),
        (["robot"], {}, "robot.kinematics"),
        (["robot", "kinematics", "joints", 1, "alpha"], 90.0, "robot.kinematics.joints[2].alpha: found 90.0"),
        (["measuring_from_base"], "x", "measuring_from_base: found 'x'"),
        (["flange_from_tool"], {}, "flange_from_tool: found {}"),
        (["model", "effects", 0], {"effect": "zzz"}, "model.effects[1]: effect: found 'zzz'"),
        (["options"], 5, "options: found 5"),
        (["data"], None, "data: found None"),
        (["data", "sha256"], None, "data.sha256: found None"),
        (["noise"], [], "noise: found []"),
    ],
)
def test_edited_fit_is_refused_with_the_key_at_fault(folder, tmp_path, keys, value, named):
    document = json.loads((folder / "fit.json").read_text())
    place = document
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    (tmp_path / "edited.json").write_text(json.dumps(document))
    with pytest.raises(InputError) as refusal:
        Fit.load(tmp_path / "edited.json")
    assert f"edited.json: {named}" in str(refusal.value)


def test_export_refuses_a_fit_with_a_nan_parameter(folder):
    document = json.loads((folder / "fit.json").read_text())
    next(p for p in document["parameters"] if p["exported"])["value"] = float("nan")
    (folder / "edited.json").write_text(json.dumps(document))
    assert "expected a finite number" in refused("export", "edited.json", "--out", "edited.bin", cwd=folder)


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("fit data.csv --robot robot.yaml --model model.yaml --out data.csv", "data.csv"),
        ("fit data.csv --robot robot.yaml --model model.yaml --out ./robot.yaml", "robot.yaml"),
        ("fit data.csv --robot robot.yaml --model model.yaml --out f.json --json f.json", "f.json"),
        ("check data.csv --robot robot.yaml --json data.csv", "data.csv"),
        ("add fit.json backlash --joints 2 --out data.csv", "data.csv"),
        ("predict fit.json data.csv --out data.csv", "data.csv"),
        ("predict fit.json data.csv --out fit.json", "fit.json"),
        ("diagnose fit.json --json fit.json", "fit.json"),
        ("refine fit.json --out data.csv", "data.csv"),
        ("refine fit.json --out b.json --json b.json", "b.json"),
        ("report fit.json --out fit.json", "fit.json"),
        ("report fit.json --out data.csv", "data.csv"),
        ("export fit.json --out fit.json", "fit.json"),
    ],
)
def test_commands_refuse_to_overwrite_their_inputs(folder, command, named):
    sentence = refused(*command.split(), cwd=folder)
    assert named in sentence
    assert "expected one" in sentence


def test_compensate_refuses_to_overwrite_table_or_poses(folder):
    assert armtrue("export", "fit.json", "--out", "kept.bin", cwd=folder).returncode == 0
    for out in ("kept.bin", "kept.bin.fit.json", "data.csv"):
        assert out in refused("compensate", "kept.bin", "data.csv", "--out", out, cwd=folder)


def test_export_writes_nothing_if_it_cannot_write_its_fit_copy(folder):
    (folder / "half.bin.fit.json").mkdir()
    assert "half.bin.fit.json" in refused("export", "fit.json", "--out", "half.bin", cwd=folder)


def test_add_may_overwrite_the_fit_that_it_reads(folder, tmp_path):
    (tmp_path / "fit.json").write_bytes((folder / "fit.json").read_bytes())
    run = armtrue("add", "fit.json", "backlash", "--joints", "2", "--out", "fit.json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert Fit.load(tmp_path / "fit.json").effects[-1]["effect"] == "backlash"


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("diagnos fit.json", "'diagnos'"),
        ("fit data.csv --robot robot.yaml", "'--model'"),
        ("predict fit.json data.csv --out p.csv --engine fixed", "--engine"),
        ("compensate kept.bin data.csv --engine float --out c.csv", "'float'"),
    ],
)
def test_command_line_mistake_is_refused_in_one_sentence(folder, command, named):
    assert named in refused(*command.split(), cwd=folder)


def test_predict_names_a_missing_column_that_the_fit_reads(folder):
    header, *rows = (folder / "data.csv").read_text().splitlines()
    kept = [i for i, name in enumerate(header.split(",")) if name != "payload"]
    assert len(kept) < len(header.split(","))
    lines = [",".join(line.split(",")[i] for i in kept) for line in (header, *rows)]
    (folder / "empty.csv").write_text("\n".join(lines) + "\n")
    said = refused("predict", "fit.json", "empty.csv", "--out", "empty_out.csv", cwd=folder)
    assert "empty.csv: column payload is missing" in said
    assert not (folder / "empty_out.csv").exists()
    run = armtrue("predict", "fit.json", "data.csv", "--out", "full_out.csv", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "payload" not in run.stdout
    assert run.stdout.startswith("error against the x, y, z of data.csv: mean")


def test_verdict_says_noise_only_if_the_noise_floor_is_known():
    known = {"verdict": "nothing_missing", "noise_floor_um": 10.0}
    assert verdict_words(known) == "Nothing is missing: what is left is noise."
    assert "not known" in verdict_words({**known, "noise_floor_um": None})


@pytest.mark.parametrize(
    ("train_um", "held_out_um", "is_noise"),
    [(14.0, 19.0, True), (16.0, 19.0, False), (9.0, 21.0, False), (None, None, True)],
)
def test_verdict_says_more_than_noise_well_above_the_floor(train_um, held_out_um, is_noise):
    error = {"train": {"mean_um": train_um}, "held_out": {"mean_um": held_out_um}}
    words = verdict_words({"verdict": "nothing_missing", "noise_floor_um": 10.0, "error": error})
    assert words.endswith("more than noise.") is not is_noise
