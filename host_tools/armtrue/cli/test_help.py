"""Commands that need no data: help, version, completion, glossary, and catalogue of effects."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from armtrue import glossary
from armtrue.cli.app import app
from armtrue.cli.conftest import armtrue
from armtrue.cli.shared.guard import GuardedGroup
from armtrue.io.catalogue import catalogue

HEAVY = ("numpy", "armtrue._core", "yaml", "can", "serial")


@pytest.mark.parametrize("argument", ["--help", "--version"])
def test_help_and_version_import_no_slow_library(argument):
    script = (
        "import sys; sys.argv = ['armtrue', sys.argv[1]]\nfrom armtrue.cli import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"print(*[name for name in {HEAVY} if name in sys.modules], file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", script, argument], capture_output=True, text=True, check=True)
    assert run.stdout
    assert run.stderr.strip() == ""


def test_help_lists_every_command_that_its_modules_add():
    root = typer.main.get_command(app)
    assert isinstance(root, GuardedGroup)
    assert set(root.whole().commands) == set(root.homes)
    context = typer.Context(root)
    assert all(root.get_command(context, name) is not None for name in root.list_commands(context))


def test_completion_offers_commands_and_options():
    def offered(words: str) -> str:
        words_before = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
        environment = {**os.environ, "_ARMTRUE_COMPLETE": "complete_bash", **words_before}
        script = (
            "import sys; sys.argv = ['armtrue']; from armtrue.cli.app import app; app(prog_name='armtrue')"
        )
        run = subprocess.run(
            [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False
        )
        return run.stdout

    assert offered("armtrue re").split() == ["remove", "refine", "report"]
    assert "--model" in offered("armtrue fit --mo")


def test_every_glossary_entry_is_found_by_its_name_and_its_plural():
    entries = glossary.glossary()
    lines = Path(glossary.__file__).with_name("glossary.md").read_text().splitlines()
    assert len(entries) == sum(line.startswith("- ") for line in lines) > 30
    assert list(entries) == sorted(entries, key=str.lower)
    for name in entries:
        assert glossary.find(name) == entries[name]
        assert glossary.find(f"{name.upper()}s") == entries[name]


def test_explain_defines_a_term_or_suggests_the_nearest_one(tmp_path):
    assert "between models" in armtrue("explain", "evidence", cwd=tmp_path).stdout
    assert "did not see the pose" in armtrue("explain", "held", "out", cwd=tmp_path).stdout
    assert armtrue("explain", "cross-validated", cwd=tmp_path).stdout.startswith("held out")
    assert "armtrue effects backlash" in armtrue("explain", "backlash", cwd=tmp_path).stdout
    assert "residual grid" in armtrue("explain", cwd=tmp_path).stdout
    for word in (
        "separable",
        "explains",
        "delta BIC",
        "ΔBIC",
        "ambiguity set",
        "score",
        "sigma",
        "probability",
    ):
        assert armtrue("explain", *word.split(), cwd=tmp_path).returncode == 0, word
    run = armtrue("explain", "evidnce", cwd=tmp_path)
    assert (run.returncode, "did you mean 'evidence'" in run.stderr) == (2, True)


def test_every_effect_is_shown_with_formula_bound_and_source(tmp_path):
    from armtrue.sketching import formulas

    for info in catalogue().values():
        lines = formulas(info)
        assert lines, info.id
        assert "+=" in lines[0], info.id
        # No rounding residues in place of zero (1e-12 to 1e-19), and no "+ -".
        assert not re.search(r"\de-1[2-9]|\+ -", " ".join(lines)), (info.id, lines)
        # The source itself, not a link: docs/effects.md does not repeat it.
        assert info.bound_and_source[1], info.id
        assert "docs/" not in info.bound, info.id
    run = armtrue("effects", "gear_harmonics", cwd=tmp_path)
    said = " ".join(run.stdout.split())
    assert "motor2 += cos1·cos(q2) + sin1·sin(q2)" in said or "sin(q2)" in said
    for word in ("bound 2.5e-3 rad", "source 10 to 60 arcsec", "over q2 from -180° to 180°"):
        assert word in said


def test_sketch_of_an_effect_is_drawn_over_its_own_variables():
    from armtrue.sketching import sketch

    known = catalogue()
    assert sketch(known["warm_up"])[0] == "over time from 0 to 4 h"
    assert sketch(known["thermal_joint_drift"])[0].startswith("over temp_arm")
    assert [line for line in sketch(known["backlash"]) if line.startswith("over ")] == [
        "over q2 from -180° to 180°",
        "over dir2 from -1 to 1",
    ]
    assert sketch(known["joint_offset"]) == []


def test_mistyped_effect_or_option_suggests_the_nearest_one(tmp_path):
    run = armtrue("effects", "gear_harmonic", cwd=tmp_path)
    assert (run.returncode, "did you mean 'gear_harmonics'" in run.stderr) == (2, True)
    run = armtrue("fit", "data.csv", "--robt", "robot.yaml", cwd=tmp_path)
    assert (run.returncode, "--robot" in run.stderr) == (2, True)
