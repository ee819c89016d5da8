"""Unexplained structure: the curves that are drawn, compared with the simulated dependence."""

from __future__ import annotations

import numpy as np
import pytest

from armtrue import Fit
from armtrue.report.gathered.state import axis_of, state_variable
from armtrue.report.gathered.structure import coordinate_words, findings_of
from armtrue.report.page import page

ARCSECOND = np.pi / 648000.0


def test_dependence_on_two_variables_has_three_curves(heated):
    finding = next(f for f in heated.diagnoses[0].findings if f.entry["variable"] == "q1*dT_arm")
    assert finding.over == "joint 1 [°]"
    assert finding.along == "joint 2 [″]"
    assert finding.by == "temperature arm above its reference"
    assert len(finding.parts) == 3
    assert [part.label.endswith(" K") for part in finding.parts] == [True] * 3
    slopes = [np.polyfit(part.means.centre, part.means.mean, 1)[0] for part in finding.parts]
    # Cold, the error is flat over joint 1; warm, it changes by tens of arcseconds from one side to the other.
    assert abs(slopes[0]) < 0.3 * slopes[2]
    assert slopes[2] * 250.0 > 20.0
    rows = heated.last.fit.data.count
    heat = state_variable(heated.last.fit, "dT_arm").values
    low, high = (float(word) for word in finding.parts[1].label[:-2].replace("−", "-").split(" to "))
    assert np.sum((heat > low) & (heat < high)) == pytest.approx(rows / 3, abs=0.05 * rows)


def test_page_names_every_curve_of_a_two_variable_panel(heated):
    text = page(heated)
    text = text[text.index('<section id="unexplained"') : text.index('<section id="parameters"')]
    finding = next(f for f in heated.diagnoses[0].findings if f.parts)
    for part in finding.parts:
        assert part.label in text
    assert "on joint 2" in text
    assert "joint 2 [″]" in text


def test_duplicate_dependence_is_listed_once_per_coordinate(report):
    step = report.first
    entry = {
        "variable": "payload",
        "variables": ["payload"],
        "joints": [],
        "coordinate": "base.rz",
        "log10_p": -20.0,
        "shape": "rises",
        "curve": {"x": [0.0, 8.0, 16.0], "y": [0.0, 10.0 * ARCSECOND, 30.0 * ARCSECOND]},
    }
    other = {**entry, "coordinate": "motor1"}
    found = findings_of(step, {"unexplained": [entry, dict(entry), other]})
    assert [finding.entry["coordinate"] for finding in found] == ["base.rz", "motor1"]
    assert found[0].over == "payload [kg]"
    assert found[0].y == pytest.approx([0.0, 10.0, 30.0])


def test_dependence_on_nothing_recorded_is_not_drawn(report):
    entry = {"variable": "none recorded", "variables": [], "joints": [], "log10_p": -9.0, "shape": "scatter"}
    (found,) = findings_of(report.first, {"unexplained": [entry]})
    assert not found.drawn
    assert found.where == ""


def test_variables_have_readable_units(report):
    fit: Fit = report.last.fit
    names = ("q2", "payload", "time", "dir3", "dT_arm", "tau3")
    units = [axis_of(fit, name)[1] for name in names]
    assert units == ["°", "kg", "h", "", "K", "Nm"]
    assert state_variable(fit, "time").values.min() == 0.0
    assert state_variable(fit, "q2").values == pytest.approx(np.degrees(fit.data.columns["q2"]))


def test_coordinates_are_named_in_words():
    words = [coordinate_words(name) for name in ("motor3", "base.rz", "link12.tx")]
    assert words == ["joint 3", "base, turn about z", "link 12, shift along x"]
