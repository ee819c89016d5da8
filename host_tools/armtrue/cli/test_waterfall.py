"""The waterfall of `armtrue refine`: all steps, and all effects added or removed, within the terminal's width."""

from __future__ import annotations

from typing import Any

import pytest

from armtrue.cli.diagnosis import Waterfall
from armtrue.cli.shared.output import Output


def step(
    mean: float, floor: float | None, added: dict[str, Any] | None = None, removed: Any = ()
) -> dict[str, Any]:
    figures = {"mean_um": mean, "rms_um": 1.1 * mean, "p95_um": 2 * mean, "max_um": 3 * mean}
    return {
        "error": {"held_out": figures},
        "noise_floor_um": floor,
        "noise_floor_source": "repeats",
        "added": added,
        "removed": list(removed),
    }


def effect(name: str, *joints: int, **options: Any) -> dict[str, Any]:
    return {"effect": name, "joints": list(joints), "options": options, "parameters": []}


def printed(steps: list[dict[str, Any]], capsys: pytest.CaptureFixture[str], width: int = 100) -> list[str]:
    output = Output(None)
    output.console.width = width
    waterfall = Waterfall(output)
    for each in steps:
        waterfall.add(each)
    assert waterfall.steps == steps
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    return lines


STEPS = [
    step(100.0, 15.5),
    step(40.0, 12.1, effect("gear_mesh", 2, orders=[1.0])),
    step(120.0, 12.1, effect("thermal_expansion", 1, 2, 3, 4, 5, 6)),
    step(
        13.0,
        12.0,
        effect("backlash", 2),
        [effect("transmission_pwl", 3), effect("gear_mesh", 2, cycles=[142.0]), effect("joint_scale", 1, 4)],
    ),
]


@pytest.mark.parametrize("width", [80, 100, 160])
def test_each_added_or_removed_effect_has_a_line_of_its_own(capsys, width):
    lines = printed(STEPS, capsys, width)
    column = next(line for line in lines if "what changed" in line).index("what changed")
    changes = " ".join(line[column:].strip() for line in lines[4:])
    for words in (
        "as it stood",
        "+ gear_mesh 2 (order 1)",
        "+ thermal_expansion 1,2,3,4,5,6",
        "+ backlash 2 − transmission_pwl 3 − gear_mesh 2 (142 cycles a turn) − joint_scale 1,4",
    ):
        assert words in changes
    assert [line.split()[0] for line in lines[4:] if line[:4].strip()] == ["0", "1", "2", "3"]


def test_figures_are_the_held_out_errors_and_the_floor_of_that_step(capsys):
    lines = printed(STEPS, capsys)
    assert lines[3].split() == ["step", "mean", "RMS", "95", "%", "max", "floor", "what", "changed"]
    assert lines[4].split()[:6] == ["0", "100.0", "110.0", "200.0", "300.0", "15.5"]
    assert lines[5].split()[:6] == ["1", "40.0", "44.0", "80.0", "120.0", "12.1"]
    assert "│" in lines[1]


def test_bars_scale_with_the_first_step_and_are_never_longer(capsys):
    lines = printed([step(100.0, None), step(50.0, None), step(120.0, None)], capsys)
    bars = [line.count("█") for line in lines[4:]]
    assert bars[1] == round(bars[0] / 2)
    assert bars[2] == bars[0]
    assert all("│" not in line and "–" in line for line in lines[4:])


def test_floor_mark_is_at_its_share_of_the_bar(capsys):
    lines = printed([step(100.0, 50.0)], capsys)
    row = lines[4]
    start = row.index("█")
    assert row.index("│") - start == (row.count("█") + 1) // 2


def test_a_step_that_was_not_scored_has_no_figures_and_no_bar(capsys):
    unscored = step(0.0, 12.0)
    unscored["error"]["held_out"]["n"] = 0
    row, more = printed([step(200.0, 12.0), unscored], capsys)[-2:]
    assert row.split()[:6] == ["1", "–", "–", "–", "–", "12.0"]
    assert "█" not in row
    assert more.strip() == "not scored"
