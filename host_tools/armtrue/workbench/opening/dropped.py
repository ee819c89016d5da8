"""Files that were dropped on the page: kept in a separate folder, and interpreted by `init` where they are foreign."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from armtrue.checking import Finding, check
from armtrue.errors import InputError, shorten
from armtrue.foreign import init
from armtrue.foreign.robots import WHERE_ARMS_ARE, is_dh_table
from armtrue.io import Dataset, Robot, load_data, load_robot
from armtrue.io.columns import POSITION
from armtrue.io.files import read_text, write_file
from armtrue.io.yamlfile import load_yaml
from armtrue.report.markup import Markup
from armtrue.workbench.opening.guess_picture import guess_picture
from armtrue.workbench.opening.guesses import can_be_mended, filled_in, mended
from armtrue.workbench.opening.opened import Opened, open_files

Entry = dict[str, Any]

LOOK_AT_GUESSES = "The files are not in Armtrue's own form: look at what was guessed, then open them."

_TABLES = {".csv", ".txt", ".tsv", ".dat", ".xlsx"}
_KNOWN = {*_TABLES, ".json", ".yaml", ".yml", ".urdf"}
_KINDS = ("fit", "robot", "model", "data", "urdf", "dh", "table")
_LONGEST_NAME = 120
_GUESSED = "guessed"


@dataclass
class Guess:
    """What `init` made of foreign files: its dataset.yaml, the reasons for its guesses, and the findings of `check`."""

    path: Path
    text: str
    notes: list[str]
    findings: list[Finding]
    robot: Robot
    picture: Markup | None


@dataclass
class Drop:
    """Files in `folder` that were dropped since the last time something was opened.

    `draft`: `form` and `text` of the guesses as the user edited them, before they are opened.
    """

    folder: Path
    names: list[str] = field(default_factory=list)
    guess: Guess | None = None
    draft: Entry = field(default_factory=dict)

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

    def take_foreign(self, files: list[Path], robot: Path | None, model: Path | None) -> bool:
        """Copy foreign files named in the terminal, and guess what they are; False where they are not foreign.

        A file in Armtrue's own form is not foreign, even if faulty. Errors: InputError where several files, or one with
        a URDF, cannot be understood; one file alone gives False, as the reader of Armtrue's own form explains more.
        """
        beside = files[0].with_name("robot.yaml")
        arm = robot or (beside if beside.is_file() else None)
        named = [*files, *filter(None, (arm, model))]
        certain = len(files) > 1 or (arm is not None and arm.suffix.lower() == ".urdf")
        tables = all(file.suffix.lower() in _TABLES for file in files)
        whole = all(path.is_file() for path in named) and len({path.name for path in named}) == len(named)
        if not (tables and whole and (certain or not is_own(files[0]))):
            return False
        try:
            for path in named:
                self.take(path.name, path.read_bytes())
            self.open({})
        except InputError as error:
            self.forget()
            shutil.rmtree(self.folder, ignore_errors=True)
            if certain:
                raise InputError(self.without_place(str(error))) from None
        return self.guess is not None

    def without_place(self, sentence: str) -> str:
        """A sentence with the paths of dropped files shortened to their names."""
        return sentence.replace(f"{self.folder}{os.sep}", "")

    def forget(self) -> None:
        """Forget what was dropped; the files stay in the folder."""
        self.names, self.guess, self.draft = [], None, {}

    def take_draft(self, words: Entry) -> None:
        """Keep form and text of the guesses as they are on the page. Errors: InputError where they are missing."""
        form, text = words.get("form"), words.get("text")
        parts = [form.get(part) for part in ("fields", "columns")] if isinstance(form, dict) else [None]
        whole = all(isinstance(part, dict) for part in parts) and isinstance(text, str)
        if self.guess is None or not whole:
            raise InputError("draft: found no form of guesses, expected its fields, its columns and its text")
        self.draft = {"form": form, "text": text}

    def as_json(self) -> Entry:
        """The waiting files and the guesses about them, for the session's file."""
        notes = None if self.guess is None else self.guess.notes
        return {"folder": str(self.folder), "names": self.names, "notes": notes, "draft": self.draft}

    def go_on(self, kept: Entry) -> None:
        """Restore the state that `as_json` gave, with those of its files that still exist."""
        folder = Path(kept["folder"])
        names = [str(name) for name in kept["names"] if (folder / str(name)).is_file()]
        if not names:
            return
        self.folder, self.names, self.guess, self.draft = folder, names, None, {}
        if kept.get("notes") is not None:
            self.guess = self._looked_at([str(note) for note in kept["notes"]])
            self.draft = dict(kept["draft"])

    def open(self, words: Entry) -> Opened | None:
        """Open what was dropped; None where guesses are to be reviewed first.

        `words`: `text`, dataset.yaml as the user edited it; `form`, the form; with it `look`, to check it without
        opening, or `mend`, the index of a finding to correct. Errors: InputError in one sentence.
        """
        if self.guess is not None:
            if words.get("look") is True:
                self.take_draft({"form": words.get("form"), "text": self.guess.text})
                self._check(filled_in(self.guess.text, self.draft["form"], self.guess.robot))
                return None
            if "mend" in words:
                self._mend(words)
                return None
            if isinstance(words.get("text"), str):
                return self._open_guessed(words["text"])
            if "form" in words:
                return self._open_guessed(filled_in(self.guess.text, words["form"], self.guess.robot))
        self.guess, self.draft = None, {}
        kinds: dict[str, list[Path]] = {kind: [] for kind in _KINDS}
        for name in self.names:
            kinds[kind_of(self.folder / name)].append(self.folder / name)
        robot, model = _one(kinds["robot"], "arm"), _one(kinds["model"], "model")
        if kinds["fit"] or kinds["data"]:
            return open_files([*kinds["fit"], *kinds["data"]], robot, model)
        if not kinds["table"]:
            raise InputError(
                "found no measurements among the files, expected a CSV, an XLSX, a dataset.yaml or a fit.json"
            )
        why = ""
        if robot is not None and len(kinds["table"]) == 1:
            try:
                return open_files(kinds["table"], robot, model)
            except InputError as error:
                # The message goes on to recommend `armtrue init`, which runs here: that part is cut off.
                why = self.without_place(str(error)).split("; ")[0]
        self._guess(kinds, robot, model, why)
        return None

    def _guess(self, kinds: dict[str, list[Path]], robot: Path | None, model: Path | None, why: str) -> None:
        # A URDF beside a robot.yaml is no second arm: robot.yaml refers to it.
        urdf = None if robot else _one(kinds["urdf"], "URDF")
        dh = None if robot else _one(kinds["dh"], "table of an arm")
        if not (robot or urdf or dh):
            names = ", ".join(path.name for path in kinds["table"])
            raise InputError(
                f"{names}: found no arm beside it, expected its robot.yaml, its URDF, or a table of "
                f"Denavit-Hartenberg rows (a, alpha, d, theta) to be dropped too; {WHERE_ARMS_ARE}"
            )
        arm = {"urdf": urdf, "dh": dh, "robot": robot}
        found = init(kinds["table"], self.folder / _GUESSED, **arm, model=model, force=True, skip_bad=True)
        self.guess = self._looked_at([*([why] if why else []), *found.notes])

    def _looked_at(self, notes: list[str]) -> Guess:
        """The guesses in the folder, with the findings of the check."""
        arm = load_robot(self.folder / _GUESSED / "robot.yaml")
        dataset = self.folder / _GUESSED / "dataset.yaml"
        data = load_data(dataset, arm, strict=False)
        findings = check(data, arm).findings
        return Guess(dataset, read_text(dataset), notes, findings, arm, guess_picture(data, arm, findings))

    def _open_guessed(self, text: str) -> Opened:
        self._check(text)
        out = self.folder / _GUESSED
        return open_files([out / "dataset.yaml"], out / "robot.yaml", out / "model.yaml")

    def measurements(self, words: Entry) -> Dataset:
        """The guessed measurements, read by `form` or `text` of `words`, or as before. Errors: InputError."""
        assert self.guess is not None
        text = str(words.get("text", self.guess.text))
        self._check(filled_in(text, words["form"], self.guess.robot) if "form" in words else text)
        return load_data(self.guess.path, self.guess.robot)

    def _check(self, text: str) -> None:
        """Use `text` as dataset.yaml and check it; where it cannot be read, the old text stays."""
        assert self.guess is not None
        write_file(self.guess.path, text)
        try:
            self.guess, self.draft = self._looked_at(self.guess.notes), {}
        except InputError:
            write_file(self.guess.path, self.guess.text)
            raise

    def _mend(self, words: Entry) -> None:
        assert self.guess is not None
        place, findings = words["mend"], self.guess.findings
        if not isinstance(place, int) or not 0 <= place < len(findings) or not can_be_mended(findings[place]):
            raise InputError(f"mend: found {place!r}, expected a finding that can be mended here")
        text = self.guess.text
        if "form" in words:
            text = filled_in(text, words["form"], self.guess.robot)
        self._check(mended(text, findings[place]))


def is_own(path: Path) -> bool:
    """True where a file has the columns of Armtrue's own form."""
    try:
        header = read_text(path).split("\n", 1)[0].strip().split(",")
    except InputError:
        return False
    return {"q1", *POSITION} <= set(header)


def kind_of(path: Path) -> str:
    """What a file is, by its ending and, for YAML, by its keys."""
    ending = path.suffix.lower()
    if ending in _TABLES:
        return "dh" if is_dh_table(path) else "table"
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
