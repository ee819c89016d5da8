"""An effect is one file: no other product file contains its id as a string."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from armtrue import _core

ROOT = Path(__file__).resolve().parents[1]
IDS = {effect["id"] for effect in json.loads(_core.effects())}
# Ids that are also names of other things: a linkage's kind in robot.yaml, the role of a user's own effect, columns.
OTHERWISE = {"parallelogram", "custom", "station", "nest"}
NAMED = re.compile(r"""["']([a-z_]+)["']""")


def product_files() -> Iterator[Path]:
    for folder, endings in (("fitter", (".cc", ".h")), ("host_tools/armtrue", (".py",))):
        for file in sorted((ROOT / folder).rglob("*")):
            is_test = "test" in file.stem.split("_") or file.stem == "conftest" or "bench" in file.stem
            if file.suffix in endings and not is_test and not {"effects", "testing"} & set(file.parts):
                yield file


def named_in(text: str) -> list[tuple[int, str]]:
    """(line, effect) of every effect id that appears as a string."""
    return [
        (number, name)
        for number, line in enumerate(text.splitlines(), 1)
        for name in NAMED.findall(line)
        if name in IDS - OTHERWISE
    ]


def test_named_in_finds_a_quoted_id() -> None:
    assert named_in('x\nif (p.effect == "gear_mesh") return 1;') == [(2, "gear_mesh")]


@pytest.mark.parametrize("folder", ["fitter", "host_tools/armtrue"])
def test_no_effect_is_named_outside_its_file(folder: str) -> None:
    files = [file for file in product_files() if file.is_relative_to(ROOT / folder)]
    assert len(files) > 30
    found = [
        f"{file.relative_to(ROOT)}:{line}: {name}"
        for file in files
        for line, name in named_in(file.read_text())
    ]
    assert not found
