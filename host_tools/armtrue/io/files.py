"""Reading and writing whole files: one clear sentence when it cannot be done, never half a file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from armtrue.errors import InputError

LARGEST_TEXT_BYTES = 64 * 1024 * 1024


def read_text(path: Path, encoding: str = "utf-8-sig", largest_bytes: int = LARGEST_TEXT_BYTES) -> str:
    """Return the text of `path`.

    Errors: InputError when it is missing, a folder, larger than `largest_bytes`, unreadable or not `encoding`.
    """
    if path.is_dir():
        raise InputError(f"{path}: found a folder, expected a file")
    try:
        size = path.stat().st_size
        if size > largest_bytes:
            raise InputError(f"{path}: found {size} bytes, expected at most {largest_bytes}")
        return path.read_bytes().decode(encoding)
    except FileNotFoundError:
        raise InputError(f"{path}: found no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: found byte 0x{error.object[error.start]:02x} at offset {error.start}, expected {encoding} text"
        ) from None


def check_writable(path: Path) -> None:
    """Raise InputError where `path` cannot be written, so that a long computation need not end in that news."""
    if path.is_dir():
        raise InputError(f"{path}: found a folder, expected the name of a file to write")
    if not path.parent.is_dir():
        raise InputError(f"{path}: found no folder '{path.parent}' to write into")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: found a folder '{path.parent}' that may not be written into")


def refuse_to_lose(reads: Iterable[Path | None], writes: Iterable[Path | str | None]) -> None:
    """Raise InputError where one of the files that a command `writes` is one that it `reads`, or is named twice."""
    inputs = {path.resolve() for path in reads if path is not None}
    outputs: set[Path] = set()
    for name in writes:
        if name is None or name == "-":
            continue
        place = Path(name).resolve()
        if place in inputs:
            raise InputError(
                f"{name}: found the name of a file that is read, expected one to write beside it"
            )
        if place in outputs:
            raise InputError(f"{name}: found the name twice among the files to write, expected one for each")
        outputs.add(place)


def write_file(path: Path, content: str | bytes) -> None:
    """Write `content` beside `path`, then rename it onto `path`: a killed run leaves the old file whole.

    Errors: InputError when the folder is missing or may not be written.
    """
    check_writable(path)
    data = content.encode() if isinstance(content, str) else content
    try:
        descriptor, beside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            Path(beside).chmod(0o666 & ~_umask())
            Path(beside).replace(path)
        except BaseException:
            Path(beside).unlink()
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
