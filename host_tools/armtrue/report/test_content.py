"""The content of a report compared with the simulated arm."""

from __future__ import annotations

import re
from dataclasses import replace

import armtrue_sim
import numpy as np
import pytest

from armtrue import Fit, InputError, _core, refine
from armtrue.report import gather
from armtrue.report.conftest import fitted
from armtrue.report.content import _independent, added_variable
from armtrue.report.gathered.state import independent, turned_by
from armtrue.report.page import page
from armtrue.report.sections.diagnosis_sections import added_variable_section

# Orientations as well as positions, and an eccentric gear on the wrist that hardly moves the reflector.
ORIENTED = {
    "arm": "cobot",
    "seed": 3,
    "instrument": {"sigma": 9e-6, "orientation": 2e-5},
    "columns": {"add": ["orientation"]},
    "hidden": [{"effect": "gear_harmonics", "joints": [6]}],
}
ARCSECOND = np.pi / 648000.0


def test_steps_name_their_added_effects_and_the_error_falls(report):
    between = report.steps[1]
    assert [step.title for step in report.steps] == ["believed", f"+ {between.added[0]}", "refined"]
    for number, step in enumerate(report.steps, start=1):
        did = ", ".join(f"+ {effect}" for effect in step.added) or "believed"
        assert step.called == f"step {number}: {did}"
    added = [effect for step in report.steps for effect in step.added]
    assert sorted(added) == ["backlash 2", "gear_harmonics 3"]
    means = [step.error["held_out"]["mean_um"] for step in report.steps]
    assert means[0] > means[1] > means[2]
    assert means[2] < 1.5 * report.last.noise_floor_um


def test_variables_include_recorded_and_derived_ones(report):
    names = {variable.name for variable in report.variables}
    joints = range(1, 7)
    recorded = {f"q{k}" for k in joints} | {f"dir{k}" for k in joints} | {"temp_arm", "payload", "time"}
    assert recorded | {"x", "y", "z", "tau2", "tau3", "bmx", "gmx4"} <= names
    by_name = {variable.name: variable for variable in report.variables}
    assert by_name["q2"].values == pytest.approx(np.degrees(report.last.fit.data.columns["q2"]))


@pytest.mark.parametrize("joint", [1, 3, 5])
def test_error_of_one_joint_is_read_as_its_angle(report, joint):
    """The residual predicted for a motor that turns by 10″ reads as 10″ along its joint."""
    fit = report.last.fit
    data = fit.data
    moved = dict(data.columns)
    moved[f"q{joint}"] = moved[f"q{joint}"] + 10.0 * ARCSECOND
    change = fit.predict(type(data)(data.path, data.file, moved, data.rows, data.labels)) - fit.predict(data)
    direction = next(d for d in report.directions if d.name == f"motor{joint}")
    assert direction.unit == "″"
    read = direction.read(change)[direction.drawn]
    assert np.median(read) == pytest.approx(10.0, rel=2e-3)
    assert np.percentile(np.abs(read - 10.0), 95) < 0.1


@pytest.mark.full
def test_joint_with_the_reflector_on_its_axis_is_left_out(report, monkeypatch):
    column = _core.coordinate_column

    def on_axis_6(fit, name):
        return column(fit, name) * (1e-3 if name == "motor6" else 1.0)

    monkeypatch.setattr(_core, "coordinate_column", on_axis_6)
    made = gather([replace(report.last.fit)])
    assert list(made.tiny_levers) == [6]
    assert "motor6" not in {direction.name for direction in made.directions}
    assert "motor6" not in {view.direction.name for view in made.telling_views()}
    assert f"joint 6, whose axis runs {1e3 * made.tiny_levers[6]:.1f} mm beside the reflector" in page(made)


def test_all_joints_with_a_lever_arm_are_shown(report):
    assert report.tiny_levers == {}
    assert {f"motor{k}" for k in range(1, 7)} <= {direction.name for direction in report.directions}


def test_views_show_missing_effects_before_and_not_after(report):
    telling = {view.variable.name: view for view in report.telling_views()}
    for name in ("q3", "dir2"):
        assert telling[name].first.trend
        assert not telling[name].last.trend
    assert telling["dir2"].direction.name == "motor2"


