"""The files that the workbench makes: tables, model, report, and the session as commands and as a notebook."""

from __future__ import annotations

import io
import json
import shlex
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from armtrue.candidates import option_words
from armtrue.errors import InputError
from armtrue.io import Dataset
from armtrue.io.files import read_text
from armtrue.progress import Progress
from armtrue.report import write
from armtrue.tables import ExportOptions, export, fitted_arm
from armtrue.workbench.session import Node, Session


@dataclass(frozen=True)
class Made:
    """A file for the user to download."""

    name: str
    content: bytes
    kind: str


def make(session: Session, name: str, progress: Progress | None = None) -> Made:
    """Make one of the files. Errors: InputError for an unknown name, or where the fit cannot be exported."""
    known: dict[str, Callable[[Session], Made]] = {
        "export": _bundle,
        "report": lambda s: _report(s, progress),
        "tables": lambda s: Made("tables.bin", _tables(s), "application/octet-stream"),
        "model": lambda s: Made("model.yaml", _as_yaml(s, s.node), "application/yaml"),
        "fit": lambda s: Made("fit.json", _fit(s), "application/json"),
        "commands": lambda s: Made("commands.sh", _commands(s, _in_full(s)).encode(), "text/x-shellscript"),
        "notebook": lambda s: Made("session.ipynb", _notebook(s, _in_full(s)), "application/x-ipynb+json"),
    }
    if name not in known:
        raise InputError(f"file: found '{name}', expected one of {', '.join(known)}")
    return known[name](session)


