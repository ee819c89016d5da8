"""Runs one action at a time on the open session, on its own thread, so that the page stays responsive."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from armtrue.errors import InputError
from armtrue.io import Robot, load_data
from armtrue.io.files import read_text, write_file
from armtrue.progress import Progress
from armtrue.units import plural
from armtrue.workbench.actions import BESIDE_A_DIAGNOSIS, WORK, node_of
from armtrue.workbench.allocator import give_back
from armtrue.workbench.background import FAULT, Background, CancelledError, Task
from armtrue.workbench.compensator import Device
from armtrue.workbench.first_figures import FirstFigures
from armtrue.workbench.lock import HeldElsewhereError, SessionLocks
from armtrue.workbench.opening.dropped import Drop
from armtrue.workbench.opening.opened import Opened
from armtrue.workbench.outputs import Made
from armtrue.workbench.session import Session, default_folder, joined_files, key_of, load_session
from armtrue.workbench.showing.further import Result

Entry = dict[str, Any]
Linked = tuple[Session, Opened]

# Up to this many measurements a diagnosis takes a moment, and the action ends with it. The page has its figures before;
# the wait is limited for a machine that is busy with other work.
_AT_ONCE_ROWS = 1000
_AT_ONCE_S = 60.0
_LOOK_UP_S = 0.1


class BusyError(InputError):
    """An action is asked for while another runs."""


class Engine:
    """The session and the one action that may run on it. `version` grows whenever there is something new to see."""

    def __init__(self, drop: Drop, device: Device | None = None) -> None:
        self.drop = drop
        self.device = device
        self.title = "Armtrue"
        self.about = "nothing is open yet"
        self.notes: list[str] = []
        # Number of ended actions. The page redraws when it grows, because of a short action it sees only the end.
        self.ended = 0
        self._session: Session | None = None
        self._locks = SessionLocks()
        self._waiting_lock = SessionLocks()
        # The sessions before and after further measurements joined, the latest last.
        self.linked: list[Linked] = []
        self.said = ""
        self.failure = ""
        self.made: Made | None = None
        # The new model, fitted to some of the measurements, until the fit to all of them is finished.
        self.first_figures: FirstFigures | None = None
        self.result: Result | None = None
        self.task: Task | None = None
        self.version = 1
        self.changed = threading.Condition(threading.RLock())
        self.background = Background(self.announce)
        self._cancel = threading.Event()
        self.pausing = threading.Event()
        self._worker: threading.Thread | None = None

    @property
    def session(self) -> Session:
        """The open session. Errors: InputError where none is."""
        if self._session is None:
            raise InputError("found nothing opened, expected measurements or a fit to be opened first")
        return self._session

    @property
    def robot(self) -> Robot:
        """The arm with which the open session was opened. Errors: InputError where none is."""
        return next(opened.robot for session, opened in self.linked if session is self.session)

    @property
    def own_device(self) -> Device:
        """The connected compensator. Errors: InputError where none is."""
        if self.device is None:
            raise InputError("device: found none, expected armtrue open with --interface and --channel")
        return self.device

    @property
    def is_open(self) -> bool:
        """True where there is a session."""
        return self._session is not None

    @property
    def shown(self) -> str:
        """Identifier of the shown model, unique among all sessions."""
        return f"{self.session.key}/{self.session.at}" if self.is_open else "none"

    @property
    def known(self) -> str:
        """`shown`, and how much of its diagnosis is known, or that the page shows first figures of another model."""
        if not self.is_open:
            return "none"
        if self.first_figures is not None:
            return f"{self.shown}/first figures"
        diagnosis = self.session.diagnosis_of(self.session.at)
        much = "nothing" if diagnosis is None else "all" if "spectra" in diagnosis else "some"
        return f"{self.shown}/{much}"

    def is_at(self, address: str) -> None:
        """Note the address of the page: another workbench that wants an open session names it."""
        self._locks.address = address

    def begin(
        self,
        opened: Opened,
        folder: Path | None = None,
        new: bool = False,
        progress: Progress | None = None,
        linked: Sequence[Linked] = (),
    ) -> None:
        """Resume the session of these files, or fit them; a session that is open stays until then.

        `folder`: where the session is kept, if not in the default folder. `linked`: sessions to which the page links
        back. Errors: InputError where the folder cannot be written, or the data do not allow the model.
        """
        key = key_of(opened.files)
        place = folder or default_folder(key)
        if place.exists() and not place.is_dir():
            raise InputError(f"--session: found a file '{place}', expected a folder")
        try:
            self._locks.hold(place)
            session = None if new else load_session(place, key, opened.data)
            if session:
                found = self._joined_since(session, opened)
                said = f"The saved session continues. {found[-1][0].node.said}"
            else:
                found = [(self._begun(opened, Session(place, key, opened.data), progress), opened)]
                said = found[-1][0].node.said
            ours = {each.folder for each, _ in found}
            self.linked = [*(each for each in linked if each[0].folder not in ours), *found]
        finally:
            self._locks.keep({each.folder for each, _ in self.linked})
        self.look_at(*self.linked[-1])
        self.said = said
        self._diagnose()

    def look_at(self, session: Session, opened: Opened) -> None:
        """Show a session that is open."""
        self.background.stop()
        self._session, self.notes = session, opened.notes
        self._go_on(session.beside)
        self.title = str(opened.robot.spec.get("name", "robot"))
        self.about = f"{opened.data.file.name}: {plural(opened.data.count, 'measurement')}"

    def _joined_since(self, session: Session, opened: Opened) -> list[Linked]:
        """`session` and those in which further measurements joined it, the latest last; their folders are locked."""
        found = [(session, opened)]
        for file in joined_files(session):
            path = Path(file)
            if not path.is_file():
                continue
            data = load_data(path, opened.robot)
            key = key_of([path])
            went_on = load_session(default_folder(key), key, data)
            if went_on is not None:
                self._locks.hold(went_on.folder)
                note = f"{path.name}: measurements joined since; History leads back to {opened.data.file.name} alone"
                later = replace(opened, data=data, files=[path], notes=[*opened.notes, note])
                found += self._joined_since(went_on, later)
        return found

    def _go_on(self, beside: Entry) -> None:
        """Restore what the session's file holds beside the tree, if it can be read."""
        self.result = None
        try:
            if beside.get("result"):
                self.result = Result.of_json(beside["result"])
            if beside.get("dropped"):
                self.drop.go_on(beside["dropped"])
        except (InputError, KeyError, TypeError, AttributeError):
            self.drop.forget()
            self.notes = [*self.notes, "What was planned or dropped last could not be read again."]

    def _keep(self) -> None:
        """Save all that the page shows in the session's file."""
        result = self.result.as_json() if self.result else None
        dropped = self.drop.as_json() if self.drop.names else None
        try:
            if self._session is None:
                self.keep_waiting()
            else:
                self._session.keep({"result": result, "dropped": dropped})
        except (OSError, InputError) as error:
            self.failure = f"the session cannot be kept: {error}"

    def _begun(self, opened: Opened, session: Session, progress: Progress | None) -> Session:
        """`session` with the fits of `opened`, each the child of the one before."""
        fits = opened.first_fits(progress)
        try:
            for fit in fits:
                session.put(node_of(session, fit), fit)
        except OSError as error:
            raise InputError(f"{session.folder}: cannot be written ({error.strerror})") from None
        return session

    def do(self, action: str, words: Entry) -> None:
        """Start an action and return at once. Errors: BusyError; InputError where it is unknown or not possible now."""
        if action == "cancel":
            self._stop()
            return
        if action == "pause":
            self._pause()
            return
        if action not in WORK:
            raise InputError(f"found no action '{action}', expected one of {', '.join(WORK)}")
        with self.changed:
            if self.task is not None:
                raise BusyError(
                    f"{action}: found {self.task.name} still running, expected it to end or be cancelled"
                )
            self._cancel.clear()
            self.pausing.clear()
            self.task = Task(action)
            self.failure = ""
            self.announce()
        self._worker = threading.Thread(
            target=self._run, args=(action, words), name=f"workbench {action}", daemon=True
        )
        self._worker.start()

    def take(self, name: str, content: bytes) -> None:
        """Keep a file that was dropped. Errors: InputError where its name is not allowed."""
        self.drop.take(name, content)
        self.failure = ""
        self.said = f"{name} is here. Choose more files, or press Open."
        self._keep()
        self.announce()

    def take_draft(self, words: Entry) -> None:
        """Keep the contents of the form of guesses. Errors: InputError where there is no such form."""
        with self.changed:  # no page sees it before it is on disk
            self.drop.take_draft(words)
            self._keep()

    @property
    def draft(self) -> Entry:
        """The kept contents of the form of guesses."""
        with self.changed:
            return self.drop.draft

    def _waiting_list(self) -> Path | None:
        """The list of files that wait to be opened, locked; None while another workbench without a session has it."""
        folder = default_folder("waiting")
        try:
            self._waiting_lock.hold(folder)
        except HeldElsewhereError:
            return None
        return folder / "files.json"

    def keep_waiting(self) -> None:
        """Save which files wait to be opened. Errors: InputError or OSError where that cannot be written."""
        if place := self._waiting_list():
            if self.drop.names:
                write_file(place, json.dumps(self.drop.as_json()) + "\n")
            else:
                place.unlink(missing_ok=True)
        self._let_others_wait()

    def go_on_waiting(self) -> None:
        """Restore the files that were dropped before anything was opened; an unreadable list is ignored."""
        try:
            place = self._waiting_list()
            if place and place.is_file():
                self.drop.go_on(json.loads(read_text(place)))
        except (InputError, ValueError, KeyError, TypeError, AttributeError):
            self.drop.forget()
        if self.drop.names:
            self.said = "The files that were dropped last wait to be opened."
        self._let_others_wait()

    def _let_others_wait(self) -> None:
        if not self.drop.names:
            self._waiting_lock.keep(set())

    def wait(self, version: int, seconds: float) -> int:
        """Wait until there is something newer than `version`, or `seconds` have passed."""
        with self.changed:
            self.changed.wait_for(lambda: self.version != version, seconds)
            return self.version

    def tell(self, share: float, stage: str) -> None:
        """Record progress. Errors: CancelledError where the user cancelled the action."""
        if self._cancel.is_set():
            raise CancelledError
        if self.task is not None:
            self.task.share, self.task.stage = share, stage
        self.announce()

    def show_first_figures(self, figures: FirstFigures) -> None:
        """Show a model from some of the measurements while the action fits it to all of them."""
        self.first_figures = figures
        self.said = figures.said
        self.announce()

    def announce(self) -> None:
        """Make every open page update."""
        with self.changed:
            self.version += 1
            self.changed.notify_all()

    def _stop(self) -> None:
        """Cancel the running action, or else the diagnosis."""
        with self.changed:
            if self.task is not None:
                self._cancel.set()
            elif self.background.task is not None:
                self.background.stop_for_good(self.session)

    def _pause(self) -> None:
        """Make Refine end after its current step. Errors: InputError where it does not run."""
        with self.changed:
            if self.task is None or self.task.name != "refine":
                raise InputError("pause: found no Refine that runs, expected it to be begun first")
            self.pausing.set()
            self.announce()

    def _run(self, action: str, words: Entry) -> None:
        try:
            if action not in BESIDE_A_DIAGNOSIS:
                self.background.stop()
            WORK[action](self, words)
        except CancelledError:
            self.said = f"Stopped. {self.session.node.said}"
        except InputError as error:
            self.failure = self.drop.without_place(str(error))
        except Exception:
            logging.getLogger(__name__).exception("an action failed")
            self.failure = FAULT
        finally:
            self.first_figures = None
            self._keep()
            give_back()
            self._diagnose()
            with self.changed:
                self.task = None
                self.ended += 1
                self.announce()

    def _diagnose(self) -> None:
        """Start the diagnosis of the shown model; with few measurements, wait for the result."""
        if not self.is_open:
            return
        at_once = self.session.data.count <= _AT_ONCE_ROWS
        self.background.start(self.session, politely=not at_once)
        self.announce()  # the page shows the new figures during the diagnosis
        self._cancel.clear()  # a cancelled action does not cancel its diagnosis
        end = time.monotonic() + _AT_ONCE_S
        while at_once and time.monotonic() < end and not self.background.wait(_LOOK_UP_S):
            if self._cancel.is_set():
                self.background.stop_for_good(self.session)
