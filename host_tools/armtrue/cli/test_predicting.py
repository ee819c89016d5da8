"""`armtrue remove`, `compare`, and error and uncertainty of `predict`, on a simulated arm."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from armtrue.cli.conftest import armtrue


def table(path):
    return np.genfromtxt(path, delimiter=",", names=True)


def shifted(folder, name, **shifts_m):
    """test.csv with some columns shifted, as a new file `name`."""
    header = (folder / "test.csv").read_text().splitlines()[0]
    rows = np.genfromtxt(folder / "test.csv", delimiter=",", skip_header=1)
    for column, shift in shifts_m.items():
        rows[:, header.split(",").index(column)] += shift
    np.savetxt(folder / name, rows, delimiter=",", header=header, comments="", fmt="%.10g")
    return name


def test_remove_reverses_add(folder):
    added = armtrue("add", "fit.json", "gear_harmonics", "--joints", "3,4", "--out", "two.json", cwd=folder)
    assert added.returncode == 0, added.stderr
    run = armtrue("remove", "two.json", "gear_harmonics", "--joints", "4", "--out", "one.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    assert "before, held-out poses" in run.stdout
    one = json.loads((folder / "one.json").read_text())
    assert one["model"]["effects"][-1] == {"effect": "gear_harmonics", "joints": [3]}
    armtrue("remove", "one.json", "gear_harmonics", "--out", "none.json", "--json", "none-f.json", cwd=folder)
    before = json.loads((folder / "fit.json").read_text())
    after = json.loads((folder / "none.json").read_text())
    assert after["model"]["effects"] == before["model"]["effects"]
    assert after["error"]["train"]["mean_um"] == pytest.approx(before["error"]["train"]["mean_um"], rel=1e-6)
    figures = json.loads((folder / "none-f.json").read_text())
    assert figures["before"]["held_out"]["mean_um"] < figures["error"]["held_out"]["mean_um"]


def test_remove_with_options_removes_only_the_matching_entry(folder):
    source = "fit.json"
    for order in (1, 2):
        words = ["gear_mesh", "--joints", "4", "--option", f"orders=[{order}]", "--out", "waves.json"]
        added = armtrue("add", source, *words, cwd=folder)
        assert added.returncode == 0, added.stderr
        source = "waves.json"
    words = ["gear_mesh", "--joints", "4", "--option"]
    run = armtrue("remove", source, *words, "orders=[1]", "--out", "second.json", cwd=folder)
    assert run.returncode == 0, run.stderr
    effects = json.loads((folder / "second.json").read_text())["model"]["effects"]
    assert [entry["orders"] for entry in effects if entry["effect"] == "gear_mesh"] == [[2]]
    run = armtrue("remove", source, *words, "orders=[9]", "--out", "none.json", cwd=folder)
    assert run.returncode == 2
    assert (
        "found orders=[9], expected options of gear_mesh in the model: orders=[1.0]; orders=[2.0]"
        in run.stderr
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["joint_complience"], "did you mean 'joint_compliance'"),
        (["backlash"], "found no effect 'backlash'"),
        (["joint_compliance", "--joints", "5"], "expected joints of joint_compliance in the model: 2, 3"),
    ],
)
def test_remove_refuses_an_effect_that_the_model_lacks(folder, arguments, words):
    run = armtrue("remove", "fit.json", *arguments, "--out", "refused.json", cwd=folder)
    assert run.returncode == 2
    assert words in run.stderr
    assert not (folder / "refused.json").exists()


def test_compare_verdict_for_the_unchanged_arm_is_as_expected(folder):
    run = armtrue("compare", "fit.json", "test.csv", "--json", "c.json", cwd=folder)
    assert run.returncode == 0, run.stdout + run.stderr
    found = json.loads((folder / "c.json").read_text())
    fit = json.loads((folder / "fit.json").read_text())
    assert found["verdict"] == "as_expected"
    assert found["expected_mean_um"] == fit["error"]["held_out"]["mean_um"]
    errors = [row["error_um"] for row in found["rows"]]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] == pytest.approx(found["error"]["max_um"])


def test_compare_verdict_for_a_changed_arm_is_worse(folder):
    shifted(folder, "crashed.csv", q3=2e-3)
    run = armtrue("compare", "fit.json", "crashed.csv", "--json", "-", cwd=folder)
    assert run.returncode == 1
    found = json.loads(run.stdout)
    assert found["verdict"] == "worse"
    assert found["error"]["mean_um"] > 5 * found["expected_mean_um"]
    words = armtrue("compare", "fit.json", "crashed.csv", cwd=folder).stdout
    assert "Worse than expected" in words
    assert "instrument were moved" not in words


def test_compare_tells_a_moved_tracker_from_a_changed_arm(folder):
    shifted(folder, "elsewhere.csv", x=0.003, z=-0.002)
    run = armtrue("compare", "fit.json", "elsewhere.csv", cwd=folder)
    assert run.returncode == 1
    assert "base or instrument were moved" in " ".join(run.stdout.split())


def drifting(folder, name, rate_m_per_h, seconds):
    """Write test.csv `seconds` later as `name`, and drifts.json: a fit whose base drifts by `rate_m_per_h` along x."""
    fit = json.loads((folder / "fit.json").read_text())
    term = {"coordinate": "base.tx", "expression": "time/3600", "weight": 1.0, "table": None}
    parameter = {**fit["parameters"][0], "effect": "time_drift", "name": "time_drift.tx", "terms": [term]}
    fit["parameters"].append({**parameter, "value": rate_m_per_h})
    fit["model"]["effects"].append({"effect": "time_drift"})
    fit["columns"]["time"] = ""
    (folder / "drifts.json").write_text(json.dumps(fit))
    return shifted(folder, name, time=seconds)


def test_compare_tells_extrapolated_drift_from_a_moved_tracker(folder):
    hours = 500
    later = drifting(folder, "later.csv", 2e-6, 3600.0 * hours)
    run = armtrue("compare", "drifts.json", later, "--json", "c.json", cwd=folder)
    assert run.returncode == 1, run.stdout + run.stderr
    words = " ".join(run.stdout.split())
    assert "outside what was fitted (time by up to" in words
    assert "the fit extrapolates time by up to 500.0 h, 301.3 times the span that was fitted" in words
    assert (
        "(read by time_drift): with the nearest value that was fitted in its place the mean error is" in words
    )
    assert "may be the fit's own extrapolation" in words
    assert "instrument were moved" not in words
    # A tracker moved by far more than any drift is still reported.
    moved = shifted(folder, "moved.csv", time=3600.0 * hours, x=1.5, y=-0.3)
    words = " ".join(armtrue("compare", "drifts.json", moved, cwd=folder).stdout.split())
    assert "base or instrument were moved" in words
    poses = armtrue("predict", "drifts.json", later, "--out", "p.csv", cwd=folder)
    assert "outside what was fitted (time by up to" in " ".join(poses.stdout.split())


@pytest.mark.parametrize(
    ("shifts", "way", "words"),
    [
        ({"time": 1e6}, "time", "held out of the fit one stretch of time after another"),
        ({"q6": 6.283185307}, "region", "held out of the fit region by region"),
        ({}, "random", "held out of the fit:"),
    ],
)
def test_compare_expects_the_held_out_error_of_the_matching_split(folder, shifts, way, words):
    fit = json.loads((folder / "fit.json").read_text())
    for factor, name in enumerate(("region", "time"), start=2):
        fit["error"]["held_out_by"][name] = {
            key: value * (1.0 if key == "n" else factor) for key, value in fit["error"]["held_out"].items()
        }
    (folder / "ways.json").write_text(json.dumps(fit))
    shifted(folder, "other.csv", **shifts)
    run = armtrue("compare", "ways.json", "other.csv", "--json", "c.json", cwd=folder)
    found = json.loads((folder / "c.json").read_text())
    assert found["expected_by"] == way
    expected = fit["error"]["held_out_by"].get(way, fit["error"]["held_out"])["mean_um"]
    assert found["expected_mean_um"] == pytest.approx(expected)
    assert words in " ".join(run.stdout.split())


def test_compensate_warns_of_extrapolation_like_predict(folder):
    armtrue("export", "fit.json", "--out", "t.bin", cwd=folder)
    far = shifted(folder, "far.csv", q5=1.5)
    words = ("compensate", "t.bin", "--out", "corrected.csv")
    run = armtrue(*words[:2], far, *words[2:], cwd=folder)
    assert run.returncode == 0, run.stderr
    (warning,) = [line for line in run.stderr.splitlines() if "outside what was fitted" in line]
    assert warning.startswith("armtrue: warning: ")
    said = armtrue("predict", "fit.json", far, "--out", "p.csv", cwd=folder).stdout
    assert warning.removeprefix("armtrue: warning: ") in " ".join(said.split())
    # Tables do not contain the drift of the session, so compensate does not extrapolate time.
    later = shifted(folder, "much-later.csv", time=1e7)
    assert "outside" not in armtrue(*words[:2], later, *words[2:], cwd=folder).stderr


def test_predict_says_what_it_wrote(folder):
    run = armtrue("predict", "fit.json", "test.csv", "--out", "said.csv", cwd=folder)
    rows = len((folder / "said.csv").read_text().splitlines()) - 1
    assert f"written: said.csv (x, y, z of {rows} rows)" in run.stdout


def test_predict_prints_the_error_at_measured_poses(folder):
    run = armtrue("predict", "fit.json", "test.csv", "--out", "p.csv", cwd=folder)
    predicted, exact = table(folder / "p.csv"), table(folder / "test.csv")
    apart = np.sqrt(sum((predicted[name] - exact[name]) ** 2 for name in "xyz"))
    assert f"error against the x, y, z of test.csv: mean {1e6 * apart.mean():.1f} µm" in run.stdout


def test_predict_uncertainty_agrees_with_the_actual_errors(folder):
    """With the hidden effect added the model is correct: errors at new poses have the stated covariance."""
    armtrue("add", "fit.json", "gear_harmonics", "--joints", "3", "--out", "right.json", cwd=folder)
    run = armtrue("predict", "right.json", "test.csv", "--out", "p.csv", "--uncertainty", cwd=folder)
    assert run.returncode == 0, run.stderr
    predicted, exact = table(folder / "p.csv"), table(folder / "test.csv")
    assert predicted.dtype.names == ("x", "y", "z", "cxx", "cxy", "cxz", "cyy", "cyz", "czz")
    error = np.column_stack([predicted[name] - exact[name] for name in "xyz"])
    covariance = np.array([[predicted[f"c{min(a, b)}{max(a, b)}"] for b in "xyz"] for a in "xyz"]).transpose(
        2, 0, 1
    )
    distance = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    # Errors of one campaign are correlated: the share within 95 % is far from exact, but the scale is not.
    assert 0.5 < np.median(distance) < 8.0
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


@pytest.mark.parametrize(
    ("verdict", "status", "said"),
    [
        ("unexplained_structure", 0, "predictions err by more"),
        ("missing_effect", 0, "predictions err by more"),
        ("nothing_missing", 0, ""),
        ("all_is_well", 2, "verdict: found 'all_is_well'"),
    ],
)
def test_predict_uncertainty_warns_if_more_than_noise_is_left(folder, tmp_path, verdict, status, said):
    document = json.loads((folder / "fit.json").read_text())
    document["verdict"] = verdict
    (tmp_path / "fit.json").write_text(json.dumps(document))
    run = armtrue(
        "predict",
        str(tmp_path / "fit.json"),
        "test.csv",
        "--out",
        str(tmp_path / "p.csv"),
        "--uncertainty",
        cwd=folder,
    )
    assert run.returncode == status, run.stderr
    text = " ".join((run.stdout + run.stderr).split())
    assert said in text
    assert ("predictions err by more" in text) == bool(said and not status)


def test_predict_uncertainty_reads_moved_measurements_with_data(folder, tmp_path):
    for name in ("fit.json", "test.csv"):
        shutil.copy(folder / name, tmp_path / name)
    shutil.copy(folder / "data.csv", tmp_path / "moved.csv")
    document = json.loads((tmp_path / "fit.json").read_text())
    document["data"]["path"] = str(tmp_path / "data.csv")
    (tmp_path / "fit.json").write_text(json.dumps(document))
    arguments = ("predict", "fit.json", "test.csv", "--out", "p.csv")
    gone = armtrue(*arguments, "--uncertainty", cwd=tmp_path)
    assert gone.returncode == 2
    assert "--data DATA" in gone.stderr
    run = armtrue(*arguments, "--uncertainty", "--data", "moved.csv", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "cxx" in (tmp_path / "p.csv").read_text()
    alone = armtrue(*arguments, "--data", "moved.csv", cwd=tmp_path)
    assert "--data: found it without --uncertainty" in alone.stderr


def test_predict_and_compare_name_the_reflector_they_assume(folder, tmp_path):
    lines = (folder / "data.csv").read_text().splitlines()
    named = [f"{line},{'BA'[at % 2]}" for at, line in enumerate(lines[1:], start=1)]
    (tmp_path / "data.csv").write_text("\n".join([f"{lines[0]},target", *named]))
    for name in ("robot.yaml", "model.yaml", "test.csv"):
        shutil.copy(folder / name, tmp_path / name)
    fit = armtrue("fit", "data.csv", "-r", "robot.yaml", "-m", "model.yaml", "-o", "fit.json", cwd=tmp_path)
    assert fit.returncode == 0, fit.stderr
    expected = (
        "test.csv has no column target: all rows are assumed to be of 'A', the first of the fit's reflectors "
        "A, B"
    )
    for command in (
        ("predict", "fit.json", "test.csv", "--out", "p.csv"),
        ("compare", "fit.json", "test.csv"),
    ):
        run = armtrue(*command, cwd=tmp_path)
        assert expected in " ".join(run.stdout.split()), run.stdout + run.stderr


def test_compare_reports_that_all_rows_were_fitted(folder):
    run = armtrue("compare", "fit.json", "data.csv", "--json", "c.json", cwd=folder)
    assert run.returncode == 0, run.stdout + run.stderr
    found = json.loads((folder / "c.json").read_text())
    assert found["verdict"] == "as_expected"
    assert found["rows_fitted"] == found["error"]["n"]
    said = " ".join(run.stdout.split())
    assert f"all {found['rows_fitted']} rows are among those that were fitted" in said
    assert "As expected" not in said


def test_compare_judges_by_rows_that_were_not_fitted(folder):
    old = (folder / "data.csv").read_text().splitlines()
    shifted(folder, "crashed.csv", q3=2e-3)
    names = (folder / "crashed.csv").read_text().splitlines()[0].split(",")
    new = [
        ",".join(dict(zip(names, line.split(","), strict=True)).get(name, "") for name in old[0].split(","))
        for line in (folder / "crashed.csv").read_text().splitlines()[1:11]
    ]
    (folder / "joined.csv").write_text("\n".join([*old, *new]) + "\n")
    run = armtrue("compare", "fit.json", "joined.csv", "--json", "c.json", cwd=folder)
    found = json.loads((folder / "c.json").read_text())
    assert found["rows_fitted"] == len(old) - 1
    assert found["error"]["n"] == 10
    assert min(row["row"] for row in found["rows"]) > len(old)
    assert (run.returncode, found["verdict"]) == (1, "worse")
    assert f"{len(old) - 1} of {len(old) + 9} rows were fitted and are left out" in " ".join(
        run.stdout.split()
    )


def test_compare_recognises_fitted_rows_without_the_data_file(folder, tmp_path):
    document = json.loads((folder / "fit.json").read_text())
    document["data"] |= {"path": "/nowhere/data.csv", "relative": "gone.csv"}
    (tmp_path / "fit.json").write_text(json.dumps(document))
    shutil.copy(folder / "data.csv", tmp_path / "other-name.csv")
    run = armtrue("compare", "fit.json", "other-name.csv", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "rows are among those that were fitted" in " ".join(run.stdout.split())
