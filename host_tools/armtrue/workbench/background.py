"""The diagnosis of the model that is looked at, worked out in the background: the page shows its figures meanwhile."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from armtrue.diagnosis import diagnose
from armtrue.errors import InputError
from armtrue.progress import Progress
from armtrue.report.gathered.state import directions, tiny_levers, variables
from armtrue.workbench.allocator import give_back
from armtrue.workbench.session import Session
from armtrue.workbench.showing.beside import bayesian_information

FAULT = "A fault of the workbench: the session is as it was before. The terminal says more."
_NICE = 5
_LOOK_UP_S = 0.1


class CancelledError(Exception):
    """The person stopped what ran, or began something else."""


@dataclass
class Task:
    """What is running: its name, the share done, and what that is in words."""

    name: str
    share: float = 0.0
    stage: str = ""


@dataclass
class _Run:
    """One diagnosis under way."""

    session: Session
    number: int
    politely: bool
    task: Task = field(default_factory=lambda: Task("diagnose", stage="begins"))
    cancelled: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)


class Background:
    """At most one diagnosis that counts. `failure`: why the last one ended without a result.

    One that is stopped ends when the library next looks up, which nobody waits for.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self.failure = ""
        self._changed = changed
        self._now: _Run | None = None
        # Diagnoses that were stopped one after the other would share the processors, and hold memory side by side.
        self._one_at_a_time = threading.Lock()
        self._stopped: tuple[str, int] | None = None

    @property
    def task(self) -> Task | None:
        """What runs now; None where nothing does."""
        return self._now.task if self._now is not None else None

    def start(self, session: Session, politely: bool) -> None:
        """Begin to diagnose the model that is looked at, unless that is known or the person stopped it before.

        `politely`: the page and the fits go first.
        """
        number = session.at
        if self._now is not None or session.is_diagnosed(number) or self._stopped == (session.key, number):
            return
        self.failure = ""
        run = self._now = _Run(session, number, politely)
        threading.Thread(target=self._run, args=(run,), name="workbench diagnose", daemon=True).start()

    def wait(self, seconds: float) -> bool:
        """Wait until the diagnosis has ended, or so long; True where none runs any more."""
        run = self._now
        return run is None or run.ended.wait(seconds)

    def stop(self) -> None:
        """Let go of the diagnosis: it may begin anew later."""
        run, self._now = self._now, None
        if run is not None:
            run.cancelled.set()

    def stop_for_good(self, session: Session) -> None:
        """Let go of the diagnosis as the person asked, so that it does not begin by itself."""
        self._stopped = (session.key, session.at)
        self.stop()
        self._changed()

    def allow(self) -> None:
        """Let what was stopped begin again."""
        self._stopped = None

    def _run(self, run: _Run) -> None:
        if run.politely and sys.platform == "linux":
            # The library's threads inherit this one's priority.
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)

        def tell(share: float, stage: str) -> None:
            if run.cancelled.is_set():
                raise CancelledError
            run.task.share, run.task.stage = share, stage
            self._changed()

        failure = ""
        try:
            while not self._one_at_a_time.acquire(timeout=_LOOK_UP_S):
                tell(0.0, "waits for the diagnosis that was stopped")
            try:
                self._diagnose(run, tell)
            finally:
                self._one_at_a_time.release()
        except CancelledError:
            pass
        except InputError as error:
            failure = str(error)
        except Exception:
            logging.getLogger(__name__).exception("a diagnosis failed")
            failure = FAULT
        finally:
            give_back()
            if self._now is run:
                self._now, self.failure = None, failure
            run.ended.set()
            self._changed()

    def _diagnose(self, run: _Run, tell: Progress) -> None:
        fit = run.session.fit_of(run.number)
        # What charts read is kept with the fit: they need not wait until the library is free again.
        fit.residuals()
        variables(fit)
        directions(fit)
        tiny_levers(fit)
        bayesian_information(run.session, run.number)
        run.session.diagnosed(run.number, diagnose(fit, tell))
