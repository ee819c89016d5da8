"""A log of all frames on one bus, received and sent, in order of time."""

from __future__ import annotations

import copy
import re
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import can
from can.io import MESSAGE_WRITERS

from armtrue.errors import InputError
from armtrue.io.files import check_writable

# A timestamp that differs more from this machine's clock is of another one (some adapters count from their own start).
_SAME_CLOCK_S = 60.0


def channel_label(interface: str, channel: str) -> str:
    """The channel's name in a log: a word that ends in its number, as some log formats keep only the number."""
    if re.fullmatch(r"[A-Za-z]\w*", channel):
        return channel
    return interface + (channel if re.fullmatch(r"\d{1,3}", channel) else "0")


class Recording:
    """Context manager that writes beside the file, and at exit renames to it if `keep` was called, else deletes."""

    def __init__(self, file: Path, label: str) -> None:
        check_writable(file)
        self.frames = 0
        self._file, self._label = file, label
        self._keep = False
        self._ours: deque[can.Message] = deque()
        try:
            self._folder = Path(tempfile.mkdtemp(prefix=f".{file.name}.", dir=file.parent))
        except OSError as problem:
            raise InputError(f"{file}: cannot be recorded to ({problem.strerror})") from None
        self._beside = self._folder / file.name
        try:
            self._writer = can.Logger(str(self._beside))
        except Exception as problem:
            shutil.rmtree(self._folder)
            if file.suffix.lower() in (*MESSAGE_WRITERS, ".gz"):
                raise InputError(f"{file}: cannot be recorded to: {problem}") from None
            known = ", ".join(sorted(MESSAGE_WRITERS))
            raise InputError(
                f"{file}: found a name that ends in '{file.suffix}', expected one of {known}"
            ) from None

    def received(self, message: can.Message) -> None:
        """Write a received frame; a timestamp that is not of this machine's clock becomes the time of arrival."""
        now = time.time()
        if abs(message.timestamp - now) > _SAME_CLOCK_S:
            message.timestamp = now
        while self._ours and self._ours[0].timestamp <= message.timestamp:
            self._write(self._ours.popleft())
        self._write(message)

    def sent(self, message: can.Message, moment: float) -> None:
        """Queue a frame that this program sends at `moment`, a time of time.time()."""
        ours = copy.copy(message)
        ours.timestamp, ours.is_rx = moment, False
        self._ours.append(ours)

    def withdraw(self) -> None:
        """Remove the frame sent last: the bus did not accept it."""
        self._ours.pop()

    def settle(self) -> None:
        """Write the queued sent frames: no received frame is waiting, so all that follow are newer."""
        while self._ours:
            self._write(self._ours.popleft())

    def keep(self) -> None:
        """Keep the recording at exit, even after an error."""
        self._keep = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.settle()
            with self._one_sentence():
                self._writer.stop()
        finally:
            if self._keep:
                with self._one_sentence(f"; the recording is {self._beside}"):
                    self._beside.replace(self._file)
                    self._folder.rmdir()
            else:
                shutil.rmtree(self._folder)

    def _write(self, message: can.Message) -> None:
        message.channel = self._label
        with self._one_sentence():
            self._writer.on_message_received(message)
        self.frames += 1

    @contextmanager
    def _one_sentence(self, more: str = "") -> Iterator[None]:
        try:
            yield
        except OSError as failed:
            raise InputError(f"{self._file}: cannot be written ({failed.strerror}){more}") from None
