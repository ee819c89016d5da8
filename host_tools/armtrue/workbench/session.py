"""The session: a tree of all models that were tried, in a folder from which a killed server can resume."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from armtrue.errors import InputError
from armtrue.fitting import Fit
from armtrue.io import Dataset
from armtrue.io.files import read_text, write_file
from armtrue.verdicts import scored_mean_um

FORMAT = "armtrue-session"
VERSION = 1
# Fits and diagnoses held in memory; others are read again from the session's folder.
_HELD = 4
_LARGEST_BYTES = 512 * 1024 * 1024


@dataclass
class Node:
    """One model of the tree: its changes relative to its parent, its error, and the name that the user gave it.

    `effects`, `added`, `removed`: entries of model.yaml. `left_out`: rows of the file that the user marked as wrong.
    `error`: as in fit.json. `verdict`: None until the model is diagnosed. `said`: the sentence about the error. `redo`:
    the child that Redo goes to. `left_out_error`: the error of the prediction at the rows left out, None where there
    are none. `turn_error_rad`: error of orientation of the fitted rows, None where no orientations were measured.
    """

    number: int
    parent: int | None
    effects: list[dict[str, Any]]
    added: list[dict[str, Any]]
    removed: list[dict[str, Any]]
    left_out: list[int]
    error: dict[str, Any]
    noise_floor_um: float | None
    verdict: str | None
    change: str
    said: str
    name: str = ""
    redo: int | None = None
    left_out_error: dict[str, Any] | None = None
    turn_error_rad: dict[str, float] | None = None

    @property
    def mean_um(self) -> float | None:
        """Mean error on held-out poses; None where none could be scored."""
        return scored_mean_um(self.error["held_out"])


@dataclass
class Session:
    """The tree of models in `folder`. `key` tells which files it was begun with; `data` are their measurements.

    `beside`: what the page shows beside the tree, such as planned poses, as JSON; in it `joined`: files of the sessions
    in which further measurements joined these.
    """

    folder: Path
    key: str
    data: Dataset
    nodes: list[Node] = field(default_factory=list)
    at: int = 0
    beside: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._held: OrderedDict[int, tuple[Fit, dict[str, Any] | None]] = OrderedDict()
        self._worked_out: dict[int, dict[str, Any]] = {}
        self._lock = threading.RLock()  # a diagnosis may be stored while an action runs

    @property
    def node(self) -> Node:
        """The shown model."""
        return self.nodes[self.at]

    @property
    def path(self) -> list[Node]:
        """Models from the first to the shown one."""
        return self.path_to(self.at)

    def path_to(self, number: int) -> list[Node]:
        """Models from the first to this one."""
        found = [self.nodes[number]]
        while (parent := found[-1].parent) is not None:
            found.append(self.nodes[parent])
        return found[::-1]

    def children(self, number: int) -> list[Node]:
        """Models that were made from `number`, oldest first."""
        return [node for node in self.nodes if node.parent == number]

    def put(self, node: Node, fit: Fit, diagnosis: dict[str, Any] | None = None) -> None:
        """Add a model below its parent and go to it; it is on disk when this returns."""
        with self._lock:
            self._write(node.number, fit, diagnosis)
            self.nodes.append(node)
            self.go(node.number)

    def diagnosed(self, number: int, diagnosis: dict[str, Any]) -> None:
        """Store the diagnosis of a model that was added without one, or with an incomplete one."""
        with self._lock:
            self._write(number, self.fit_of(number), diagnosis)
            self.nodes[number].verdict = str(diagnosis["verdict"])
            self.save()

    def worked_out(self, number: int, name: str, work: Callable[[], Any]) -> Any:
        """The result of `work` for a model, cached under `name` as long as the model is held in memory."""
        kept = self._worked_out.setdefault(number, {})
        if name not in kept:
            kept[name] = work()
        return kept[name]

    def is_diagnosed(self, number: int) -> bool:
        """True where the whole diagnosis of a model is known; those made during Refine lack spectra."""
        diagnosis = self.diagnosis_of(number)
        return diagnosis is not None and "spectra" in diagnosis

    def _write(self, number: int, fit: Fit, diagnosis: dict[str, Any] | None) -> None:
        models = self.folder / "models"
        models.mkdir(parents=True, exist_ok=True)
        content = {"fit": fit.document, "diagnosis": diagnosis}
        write_file(models / f"{number}.json", json.dumps(content) + "\n")
        self._hold(number, fit, diagnosis)

    def go(self, number: int) -> None:
        """Show another model; Redo then follows the path to it."""
        if not 0 <= number < len(self.nodes):
            raise InputError(f"session: found no model {number}, expected 0 to {len(self.nodes) - 1}")
        self.at = number
        for before, after in pairwise(self.path):
            before.redo = after.number
        self.save()

    def keep(self, beside: dict[str, Any]) -> None:
        """Save the entries of `beside` in the session's file; its other entries stay."""
        with self._lock:
            kept = {**self.beside, **beside}
            if kept != self.beside:
                self.beside = kept
                self.save()

    def fit_of(self, number: int) -> Fit:
        """The fit of a model, with its measurements."""
        return self._content(number)[0]

    def diagnosis_of(self, number: int) -> dict[str, Any] | None:
        """The diagnosis of a model; None where it is not finished yet."""
        return self._content(number)[1]

    def save(self) -> None:
        """Write the tree."""
        with self._lock:
            document = {
                "format": FORMAT,
                "version": VERSION,
                "key": self.key,
                "at": self.at,
                "beside": self.beside,
                "nodes": [asdict(node) for node in self.nodes],
            }
            self.folder.mkdir(parents=True, exist_ok=True)
            write_file(self.folder / "session.json", json.dumps(document) + "\n")

    def _content(self, number: int) -> tuple[Fit, dict[str, Any] | None]:
        with self._lock:
            if number not in self._held:
                path = self.folder / "models" / f"{number}.json"
                try:
                    content = json.loads(read_text(path, largest_bytes=_LARGEST_BYTES))
                    fit = Fit(content["fit"], None, self.data.without(self.nodes[number].left_out))
                    self._hold(number, fit, content["diagnosis"])
                except (ValueError, KeyError, TypeError):
                    raise InputError(
                        f"{path}: found no model of a session, expected it as it was written"
                    ) from None
            self._held.move_to_end(number)
            return self._held[number]

    def _hold(self, number: int, fit: Fit, diagnosis: dict[str, Any] | None) -> None:
        self._held[number] = (fit, diagnosis)
        while len(self._held) > _HELD:
            oldest, _ = self._held.popitem(last=False)
            self._worked_out.pop(oldest, None)


