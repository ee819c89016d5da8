"""The diagnosis of the shown model, in the background: the page shows the model's figures meanwhile."""

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
    """The user stopped the task, or started another."""


@dataclass
class Task:
    """A running task: its name, the share done, and its stage in words."""

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
    """Runs diagnoses, at most one of them current. `failure`: why the last one ended without a result.

    A stopped diagnosis ends at the library's next report of progress; nothing waits for that.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self.failure = ""
        self._changed = changed
        self._now: _Run | None = None
        # Stopped diagnoses that have not ended yet would share the processors and the memory with the next one.
        self._one_at_a_time = threading.Lock()
        self._stopped: tuple[str, int] | None = None

    @property
    def task(self) -> Task | None:
        """The running task; None where there is none."""
        return self._now.task if self._now is not None else None

    def start(self, session: Session, politely: bool) -> None:
        """Start to diagnose the shown model, unless one runs, the result is known or the user stopped it before.

        `politely`: at a lower priority than the page and the fits.
        """
        number = session.at
        if self._now is not None or session.is_diagnosed(number) or self._stopped == (session.key, number):
            return
        self.failure = ""
        run = self._now = _Run(session, number, politely)
        threading.Thread(target=self._run, args=(run,), name="workbench diagnose", daemon=True).start()

    def wait(self, seconds: float) -> bool:
        """Wait until the diagnosis has ended, or `seconds` have passed; True where none runs any more."""
        run = self._now
        return run is None or run.ended.wait(seconds)

    def stop(self) -> None:
        """Stop the diagnosis; it may start again later."""
        run, self._now = self._now, None
        if run is not None:
            run.cancelled.set()

    def stop_for_good(self, session: Session) -> None:
        """Stop the diagnosis at the user's request; it does not start again by itself."""
        self._stopped = (session.key, session.at)
        self.stop()
        self._changed()

    def allow(self) -> None:
        """Allow a diagnosis that the user stopped to start again."""
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
        # Arrays that charts read are cached first: the charts then need not wait until the library is free again.
        fit.residuals()
        variables(fit)
        directions(fit)
        tiny_levers(fit)
        bayesian_information(run.session, run.number)
        run.session.diagnosed(run.number, diagnose(fit, tell))
