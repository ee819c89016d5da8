"""Results of diagnose and refine: the documented JSON, with attributes for the main entries."""

from __future__ import annotations

import json
import re

import armtrue_sim
import pytest

from armtrue import Diagnosis, Fit, Refinement, diagnose, fit, load_data, load_model, load_robot, plan, refine
from armtrue.checking import Finding
from armtrue.checking.report import CheckReport

SCENARIO = {"arm": "kr30", "seed": 2, "hidden": [{"effect": "gear_harmonics", "joints": [3], "scale": 2.5}]}


@pytest.fixture(scope="module")
def believed(tmp_path_factory) -> Fit:
    folder = tmp_path_factory.mktemp("diagnosis")
    armtrue_sim.simulate(SCENARIO).write(folder)
    robot = load_robot(folder / "robot.yaml")
    return fit(load_data(folder / "data.csv", robot), robot, load_model(folder / "model.yaml", robot))


def test_diagnosis_is_its_json_with_attributes_and_a_summary(believed):
    found = diagnose(believed)
    assert isinstance(found, Diagnosis)
    assert json.loads(json.dumps(found)) == found
    assert found.verdict == found["verdict"] == "missing_effect"
    assert found.recommended is not None
    assert (found.recommended["effect"], found.recommended["joints"]) == ("gear_harmonics", [3])
    assert found.candidates == found["candidates"]
    lines = str(found).splitlines()
    assert lines[0] == "An effect is missing."
    assert lines[1].startswith("gear_harmonics 3: probability ")
    assert lines[2:] == [f"– {sentence}" for sentence in found.advice]


def test_steps_of_a_refinement_are_diagnoses(believed):
    seen = []
    best, story = refine(believed, on_step=lambda _, step: seen.append(step))
    assert isinstance(story, Refinement)
    assert [type(step) for step in seen] == [Diagnosis] * len(story.steps)
    assert story.steps[-1].verdict == "nothing_missing"
    assert story.steps[-1].recommended is None
    assert story.effects == best.effects
    assert "as it stood" in str(story).splitlines()[0]
    assert str(story).splitlines()[1].endswith("+ gear_harmonics 3")


def test_notebook_shows_base_and_tool_of_a_fit_as_the_terminal_does(believed):
    shown = believed._repr_html_()
    base = believed.document["measuring_from_base"]["xyz"][0]
    assert f"<td>base in the measuring frame</td><td>{1000 * base:.3f}</td>" in shown
    assert "base_frame." not in shown


def test_objects_of_a_notebook_are_shown_in_a_few_words(believed):
    planned = plan(believed, 4)
    shown = [repr(believed.robot), repr(believed.data), repr(planned)]
    assert shown[0].endswith(": 6 joints")
    assert re.match(r"data\.csv: \d+ measurements of q1, q2, ", shown[1])
    assert shown[2].startswith("4 poses of q1, q2, ")
    assert max(map(len, shown)) < 800


def test_printed_findings_end_their_sentence_before_the_remedy():
    finding = Finding("a_code", "note", "a joint that slides", remedy="Record it.")
    assert "a joint that slides. Record it." in str(CheckReport.of([finding]))
