"""One action at a time: each makes a model with its diagnosis, beside the page, which goes on answering."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armtrue.diagnosis import diagnose, refine
from armtrue.errors import InputError
from armtrue.fitting import Fit, with_effects
from armtrue.io.model import check_effect
from armtrue.progress import Progress
from armtrue.workbench.dropped import Drop
from armtrue.workbench.further import Result, compared, planned, rows_between
from armtrue.workbench.names import change_words, model_entry
from armtrue.workbench.opening import Opened
from armtrue.workbench.outputs import Made, make
from armtrue.workbench.session import Node, Session, default_folder, key_of, load_session

Entry = dict[str, Any]

FAULT = "A fault of the workbench: the session is as it was before. The terminal says more."


class CancelledError(Exception):
    """The person stopped the running action."""


class BusyError(InputError):
    """An action is asked for while another runs."""


@dataclass
class Task:
    """What is running: its name, the share done, and what that is in words."""

    name: str
    share: float = 0.0
    stage: str = ""


class Engine:
    """The session and the one action that may run on it. `version` grows whenever there is something new to see."""

    def __init__(self, drop: Drop) -> None:
        self.drop = drop
        self.title = "Armtrue"
        self.about = "nothing is open yet"
        self.notes: list[str] = []
        self._session: Session | None = None
        self.said = ""
        self.failure = ""
        self.made: Made | None = None
        self.result: Result | None = None
        self.task: Task | None = None
        self.version = 1
        self.changed = threading.Condition(threading.RLock())
        self._cancel = threading.Event()
        self._worker: threading.Thread | None = None

    @property
    def session(self) -> Session:
        """The session that is open. Errors: InputError where none is."""
        if self._session is None:
            raise InputError("found nothing opened, expected measurements or a fit to be opened first")
        return self._session

    @property
    def is_open(self) -> bool:
        """True where there is a session."""
        return self._session is not None

    @property
    def shown(self) -> str:
        """What tells one model of one session from any other."""
        return f"{self.session.key}/{self.session.at}" if self.is_open else "none"

    def begin(
        self, opened: Opened, folder: Path | None = None, new: bool = False, progress: Progress | None = None
    ) -> None:
        """Go on with the session of these files, or fit and diagnose them; a session that is open stays until then.

        `folder`: where it is kept, if not where sessions are. Errors: InputError where that cannot be written, or the
        data cannot carry the model.
        """
        key = key_of(opened.files)
        place = folder or default_folder(key)
        if place.exists() and not place.is_dir():
            raise InputError(f"--session: found a file '{place}', expected a folder")
        session = None if new else load_session(place, key, opened.data)
        if session:
            said = f"The session is gone on with. {session.node.said}"
        else:
            session = self._begun(opened, Session(place, key, opened.data), progress)
            said = session.node.said
        self._session, self.said, self.notes, self.result = session, said, opened.notes, None
        self.title = str(opened.robot.spec.get("name", "robot"))
        self.about = f"{opened.data.file.name}: {opened.data.count} measurements"

    def _begun(self, opened: Opened, session: Session, progress: Progress | None) -> Session:
        """A session with the fits of `opened`, steps of one calibration one below the other."""
        fits = opened.first_fits(progress)
        try:
            for fit in fits:
                diagnosis = diagnose(fit, progress)
                session.put(node_of(session, fit, diagnosis), fit, diagnosis)
        except OSError as error:
            raise InputError(f"{session.folder}: cannot be written ({error.strerror})") from None
        return session

    def do(self, action: str, words: Entry) -> None:
        """Begin an action; returns at once. Errors: BusyError; InputError where it makes no sense here."""
        if action == "cancel":
            self._cancel.set()
            return
        work = self._work_of(action, words)
        with self.changed:
            if self.task is not None:
                raise BusyError(
                    f"{action}: found {self.task.name} still running, expected it to end or be cancelled"
                )
            self._cancel.clear()
            self.task = Task(action)
            self.failure = ""
            self._announce()
        self._worker = threading.Thread(
            target=self._run, args=(work,), name=f"workbench {action}", daemon=True
        )
        self._worker.start()

    def take(self, name: str, content: bytes) -> None:
        """Keep a file that was dropped. Errors: InputError where its name will not do."""
        self.drop.take(name, content)
        self.failure = ""
        self.said = f"{name} is here. Choose more files, or press Open."
        self._announce()

    def wait(self, version: int, seconds: float) -> int:
        """Wait until there is something newer than `version`, or `seconds` have passed."""
        with self.changed:
            self.changed.wait_for(lambda: self.version != version, seconds)
            return self.version

    def tell(self, share: float, stage: str) -> None:
        """Take note of progress. Errors: CancelledError where the person asked for that."""
        if self._cancel.is_set():
            raise CancelledError
        if self.task is not None:
            self.task.share, self.task.stage = share, stage
        self._announce()

    def _announce(self) -> None:
        with self.changed:
            self.version += 1
            self.changed.notify_all()

    def _work_of(self, action: str, words: Entry) -> Callable[[], None]:
        known: dict[str, Callable[[Entry], None]] = {
            "add": self._add,
            "remove": self._remove,
            "undo": self._undo,
            "redo": self._redo,
            "refine": self._refine,
            "go": self._go,
            "name": self._name,
            "leave_out": self._leave_out,
            "make": self._make,
            "leave_out_where": self._leave_out_where,
            "plan": self._plan,
            "compare": self._compare,
            "open": self._open,
            "forget": self._forget,
        }
        if action not in known:
            raise InputError(f"found no action '{action}', expected one of {', '.join(known)}")
        return lambda: known[action](words)

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except CancelledError:
            self.said = f"Stopped. {self.session.node.said}"
        except InputError as error:
            self.failure = str(error)
        except Exception:
            logging.getLogger(__name__).exception("an action failed")
            self.failure = FAULT
        finally:
            with self.changed:
                self.task = None
                self._announce()

    def _add(self, words: Entry) -> None:
        entry = self._candidate(words)
        fit = self.session.fit_of(self.session.at)
        checked = check_effect(entry, fit.robot, "add", already=fit.effects)
        self._change([*fit.effects, checked])

    def _candidate(self, words: Entry) -> Entry:
        """The entry of model.yaml for a candidate by its place in the diagnosis, or as it is given."""
        if "entry" in words:
            entry = words["entry"]
            if not isinstance(entry, dict):
                raise InputError(f"add: found {entry!r}, expected an effect with its joints")
            return entry
        candidates = self.session.diagnosis_of(self.session.at)["candidates"]
        place = _whole(words, "candidate", len(candidates))
        return model_entry(candidates[place])

    def _remove(self, words: Entry) -> None:
        effects = self.session.node.effects
        place = _whole(words, "effect", len(effects))
        if len(effects) == 1:
            raise InputError(f"{effects[0]['effect']} is all that the model has, expected one effect to stay")
        self._change([entry for k, entry in enumerate(effects) if k != place])

    def _change(self, effects: list[Entry]) -> None:
        """Go to the model with these effects: one that was made from here before, or a new one."""
        session = self.session
        for child in session.children(session.at):
            if child.effects == effects and child.left_out == session.node.left_out:
                session.go(child.number)
                self.said = child.said
                return
        before = session.node
        fit = with_effects(session.fit_of(session.at), effects, self.tell)
        self._put(fit, diagnose(fit, self.tell), before)

    def _leave_out(self, words: Entry) -> None:
        rows = words.get("rows")
        if not isinstance(rows, list) or not all(isinstance(row, int) for row in rows):
            raise InputError(f"leave_out: found {rows!r}, expected a list of row numbers")
        session = self.session
        known = set(session.data.rows.tolist())
        if unknown := sorted(set(rows) - known):
            raise InputError(f"leave_out: found row {unknown[0]}, expected a row of {session.data.file.name}")
        before = session.node
        data = session.data_without(sorted(set(rows)))
        bare = Fit(session.fit_of(session.at).document, None, data)
        fit = with_effects(bare, before.effects, self.tell)
        self._put(fit, diagnose(fit, self.tell), before, sorted(set(rows)))

    def _leave_out_where(self, words: Entry) -> None:
        rows = rows_between(self.session.fit_of(self.session.at), words)
        self._leave_out({"rows": [*self.session.node.left_out, *rows]})

    def _plan(self, words: Entry) -> None:
        self._show(planned(self.session.fit_of(self.session.at), words, self.tell))

    def _compare(self, _words: Entry) -> None:
        self._show(compared(self.session.fit_of(self.session.at), self.drop))

    def _show(self, result: Result) -> None:
        self.result, self.said = result, result.said
        if result.made is not None:
            self.made = result.made

    def _undo(self, _words: Entry) -> None:
        node = self.session.node
        if node.parent is None:
            raise InputError("there is nothing to undo")
        self._look(node.parent, f"Undone: {node.change}")

    def _redo(self, _words: Entry) -> None:
        forward = self.session.node.redo
        if forward is None:
            raise InputError("there is nothing to redo")
        self._look(forward, f"Done again: {self.session.nodes[forward].change}")

    def _go(self, words: Entry) -> None:
        self._look(_whole(words, "node", len(self.session.nodes)), "Another model")

    def _look(self, number: int, what: str) -> None:
        before = self.session.node.mean_um
        self.session.go(number)
        self.said = f"{what}. {fall_words(before, self.session.node.mean_um)}"

    def _name(self, words: Entry) -> None:
        node = self.session.nodes[_whole(words, "node", len(self.session.nodes))]
        node.name = str(words.get("name", ""))[:80]
        self.session.save()
        self.said = f"This model is now called {node.name}." if node.name else "This model has no name now."

    def _refine(self, _words: Entry) -> None:
        first = self.session.node.mean_um
        steps = 0

        def keep(fit: Fit, step: Entry) -> None:
            nonlocal steps
            if fit.effects != self.session.node.effects:
                self._put(
                    fit, {k: v for k, v in step.items() if k not in ("added", "removed")}, self.session.node
                )
                self._announce()
                steps += 1

        refine(self.session.fit_of(self.session.at), self.tell, keep)
        node = self.session.node
        what = f"Refined in {steps} steps" if steps != 1 else "Refined in one step"
        self.said = (
            f"{what}. {fall_words(first, node.mean_um)}"
            if steps
            else "Refine found nothing to add or remove."
        )

    def _open(self, words: Entry) -> None:
        text = words.get("text")
        opened = self.drop.open(text if isinstance(text, str) else None)
        if opened is None:
            self.said = "The files are not in Armtrue's own form: look at what was guessed, then open them."
            return
        self.begin(opened, progress=self.tell)
        self.drop.forget()

    def _forget(self, _words: Entry) -> None:
        self.drop.forget()
        self.said = "The files are put aside."

    def _make(self, words: Entry) -> None:
        self.made = None
        self.made = make(self.session, str(words.get("name")), self.tell)
        size = max(1, round(len(self.made.content) / 1000))
        mean = self.session.node.mean_um
        self.said = f"{self.made.name} is made ({size} kB). The held-out mean error is {mean:.1f} µm."

    def _put(
        self, fit: Fit, diagnosis: Entry, before: Node | None, left_out: list[int] | None = None
    ) -> None:
        node = node_of(self.session, fit, diagnosis, before, left_out)
        self.session.put(node, fit, diagnosis)
        self.said = node.said


def node_of(
    session: Session,
    fit: Fit,
    diagnosis: Entry,
    before: Node | None = None,
    left_out: list[int] | None = None,
) -> Node:
    """The next node of `session`, below `before` or else below the one that is looked at."""
    before = before or (session.node if session.nodes else None)
    effects = fit.effects
    old = before.effects if before else []
    added = [entry for entry in effects if entry not in old] if before else []
    removed = [entry for entry in old if entry not in effects]
    out = left_out if left_out is not None else before.left_out if before else []
    change = change_words(added, removed) or _left_out_words(out, before)
    error = fit.document["error"]
    mean = float(error["held_out"]["mean_um"])
    upper = change[0].upper() + change[1:]
    said = f"{upper}. {fall_words(before.mean_um, mean)}" if before else _first_words(mean)
    floor = fit.document["noise_floor"]["um"]
    return Node(
        len(session.nodes), before.number if before else None, effects, added, removed, out, error, floor,
        str(diagnosis["verdict"]), change, said,
    )  # fmt: skip


def fall_words(before_um: float, after_um: float) -> str:
    """What became of the error."""
    share = 100.0 * (after_um / before_um - 1.0) if before_um else 0.0
    figures = f"from {before_um:.1f} to {after_um:.1f} µm"
    if abs(share) < 0.5:
        return f"The held-out mean error stays at {after_um:.1f} µm."
    change = f"{share:+.0f} %".replace("-", "−")
    return f"The held-out mean error {'fell' if share < 0 else 'rose'} {figures} ({change})."


def _first_words(mean_um: float) -> str:
    return f"The model is fitted. The held-out mean error is {mean_um:.1f} µm."


def _left_out_words(rows: list[int], before: Node | None) -> str:
    if before is None:
        return "as it stood"
    if rows == before.left_out:
        return "the same effects, fitted again"
    words = ", ".join(map(str, rows[:5])) + (" and more" if len(rows) > 5 else "")
    return f"left out: {len(rows)} rows ({words})" if rows else "all rows take part again"


def _whole(words: Entry, key: str, count: int) -> int:
    value = words.get(key)
    if not isinstance(value, int) or not 0 <= value < count:
        raise InputError(f"{key}: found {value!r}, expected a number from 0 to {count - 1}")
    return value