def load_session(folder: Path, key: str, data: Dataset) -> Session | None:
    """The session kept in `folder` for the files of `key`; None where none can be resumed."""
    path = folder / "session.json"
    if not path.is_file():
        return None
    try:
        document = json.loads(read_text(path))
        if (document["format"], document["version"], document["key"]) != (FORMAT, VERSION, key):
            return None
        nodes = [Node(**node) for node in document["nodes"]]
        session = Session(folder, key, data, nodes, int(document["at"]), dict(document.get("beside") or {}))
        whole = bool(nodes) and all((folder / "models" / f"{node.number}.json").is_file() for node in nodes)
        return session if whole and 0 <= session.at < len(nodes) else None
    except (ValueError, KeyError, TypeError):
        return None


def joined_files(session: Session) -> list[str]:
    """Files of the sessions in which further measurements joined those of `session`, oldest first."""
    kept = session.beside.get("joined") or []
    return [kept] if isinstance(kept, str) else [str(file) for file in kept]


def key_of(files: list[Path]) -> str:
    """Digest that identifies a set of files: their contents, and their paths (of dropped files only the names)."""
    digest = hashlib.sha256()
    for file in files:
        place = file.resolve()
        # Dropped files are in another folder each time.
        dropped = _state_folder().resolve() in place.parents
        digest.update(os.fsencode(place.name if dropped else place))
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def default_folder(key: str) -> Path:
    """Where a session is kept by default: in the user's state folder, never beside the measurements."""
    return _state_folder() / key


def _state_folder() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state) / "armtrue" / "workbench"