def test_added_variable_plot_of_the_best_candidate_has_slope_one(report):
    first = report.diagnoses[0]
    best = first.added_variables[0]
    assert best.candidate["recommend"]
    slope = float(best.added @ best.left) / float(best.added @ best.added)
    assert slope == pytest.approx(1.0, abs=0.05)
    assert best.explained == pytest.approx(best.candidate["explained"], abs=0.2)
    assert best.unit == "µm"
    assert not best.turned.any()


def test_candidate_that_the_model_can_absorb_is_not_drawn(report):
    first, *others = report.diagnoses
    scale = {**first.result["candidates"][0], "effect": "tracker_scale", "joints": [], "options": {}}
    scale["recommend"] = False
    plot = added_variable(first.step.fit, scale)
    assert plot.adds_nothing
    with_it = replace(first, added_variables=[plot, *first.added_variables])
    drawn = added_variable_section(replace(report, diagnoses=[with_it, *others]))
    figure = re.search(r"<figure><h3>tracker_scale, after step 1</h3>(.*?)</figure>", drawn, re.DOTALL)[1]
    assert "it adds nothing: the model can take over all that it does" in figure
    assert "<svg" not in figure
    assert drawn.count("<svg") > 1


@pytest.mark.full
def test_added_variables_weigh_orientations_like_the_table(tmp_path):
    """With the reflector nearly on axis 6, an error of joint 6 shows in the measured orientations alone."""
    made = fitted(tmp_path, ORIENTED)
    (diagnosis,) = gather([made]).diagnoses
    best = diagnosis.added_variables[0]
    assert best.name == "gear_harmonics 6"
    assert best.unit == "σ"
    assert best.turned.sum() == best.turned.size / 2
    assert best.explained == pytest.approx(best.candidate["explained"], abs=0.02)
    positions = ~best.turned
    left, after = best.left[positions], (best.left - best.added)[positions]
    assert 1.0 - float(after @ after) / float(left @ left) < 0.5 * best.explained


def test_added_variables_of_noise_explain_nothing(report):
    assert all(plot.explained < 0.05 for plot in report.diagnoses[-1].added_variables)


def test_spectra_cover_all_joints_and_show_the_eccentric_gear(report):
    spectra = {spectrum.joint: spectrum for spectrum in report.diagnoses[0].spectra}
    assert sorted(spectra) == list(range(1, 7))
    # The joint swings through half a turn: lines are two cycles wide.
    assert spectra[3].cycles[np.argmax(spectra[3].explained)] < 4.0
    assert not report.diagnoses[-1].spectra[2].peaks


def test_readings_along_one_direction_count_once_per_pose(report):
    fit = report.last.fit
    count = fit.data.count
    visit = np.arange(count)
    lever = np.asarray(_core.coordinate_column(fit.core, "motor1"))
    rng = np.random.default_rng(7)
    anywhere = rng.normal(0.0, 1e-5, (count, 3))
    along_it = lever / np.linalg.norm(lever, axis=1, keepdims=True) * rng.normal(0.0, 1e-5, (count, 1))
    assert independent(anywhere, lever, visit) == pytest.approx(3 * count, rel=0.25)
    once = independent(along_it, lever, visit)
    assert once == pytest.approx(count, rel=0.25)
    # Three reflectors that see the same joint error count as one reading.
    thrice = [np.repeat(values, 3, axis=0) for values in (along_it, lever, visit)]
    assert independent(*thrice) == pytest.approx(once)


def test_rows_of_one_named_reflector_count_like_rows_without_a_name(report, monkeypatch):
    step = report.last
    unnamed = _independent(step, 3, report.directions)
    monkeypatch.setitem(step.fit.data.columns, "target", np.zeros(step.fit.data.count))
    assert _independent(step, 3, report.directions) == pytest.approx(unnamed, rel=0.1)


