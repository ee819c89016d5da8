"""The diagnosis of the model that is looked at, worked out in the background: the page shows its figures meanwhile."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass

from armtrue.diagnosis import diagnose
from armtrue.errors import InputError
from armtrue.report.state import directions, tiny_levers, variables
from armtrue.workbench.beside import bayesian_information
from armtrue.workbench.session import Session

FAULT = "A fault of the workbench: the session is as it was before. The terminal says more."
_NICE = 10


class CancelledError(Exception):
    """The person stopped what ran, or began something else."""


@dataclass
class Task:
    """What is running: its name, the share done, and what that is in words."""

    name: str
    share: float = 0.0
    stage: str = ""


class Background:
    """At most one diagnosis at a time. `task`: what runs now; `failure`: why the last one ended without a result."""

    def __init__(self, changed: Callable[[], None]) -> None:
        self.task: Task | None = None
        self.failure = ""
        self._changed = changed
        self._cancel = threading.Event()
        self._worker: threading.Thread | None = None
        self._stopped: tuple[str, int] | None = None

    def start(self, session: Session, politely: bool) -> None:
        """Begin to diagnose the model that is looked at, unless that is known or the person stopped it before.

        `politely`: the page and the fits go first.
        """
        number = session.at
        if self.task is not None or session.is_diagnosed(number) or self._stopped == (session.key, number):
            return
        self._cancel.clear()
        self.failure = ""
        self.task = Task("diagnose", stage="begins")
        self._worker = threading.Thread(
            target=self._run, args=(session, number, politely), name="workbench diagnose", daemon=True
        )
        self._worker.start()

    def wait(self, seconds: float) -> None:
        """Wait until the diagnosis has ended, or so long."""
        if self._worker is not None:
            self._worker.join(seconds)

    def stop(self) -> None:
        """End the diagnosis and return when it has ended: it may begin anew later."""
        self._cancel.set()
        if self._worker is not None:
            self._worker.join()

    def stop_for_good(self, session: Session) -> None:
        """End the diagnosis as the person asked, so that it does not begin by itself."""
        self._stopped = (session.key, session.at)
        self._cancel.set()

    def allow(self) -> None:
        """Let what was stopped begin again."""
        self._stopped = None

    def _run(self, session: Session, number: int, politely: bool) -> None:
        if politely and sys.platform == "linux":
            # The library's threads inherit this one's priority.
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        try:
            fit = session.fit_of(number)
            # What charts read is kept with the fit: they need not wait until the library is free again.
            fit.residuals()
            variables(fit)
            directions(fit)
            tiny_levers(fit)
            bayesian_information(session, number)
            session.diagnosed(number, diagnose(fit, self._tell))
        except CancelledError:
            pass
        except InputError as error:
            self.failure = str(error)
        except Exception:
            logging.getLogger(__name__).exception("a diagnosis failed")
            self.failure = FAULT
        finally:
            self.task = None
            self._changed()

    def _tell(self, share: float, stage: str) -> None:
        if self._cancel.is_set():
            raise CancelledError
        if self.task is not None:
            self.task.share, self.task.stage = share, stage
        self._changed()