def _bundle(session: Session) -> Made:
    """One archive with every output of the session: the Export button downloads it."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr("tables.bin", _tables(session))
        bundle.writestr("tables.bin.fit.json", _fit(session))
        bundle.writestr("fit.json", _fit(session))
        bundle.writestr("model.yaml", _as_yaml(session, session.node))
        bundle.writestr("commands.sh", _commands(session, session.data.path.name))
        bundle.writestr("session.ipynb", _notebook(session, session.data.path.name))
        for name, content in _measurements(session.data).items():
            bundle.writestr(name, content)
    return Made("calibration.zip", stream.getvalue(), "application/zip")


def _in_full(session: Session) -> str:
    return str(session.data.path.resolve())


def _measurements(data: Dataset) -> dict[str, bytes]:
    """The files of the measurements by name; a dataset.yaml then names the file beside it."""
    found = {data.file.name: data.file.read_bytes()}
    if data.path != data.file:
        described = {**yaml.safe_load(read_text(data.path)), "file": data.file.name}
        found[data.path.name] = _yaml(described)
    return found


def _report(session: Session, progress: Progress | None) -> Made:
    path = [node for node in session.path if node.left_out == session.node.left_out]
    fits = [session.fit_of(node.number) for node in path]
    names = [node.name or node.change for node in path]
    # Diagnoses made during Refine lack spectra.
    numbers = [node.number for node in path]
    known = [session.diagnosis_of(number) if session.is_diagnosed(number) else None for number in numbers]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "report.html"
        write(fits, place, progress, names, known)
        return Made("report.html", place.read_bytes(), "text/html; charset=utf-8")


def _tables(session: Session) -> bytes:
    origin = Path("fit.json")
    return export(fitted_arm(session.fit_of(session.at).document, origin), ExportOptions(), origin).image


def _fit(session: Session) -> bytes:
    return (json.dumps(session.fit_of(session.at).document, indent=1) + "\n").encode()


def _as_yaml(session: Session, node: Node) -> bytes:
    """A model of the session as model.yaml."""
    document = session.fit_of(node.number).document
    model = document["model"]
    shown: dict[str, Any] = {
        "effects": [entry["effect"] if len(entry) == 1 else entry for entry in model["effects"]]
    }
    shown |= {key: model[key] for key in ("parameters", "priors") if model.get(key)}
    if instrument := document["options"].get("instrument"):
        shown["instrument"] = instrument
    return _yaml(shown)


def _yaml(document: dict[str, Any]) -> bytes:
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True).encode()


def _commands(session: Session, data: str) -> str:
    """The path from the first model to this one as commands, with the arm and the models that they read.

    `data`: where they find the measurements.
    """
    robot = _yaml(session.fit_of(session.at).document["robot"])
    lines = ["#!/bin/sh", "# The session as commands.", "set -e", *_here("session-robot.yaml", robot)]
    for k, node in enumerate(session.path):
        lines += _step_commands(session, node, k, data)
    last = len(session.path) - 1
    # A report shows steps of one calibration, all fitted to the same measurements.
    same = [k for k, node in enumerate(session.path) if node.left_out == session.node.left_out]
    lines += [
        f"armtrue report {' '.join(f'step-{k}.json' for k in same)} --out report.html",
        f"armtrue export step-{last}.json --out tables.bin",
    ]
    return "\n".join(lines) + "\n"


def _here(name: str, content: bytes) -> list[str]:
    """Lines that write a file."""
    return [f"cat > {name} <<'ARMTRUE'", content.decode().rstrip("\n"), "ARMTRUE"]


def _step_commands(session: Session, node: Node, number: int, data: str) -> list[str]:
    before = session.nodes[node.parent] if node.parent is not None else None
    changes = [("remove", entry) for entry in node.removed] + [("add", entry) for entry in node.added]
    if before is None or before.left_out != node.left_out or not changes:
        model = f"step-{number}-model.yaml"
        words = ["armtrue", "fit", data, "--robot", "session-robot.yaml", "--model", model]
        if rows := sorted({*session.data.left_out, *node.left_out}):
            words += ["--leave-out", ",".join(map(str, rows))]
        fitted = shlex.join([*words, "--out", f"step-{number}.json"])
        return [f"# {node.change}", *_here(model, _as_yaml(session, node)), fitted]
    lines = []
    for k, (command, entry) in enumerate(changes):
        source = f"step-{number - 1}.json" if k == 0 else f"step-{number}.json"
        words = ["armtrue", command, source, entry["effect"]]
        if entry.get("joints"):
            words += ["--joints", ",".join(map(str, entry["joints"]))]
        for option in option_words(entry):
            words += ["--option", option]
        lines.append(shlex.join([*words, "--out", f"step-{number}.json"]))
    return lines


def _notebook(session: Session, data: str) -> bytes:
    """The path from the first model to this one as a notebook that reads only the measurements at `data`."""
    path = session.path
    robot = json.dumps(session.fit_of(session.at).document["robot"])
    cells = [
        "import json\n\nfrom armtrue import diagnose, fit, load_data\nfrom armtrue.fitting import with_effects\n"
        "from armtrue.io import Model, Robot\n\n"
        f"robot = Robot(json.loads({robot!r}))\n"
        f"data = load_data({data!r}, robot){_without(session.data.left_out)}\n",
    ]
    for node in path:
        before = session.nodes[node.parent] if node.parent is not None else None
        model = session.fit_of(node.number).document
        arguments = [repr(node.effects)]
        for key in ("parameters", "priors"):
            arguments += [f"{key}={model['model'][key]!r}"] if model["model"].get(key) else []
        if model["options"].get("instrument"):
            arguments.append(f"instrument={model['options']['instrument']!r}")
        if before is not None and before.left_out == node.left_out:
            made = f"with_effects(model, {node.effects!r})"
        else:
            made = f"fit(data{_without(node.left_out)}, robot, Model({', '.join(arguments)}))"
        heading = "\n".join(f"# {line}" for line in (node.name or node.change).splitlines())
        cells.append(f"{heading}\nmodel = {made}\nmodel")
    cells.append("diagnose(model)")
    document = {
        "nbformat": 4,
        "nbformat_minor": 5,
        "metadata": {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}},
        "cells": [
            {
                "cell_type": "code", "id": f"step{k}", "metadata": {}, "execution_count": None, "outputs": [],
                "source": text.splitlines(keepends=True),
            }
            for k, text in enumerate(cells)
        ],
    }  # fmt: skip
    return (json.dumps(document, indent=1) + "\n").encode()


def _without(rows: list[int]) -> str:
    return f".without({rows!r})" if rows else ""