def test_rotation_of_the_tool_per_motor_matches_the_simulation(tmp_path):
    """By the coupling, link 3 keeps its attitude while motor 2 moves: motors turn other links than without it."""
    made = fitted(tmp_path, {"arm": "irb2400", "seed": 1, "poses": 40, "payloads": [0.0]})
    arm = armtrue_sim.simulate({"arm": "irb2400", "seed": 1, "poses": 40, "payloads": [0.0]}).arm
    joints, small = made.data.joints, 1e-4
    before, _ = arm.true_pose(joints, made.data.columns)
    for number in range(1, 7):
        after, _ = arm.true_pose(joints + small * np.eye(6)[number - 1], made.data.columns)
        turn = after @ before.transpose(0, 2, 1)
        axis = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1) / small
        assert turned_by(made, number) == pytest.approx(axis, abs=0.02)


@pytest.mark.full
def test_orientation_errors_are_listed_beside_position_errors(tmp_path):
    made = fitted(tmp_path, {**ORIENTED, "hidden": []})
    report = gather([made])
    error = report.last.fit.orientation_error()
    # Three normal errors of 20 µrad have a mean length of 1.6 times that; the fit and the drives add little.
    assert error["mean"] == pytest.approx(1.6 * 2e-5, rel=0.15)
    assert error["mean"] < error["rms"] < error["p95"] < error["max"]
    text = page(report)
    assert "Error of orientation at each step, training poses [″]" in text
    assert f"{error['mean'] / ARCSECOND:.1f}</td>" in text
    assert re.search(r"orientation \d+\.\d″ about each axis", text)


def test_orientations_are_omitted_if_none_were_measured(report):
    assert report.last.fit.orientation_error() is None
    assert "rientation" not in page(report).split("<main>")[1].split("<script")[0]


@pytest.mark.full
def test_gross_errors_give_no_peaks_in_spectra(tmp_path):
    made = fitted(tmp_path, {**ORIENTED, "hidden": [], "gross_errors": {"count": 3, "size": [0.002, 0.004]}})
    assert len(made.document["rejected"]) == 3
    spectra = gather([made]).diagnoses[0].spectra
    assert len(spectra) == 6
    assert not [peak for spectrum in spectra for peak in spectrum.peaks]
    # The share that one line must explain if the six readings of a pose are independent.
    assert [spectrum.significant for spectrum in spectra] == pytest.approx([0.02] * 6, rel=0.4)


def test_page_on_twelve_poses_states_that_these_are_too_few(tmp_path):
    few = {"arm": "kr30", "seed": 6, "poses": 12, "repeats": {}, "hidden": []}
    believed = fitted(tmp_path, {**few, "believed": ["base_frame", "tool_offset", "joint_offset"]})
    report = gather([believed, believed])
    assert not any(view.last.tells for view in report.telling_views())
    text = page(report)
    assert "first step: too few poses; last: too few poses." in text.lower()
    assert "nothing left</span>" not in text


@pytest.mark.full
def test_unsaved_given_fits_are_not_called_fitted_for_the_report(fits):
    given = [replace(fit, path=None, document={**fit.document}) for fit in fits]
    made = gather(given)
    assert [step.title for step in made.steps][::2] == ["fit 1", "fit 2"]
    assert [step.given for step in made.steps] == [True, False, True]
    assert [step.title for step in gather(given, names=["before", "after"]).steps][::2] == ["before", "after"]
    text = page(gather([given[0]]))
    assert "were fitted for this report" not in text
    assert "not saved" in text


def test_names_must_be_as_many_as_fits(fits):
    with pytest.raises(InputError, match="found 1 names for 2 fits"):
        gather(fits, names=["only"])


@pytest.mark.full
def test_every_step_of_a_refinement_can_be_shown(fits):
    """One step for each added effect: no intermediate fits are made, and each effect is added once."""
    seen: list[Fit] = []
    refine(fits[0], on_step=lambda fit, _: seen.append(fit))
    made = gather(seen)
    assert len(made.steps) == len(seen) == 3
    assert all(step.given for step in made.steps)
    assert sorted(effect for step in made.steps for effect in step.added) == [
        "backlash 2",
        "gear_harmonics 3",
    ]
    assert "fitted again" not in page(made)


@pytest.mark.full
def test_step_without_changed_effects_says_fitted_again(fits):
    assert "the same effects, fitted again" in page(gather([fits[1], fits[1]]))
