"""tools/into_results.py writes the output of a command between the markers of its section in docs/results.md or
docs/effects.md, and leaves the page unchanged if the command fails or prints nothing."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with the tool and a page of two sections."""
    (tmp_path / "tools").mkdir()
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "tools/into_results.py", tmp_path / "tools")
    page = (
        "# Results\n<!-- a: begin -->\nold a\n<!-- a: end -->\nbetween\n<!-- b: begin -->\n<!-- b: end -->\n"
    )
    (tmp_path / "docs/results.md").write_text(page, encoding="utf-8")
    return tmp_path


def keep(checkout: Path, name: str, printed: str, then: str = "") -> subprocess.CompletedProcess[str]:
    """Run into_results.py on a command that prints `printed` and then executes `then`."""
    program = f"import sys; print({printed!r}, end='', flush=True)\n{then}"
    command = [sys.executable, str(checkout / "tools/into_results.py"), name, sys.executable, "-c", program]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def page_of(checkout: Path) -> str:
    return (checkout / "docs/results.md").read_text(encoding="utf-8")


def test_repeated_run_replaces_only_the_named_section(checkout: Path) -> None:
    for _ in range(2):
        assert keep(checkout, "a", "| new |\n").stdout == "| new |\n"
    expected = "# Results\n<!-- a: begin -->\n| new |\n<!-- a: end -->\nbetween\n<!-- b: begin -->\n<!-- b: end -->\n"
    assert page_of(checkout) == expected


def test_section_of_effects_md_is_written_there(checkout: Path) -> None:
    before, other = page_of(checkout), checkout / "docs/effects.md"
    other.write_text("# Effects\n<!-- c: begin -->\n<!-- c: end -->\n", encoding="utf-8")
    assert keep(checkout, "c", "| new |\n").returncode == 0
    assert other.read_text(encoding="utf-8") == "# Effects\n<!-- c: begin -->\n| new |\n<!-- c: end -->\n"
    assert page_of(checkout) == before


@pytest.mark.parametrize(("name", "printed", "status"), [("c", "| new |\n", 2), ("a", "\n", 1)])
def test_unknown_section_or_empty_output_leaves_the_page(
    checkout: Path, name: str, printed: str, status: int
) -> None:
    before = page_of(checkout)
    done = keep(checkout, name, printed)
    assert done.returncode == status
    assert len(done.stderr.splitlines()) == 1
    assert page_of(checkout) == before


@pytest.mark.parametrize(("then", "status"), [("sys.exit(3)", 3), ("import os; os.kill(os.getpid(), 9)", 1)])
def test_output_of_a_failed_command_is_shown_but_not_written(checkout: Path, then: str, status: int) -> None:
    before = page_of(checkout)
    done = keep(checkout, "a", "| half a table |\n", then)
    assert (done.returncode, done.stdout) == (status, "| half a table |\n")
    assert len(done.stderr.splitlines()) == 1
    assert page_of(checkout) == before


def test_every_section_that_a_script_writes_has_its_markers() -> None:
    scripts = [*(ROOT / "tools/dev.d").glob("*.sh"), *(ROOT / "tools/bench.d").glob("*.sh")]
    names = {
        quoted or plain
        for script in scripts
        for quoted, plain in re.findall(
            r"into_results\.py (?:\"([a-z0-9 ]+)\"|([a-z0-9]+))", script.read_text()
        )
    }
    assert len(names) >= 10
    page = "".join(
        (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("results.md", "effects.md")
    )
    assert {name for name in names if page.count(f"<!-- {name}: begin -->") != 1} == set()
    assert {name for name in names if page.count(f"<!-- {name}: end -->") != 1} == set()


def test_results_page_has_no_table_outside_markers() -> None:
    page = (ROOT / "docs/results.md").read_text(encoding="utf-8")
    kept = re.sub(r"<!-- ([a-z0-9 ]+): begin -->.*?<!-- \1: end -->", "", page, flags=re.DOTALL)
    assert [line for line in kept.splitlines() if line.startswith("|")] == []


def test_readme_figures_are_in_the_results_page() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    section = readme[readme.index("## How good it is") : readme.index("## Two commands")]
    rows = [line for line in section.splitlines() if line.startswith("| ") and "held-out error" not in line]
    figures = [figure for row in rows for figure in re.findall(r"([\d.]+)(?:\*\*)? [mµ]m", row)]
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert len(figures) >= 8
    assert [figure for figure in figures if f" {figure} " not in results] == []
