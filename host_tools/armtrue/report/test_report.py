"""The page of a report: complete, self-contained, in order, and exact about its input."""

from __future__ import annotations

import datetime
import hashlib
import re
import shutil
from collections import Counter
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest

from armtrue import Fit, InputError, __version__
from armtrue.report import gather, write
from armtrue.report.conftest import fitted
from armtrue.report.page import page
from armtrue.report.sections.diagnosis_sections import _ambiguity
from armtrue.report.sections.error_section import error_section

SECTIONS = [
    "error",
    "vectors",
    "state",
    "spectra",
    "candidates",
    "added",
    "effects",
    "parameters",
    "unobservable",
    "rejected",
    "coverage",
    "about",
    "glossary",
]
VOID = {"br", "hr", "input", "meta"}


class Reader(HTMLParser):
    """Records the elements of a page and checks that they close in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.headings: list[int] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        if re.fullmatch(r"h[1-6]", tag):
            self.headings.append(int(tag[1]))
        for name, value in attrs:
            self.attributes.append((tag, name, value or ""))
            if name == "id":
                self.ids.append(value or "")
            if name == "href":
                self.links.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)


@pytest.fixture(scope="module")
def text(report) -> str:
    return page(report)


@pytest.fixture(scope="module")
def read(text: str) -> Reader:
    return Reader(text)


def test_elements_close_in_order_and_ids_are_unique(read):
    assert read.open == []
    assert Counter(read.ids).most_common(1)[0][1] == 1


def test_sections_are_in_order_and_linked(read):
    assert [name for name in read.ids if name in SECTIONS] == SECTIONS
    assert {link.removeprefix("#") for link in read.links} == set(SECTIONS)


def test_marks_and_ticks_of_the_error_lie_on_their_track(text):
    section = re.search(r'<section id="error".*?</section>', text, re.DOTALL)[0]
    places = [float(place) for place in re.findall(r"left:([^%]+)%", section)]
    assert len(places) > 16
    assert 0.0 <= min(places) < 20.0
    assert 80.0 < max(places) <= 100.0


def test_headings_skip_no_level(read):
    assert read.headings[0] == 1
    assert read.headings.count(1) == 1
    for before, after in zip(read.headings, read.headings[1:], strict=False):
        assert after <= before + 1


def test_page_loads_nothing_from_outside(text, read):
    assert not [entry for entry in read.attributes if entry[1] in ("src", "srcset", "action", "data")]
    assert not re.search(r"https?://|url\(|@import|fetch\(|XMLHttpRequest|//cdn", text)


def test_page_is_smaller_than_two_megabytes(text):
    assert len(text.encode()) < 2_000_000


def test_every_chart_has_an_aria_label(read):
    charts = sum(1 for tag, name, value in read.attributes if name == "class" and value.split()[0] == "panel")
    spoken = [value for tag, name, value in read.attributes if tag == "svg" and name == "aria-label"]
    assert len(spoken) == charts
    assert all(len(words) > 10 for words in spoken)


def test_rejected_rows_are_listed_by_their_row_in_the_file(text, report):
    rejected = report.last.fit.document["rejected"]
    assert len(rejected) >= 3
    listed = text[text.index('<section id="rejected"') : text.index('<section id="coverage"')]
    for entry in rejected:
        assert f'<th scope="row">{entry["row"]}</th>' in listed


def test_summary_names_the_added_effects(text):
    header = text[: text.index("<nav")]
    assert "gear_harmonics 3" in header
    assert "backlash 2" in header
    assert "Nothing is missing" in header
    assert "points to" not in header


def test_summary_names_the_missing_effect(report):
    first = page(gather([report.first.fit]))
    best = report.diagnoses[0].result["candidates"][0]
    assert f"The evidence points to {best['effect']} {best['joints'][0]}" in first[: first.index("<nav")]


def test_every_step_has_its_own_diagnosis_and_evidence(text, report):
    """Also the intermediate step, which is not a saved fit: the evidence for the second effect is shown."""
    assert [diagnosis.step for diagnosis in report.diagnoses] == report.steps
    missing = text[text.index('<section id="candidates"') : text.index('<section id="added"')]
    plots = text[text.index('<section id="added"') : text.index('<section id="effects"')]
    for number, (before, after) in enumerate(pairwise(report.steps), start=1):
        (added,) = after.added
        part = missing[missing.index(f"After {before.called}") : missing.index(f"After {after.called}")]
        assert f"<strong>{added}</strong>" in part
        assert f"<h3>{added}, after step {number}</h3>" in plots


def test_each_added_effect_has_a_complete_card(text, report):
    cards = text[text.index('<section id="effects"') :].split("</section>")[0].split("<figure>")[1:]
    added = [effect for step in report.steps for effect in step.added]
    assert [card.split("</h3>")[0] for card in cards] == [f"<h3>{effect}" for effect in added]
    for card in cards:
        for words in ("<svg", 'class="formula"', "Physical bound: ", "Source of the bound: ", "Evidence: "):
            assert words in card


def test_card_of_an_effect_of_the_measurement_has_the_formula_of_its_own_joint(tmp_path):
    hidden = [{"effect": "command_readback", "joints": [3]}]
    fit = fitted(tmp_path, {"arm": "kr30", "seed": 5, "columns": {"add": ["qr"]}, "hidden": hidden})
    text = page(gather([fit]))
    card = text[text.index('<section id="effects"') :].split("</figure>")[0]
    assert "<h3>command_readback" in card
    assert "motor3 += c·(q3 - qr3)" in card
    assert "does not move the arm" in card


def test_header_names_date_version_and_data_file(text, report):
    header = text[: text.index("<nav")]
    checksum = hashlib.sha256(report.last.fit.data.file.read_bytes()).hexdigest()
    assert f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}" in header
    assert f"Armtrue {__version__}" in header
    assert "data.csv" in header
    assert checksum[:16] in header
    assert f"<code>{checksum}</code>" in text


def test_glossary_is_linked_and_has_only_words_of_the_page(text, read):
    assert read.links.count("#glossary") >= 3
    glossary = text[text.index('<section id="glossary"') :]
    assert "<b>held out</b>" in glossary or "<b>held-out" in glossary
    assert "<b>noise floor</b>" in glossary
    assert "<b>dead band</b>" not in glossary, "a word that the page does not use"


def test_names_from_files_are_escaped(fits, tmp_path):
    fit = Fit.load(fits[0].path)
    fit.document["robot"]["name"] = "</script><img src=x onerror=alert(1)>"
    fit.path = fits[0].path.with_name("<b>&.json")
    made = page(gather([fit]))
    assert "<img" not in made
    assert "<b>&.json" not in made
    Reader(made)


def test_report_of_one_fit_compares_with_the_nominal_arm(fits):
    made = page(gather([fits[0]]))
    assert "from the nominal arm to the fit" in made
    assert "First step" not in made


@pytest.mark.full
def test_unexplained_structure_is_drawn(tmp_path):
    step = {"effect": "custom", "name": "joint_step", "coordinate": "motor1", "joints": [2]}
    hidden = [{**step, "expression": "sign(q2 + 1.5)", "value": 1.5e-4}]
    made = fitted(tmp_path, {"arm": "cobot", "seed": 13, "hidden": hidden})
    content = gather([made])
    assert content.diagnoses[0].result["verdict"] == "unexplained_structure"
    text = page(content)
    start = text.index('<section id="unexplained"')
    assert text.index("Shape of what is left over", start) > start


def test_missing_data_file_is_refused_with_the_paths_tried(fits, tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    moved = Path(shutil.copy(fits[0].path, folder / "fit.json"))
    fit = Fit.load(moved)
    fit.document["data"]["path"] = str(tmp_path / "gone" / "data.csv")
    out = tmp_path / "report.html"
    with pytest.raises(InputError, match="looked for them at .*gone/data.csv.*elsewhere/data.csv"):
        write([fit], out)
    assert not out.exists()


def test_fits_of_different_measurements_are_refused(fits, tmp_path):
    other = fitted(tmp_path, {"arm": "kr30", "seed": 9, "poses": 100})
    with pytest.raises(InputError, match="expected those of the first fit"):
        gather([fits[0], other])


def test_table_among_the_candidates_is_one_line(report):
    """A table has hundreds of nodes: their range tells more than the first six values."""
    tables = [c for c in report.diagnoses[0].result["candidates"][:4] if c["effect"] == "transmission_pwl"]
    assert tables
    text = page(report)
    reasons = text[text.index("Why, and how large") :][:6000]
    assert f"{len(tables[0]['parameters'])} nodes from " in reasons
    assert ".node2 = " not in reasons


@pytest.mark.parametrize(
    ("source", "words"),
    [("repeats", "from poses measured again"), ("none", "nothing recorded tells it")],
)
def test_summary_names_the_source_of_the_noise_floor(fits, source, words):
    fit = Fit.load(fits[0].path)
    fit.document["noise_floor"] = {**fit.document["noise_floor"], "source": source}
    header = page(gather([fit])).split("<nav")[0]
    assert f"<small>{words}</small>" in header


def test_every_step_has_its_own_noise_floor_and_the_lead_says_why(report):
    first, *others = report.steps
    floor = {**first.fit.document["noise_floor"], "um": 3.0 * report.last.noise_floor_um}
    noisy = replace(first, fit=Fit({**first.fit.document, "noise_floor": floor}, first.fit.path))
    section = error_section(replace(report, steps=[noisy, *others]))
    places = [float(place) for place in re.findall(r'<i class="floor" style="left:([\d.]+)%">', section)]
    assert len(places) == len(report.steps)
    assert places[0] > places[-1] + 5.0
    assert "It falls when the model explains why two visits of a pose differ" in section


def test_parameters_that_correct_a_nominal_value_have_it_beside_them(text):
    section = text[text.index('<section id="parameters"') :].split("</section>")[0]
    row = section[section.index("joint_offset[2]") :].split("</tr>")[0]
    assert "−90.000°" in row
    assert "the correction that is added to it" in section


def test_report_without_any_fit_is_refused(tmp_path):
    with pytest.raises(InputError, match="found no fit"):
        write([], tmp_path / "report.html")


def test_sensor_that_explains_as_much_is_in_the_ambiguity_set():
    def of(sensor: str, explained: float) -> dict[str, object]:
        return {
            "effect": "thermal_base",
            "joints": [],
            "options": {"sensor": sensor},
            "explained": explained,
            "recommend": sensor == "arm",
            "confounded_with": [],
        }

    assert "Nothing else" in str(_ambiguity([of("arm", 0.9), of("stand", 0.5)]))
    words = str(_ambiguity([of("arm", 0.9), of("stand", 0.89)]))
    assert "Nothing else" not in words
    assert "thermal_base (sensor stand)" in words
    assert "while they do not move together" in words


def test_fit_without_held_out_error_is_shown_as_not_scored(report):
    error = report.last.fit.document["error"]
    zero = dict.fromkeys(("mean_um", "rms_um", "p95_um", "max_um"), 0.0)
    unscored = {**error, "held_out": {**zero, "n": 0}}
    fit = replace(report.last.fit, document={**report.last.fit.document, "error": unscored})
    text = page(replace(report, steps=[*report.steps[:-1], replace(report.last, fit=fit)]))
    assert "→ not scored" in text
    assert "0.00 µm" not in text
