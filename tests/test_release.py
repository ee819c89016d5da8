"""All files state the version of VERSION, and NOTICE lists all licence files."""

from __future__ import annotations

import configparser
import re
import subprocess
import sys
from pathlib import Path

import armtrue
import pytest

ROOT = Path(__file__).resolve().parents[1]
VERSION = (ROOT / "VERSION").read_text().strip()


def test_command_prints_the_version_of_the_version_file() -> None:
    assert armtrue.__version__ == VERSION
    said = subprocess.run(
        [sys.executable, "-m", "armtrue", "--version"], capture_output=True, text=True, check=True
    )
    assert said.stdout == f"armtrue {VERSION}\n"


def test_eds_states_the_version_of_the_version_file() -> None:
    dictionary = configparser.ConfigParser(interpolation=None)
    dictionary.read(ROOT / "firmware/canopen/od/armtrue.eds")
    assert dictionary["100A"]["DefaultValue"] == VERSION


@pytest.mark.parametrize("file", ["CITATION.cff", "CHANGELOG.md"])
def test_citation_and_changelog_state_the_version(file: str) -> None:
    assert re.search(
        rf"(^version: |^## ){re.escape(VERSION)}\b", (ROOT / file).read_text(), flags=re.MULTILINE
    )


def test_notice_lists_exactly_the_licence_files() -> None:
    named = set(re.findall(r"([\w-]+\.txt) +\|", (ROOT / "NOTICE").read_text()))
    assert named == {path.name for path in (ROOT / "licenses").iterdir()}
