"""The main path through the workbench in Debian's Chromium, by the roles and names of the contract."""

from __future__ import annotations


def mean_um(state):
    return state["error"]["held_out"]["mean_um"]


def test_both_effects_added_leave_nothing_missing_undo_branches(page, workbench):
    begun = workbench.state()
    assert begun["verdict"] == "missing_effect"
    assert f"{mean_um(begun):.1f} µm" in page.error()
    first = page.candidates()[0].split("\n")[0].split("\t")[0]
    said = page.add()
    assert first.split()[0] in said
    assert "fell from" in said
    after_one = workbench.state()
    assert mean_um(after_one) < 0.9 * mean_um(begun)
    page.add()
    done = workbench.state()
    assert done["verdict"] == "nothing_missing"
    assert [name for name in page.model() if name in ("gear_harmonics 3", "backlash 2")] == page.model()[-2:]
    assert mean_um(done) < 0.9 * mean_um(after_one)
    assert len(done["steps"]) == 3

    page.press("Undo")
    page.press("Undo")
    assert workbench.state()["effects"] == begun["effects"]
    page.add(1)
    other = workbench.state()
    assert other["effects"] not in (begun["effects"], after_one["effects"])
    assert [each["parent"] for each in other["models"]] == [None, 0, 1, 0]
    page.remove(page.model()[-1])
    assert workbench.state()["effects"] == begun["effects"]
    page.press("Undo")
    page.press("Redo")
    page.press("Refine")
    assert workbench.state()["verdict"] == "nothing_missing"
    page.press("Report")
    assert "report.html is made" in page.status()
    page.press("Export")
    assert "calibration.zip is made" in page.status()
    assert page.failure() == ""
    assert page.browser.complaints() == []
    assert workbench.end() == 0
