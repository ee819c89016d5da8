"""Files that were dropped on the page: kept in a folder of their own, guessed at by `init` where they are foreign."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from armtrue.checking import Finding, check
from armtrue.errors import InputError, shorten
from armtrue.foreign import init
from armtrue.io import load_data, load_robot
from armtrue.io.files import read_text, write_file
from armtrue.io.yamlfile import load_yaml
from armtrue.workbench.opening import Opened, open_files

_TABLES = {".csv", ".txt", ".tsv", ".dat", ".xlsx"}
_KNOWN = {*_TABLES, ".json", ".yaml", ".yml", ".urdf"}
_LONGEST_NAME = 120
_FIRST_ROWS = 5
_GUESSED = "guessed"


@dataclass
class Guess:
    """What `init` made of foreign files: its dataset.yaml, from what that was guessed, and what `check` says."""

    text: str
    notes: list[str]
    findings: list[Finding]
    rows: list[list[str]]


@dataclass
class Drop:
    """Files in `folder` that were dropped since the last time something was opened."""

    folder: Path
    names: list[str] = field(default_factory=list)
    guess: Guess | None = None

    def take(self, name: str, content: bytes) -> None:
        """Keep one file. Errors: InputError for a name that is no plain file name of a known kind."""
        if name != Path(name).name or "\\" in name or not name.isprintable() or name.startswith("."):
            raise InputError(f"found a file named {shorten(name)}, expected a plain name")
        if len(name) > _LONGEST_NAME or Path(name).suffix.lower() not in _KNOWN:
            raise InputError(f"{shorten(name)}: expected one of {', '.join(sorted(_KNOWN))}")
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self.folder / name, content)
        if name not in self.names:
            self.names.append(name)

    def forget(self) -> None:
        """Begin anew; the files stay where they are."""
        self.names, self.guess = [], None

    def open(self, text: str | None) -> Opened | None:
        """Open what was dropped; None where guesses are to be looked at first.

        `text`: dataset.yaml as the person left it. Errors: InputError in one sentence.
        """
        if text is not None and self.guess is not None:
            return self._open_guessed(text)
        self.guess = None
        kinds: dict[str, list[Path]] = {
            "fit": [],
            "robot": [],
            "model": [],
            "data": [],
            "urdf": [],
            "table": [],
        }
        for name in self.names:
            kinds[_kind(self.folder / name)].append(self.folder / name)
        robot, model = _one(kinds["robot"], "arm"), _one(kinds["model"], "model")
        if kinds["fit"] or kinds["data"]:
            return open_files([*kinds["fit"], *kinds["data"]], robot, model)
        if not kinds["table"]:
            raise InputError(
                "found no measurements among the files, expected a CSV, an XLSX, a dataset.yaml or a fit.json"
            )
        if robot is not None and len(kinds["table"]) == 1:
            try:
                return open_files(kinds["table"], robot, model)
            except InputError as error:
                self._guess(kinds, robot, str(error))
                return None
        self._guess(kinds, robot, "")
        return None

    def _guess(self, kinds: dict[str, list[Path]], robot: Path | None, why: str) -> None:
        tables = kinds["table"]
        out = self.folder / _GUESSED
        found = init(tables, out, urdf=_one(kinds["urdf"], "URDF"), robot=robot, force=True)
        if robot is not None:
            write_file(out / "robot.yaml", read_text(robot))
        notes = [*([why] if why else []), *found.notes]
        self.guess = Guess(read_text(out / "dataset.yaml"), notes, found.findings, _first_rows(tables[0]))

    def _open_guessed(self, text: str) -> Opened:
        assert self.guess is not None
        out = self.folder / _GUESSED
        write_file(out / "dataset.yaml", text)
        self.guess.text = text
        arm = load_robot(out / "robot.yaml")
        self.guess.findings = check(load_data(out / "dataset.yaml", arm, strict=False), arm).findings
        return open_files([out / "dataset.yaml"], out / "robot.yaml", out / "model.yaml")


def _kind(path: Path) -> str:
    """What a file is, by its ending and, for YAML, by its keys."""
    ending = path.suffix.lower()
    if ending in _TABLES:
        return "table"
    if ending == ".json":
        return "fit"
    if ending == ".urdf":
        return "urdf"
    top = load_yaml(path)
    if top.has("kinematics"):
        return "robot"
    return "model" if top.has("effects") else "data"


def _one(paths: list[Path], what: str) -> Path | None:
    if len(paths) > 1:
        raise InputError(f"{paths[1].name}: found a second {what} beside {paths[0].name}, expected one")
    return paths[0] if paths else None


def _first_rows(path: Path) -> list[list[str]]:
    """The first rows as they stand in a text file; none of a spreadsheet."""
    if path.suffix.lower() == ".xlsx":
        return []
    lines = list(islice(read_text(path).splitlines(), 1 + _FIRST_ROWS))
    try:
        dialect: type[csv.Dialect] = csv.Sniffer().sniff("\n".join(lines), ",;\t ")
    except csv.Error:
        dialect = csv.excel
    return list(csv.reader(lines, dialect))
