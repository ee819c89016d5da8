"""One workbench at a time on a session: a lock on its folder, which ends with the process that holds it."""

from __future__ import annotations

import fcntl
import os
from dataclasses import dataclass, field
from pathlib import Path

from armtrue.errors import InputError

_LONGEST = 200  # bytes of a lock: the process and the address


class HeldElsewhereError(InputError):
    """Another workbench has the folder open."""


@dataclass
class SessionLocks:
    """The folders of sessions that one workbench has open. `address`: that of its page, for those that come later."""

    address: str = ""
    _files: dict[Path, int] = field(default_factory=dict)

    def hold(self, folder: Path) -> None:
        """Lock `folder` against other workbenches.

        Errors: HeldElsewhereError where one has it open; InputError where it cannot be written.
        """
        if folder in self._files:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder, _, address = os.read(file, _LONGEST).decode(errors="replace").strip().partition(" ")
            os.close(file)
            raise HeldElsewhereError(
                f"{folder}: found this session open in another workbench (process {holder or 'unknown'}), expected one "
                f"at a time: continue on its page{f' {address}' if address else ''}, end it with Ctrl-C, or keep this "
                "one elsewhere with --session FOLDER"
            ) from None
        except OSError:
            pass  # a file system without locks
        os.ftruncate(file, 0)
        os.write(file, f"{os.getpid()} {self.address}".encode())
        self._files[folder] = file

    def keep(self, folders: set[Path]) -> None:
        """Release the locks of all folders but `folders`."""
        for folder in set(self._files) - folders:
            os.close(self._files.pop(folder))
