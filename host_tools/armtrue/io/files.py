"""Reading and writing whole files: every failure is an InputError of one sentence, and no file is half written."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from armtrue.errors import InputError

LARGEST_TEXT_BYTES = 64 * 1024 * 1024


def read_bytes(path: Path, largest_bytes: int = LARGEST_TEXT_BYTES) -> bytes:
    """Return the content of `path`, which may have at most `largest_bytes`.

    Errors: InputError when it is missing, a folder, larger or unreadable.
    """
    with reading(path):
        if path.is_dir():
            raise InputError(f"{path}: found a folder, expected a file")
        size = path.stat().st_size
        if size > largest_bytes:
            raise InputError(f"{path}: found {size} bytes, expected at most {largest_bytes}")
        with path.open("rb") as stream:
            # A device or a pipe reports no size: reading stops one byte beyond the limit.
            content = stream.read(largest_bytes + 1)
        if len(content) > largest_bytes:
            raise InputError(f"{path}: found no end, expected at most {largest_bytes} bytes")
    return content


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors of opening and reading `path` into InputError."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: found no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: found a name that no file can have") from None


def named_in(path: Path, name: str) -> Path:
    """The file `name` given in the file at `path`: relative to its folder, with ~ and $NAME expanded as by a shell."""
    named = Path(os.path.expandvars(name))
    # `~user` of a user unknown to this machine is kept as an ordinary name.
    with contextlib.suppress(RuntimeError):
        named = named.expanduser()
    return path.parent / named


def read_text(path: Path, encoding: str = "utf-8-sig", largest_bytes: int = LARGEST_TEXT_BYTES) -> str:
    """Return the text of `path`.

    Errors: InputError when it is missing, a folder, larger than `largest_bytes`, unreadable or not `encoding`.
    """
    try:
        return read_bytes(path, largest_bytes).decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: found byte 0x{error.object[error.start]:02x} at offset {error.start}, expected {encoding} text"
        ) from None


def read_json(path: Path, largest_bytes: int, expected: str) -> Any:
    """Return the content of the JSON file `path`.

    Errors: InputError as of `read_text`, and where the text is no JSON or has a number that cannot be read.
    """
    text = read_text(path, largest_bytes=largest_bytes)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: found text that is not JSON ({error}), expected {expected}") from None
    except ValueError:
        raise InputError(
            f"{path}: found a number of more digits than can be read, expected {expected}"
        ) from None
    except RecursionError:
        raise InputError(f"{path}: found brackets without end, expected {expected}") from None


def check_writable(path: Path) -> None:
    """Raise InputError if `path` cannot be written, for use before a long computation."""
    try:
        place = Path(os.path.realpath(path))
        if place.is_dir():
            raise InputError(f"{path}: found a folder, expected the name of a file to write")
        if not place.parent.is_dir():
            raise InputError(f"{path}: found no folder '{place.parent}' to write into")
        if _is_special(place):
            if not os.access(place, os.W_OK):
                raise InputError(f"{path}: found a device or pipe that may not be written to")
        elif not os.access(place.parent, os.W_OK):
            raise InputError(f"{path}: found a folder '{place.parent}' that may not be written into")
    except (OSError, ValueError):
        raise InputError(f"{str(path)!r}: found a name that no file can have") from None


def _is_special(path: Path) -> bool:
    """True for a device, pipe or socket, which is written to and never replaced."""
    return path.exists() and not path.is_file()


def refuse_to_lose(reads: Iterable[Path | None], writes: Iterable[Path | str | None]) -> None:
    """Raise InputError if a command `writes` a file that it also `reads`, or writes one file twice."""
    # An argument may also be a name that is no file, such as that of a shipped scenario.
    inputs = {_identity(path) for path in reads if path is not None and path.is_file()}
    outputs: set[str] = set()
    for name in writes:
        if name is None or name == "-" or os.path.realpath(name) == os.devnull:
            continue
        place = _identity(Path(name))
        if place in inputs:
            raise InputError(
                f"{name}: found the name of a file that is read, expected one to write beside it"
            )
        if place in outputs:
            raise InputError(f"{name}: found the name twice among the files to write, expected one for each")
        outputs.add(place)


def _identity(path: Path) -> str:
    """A name of the file for any path to it: device and inode if it exists, so that hard links count as one file."""
    try:
        found = path.stat()
        return f"{found.st_dev}:{found.st_ino}"
    except (OSError, ValueError):
        return os.path.realpath(os.fspath(path).replace("\0", ""))


def csv_text(names: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """A CSV of columns `names` and `rows` of cells."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows(rows)
    return text.getvalue()


def write_file(path: Path, content: str | bytes) -> None:
    """Write `content` beside `path`, then rename it onto `path`: a killed run leaves the old file whole.

    A link is followed; a device or pipe is written to and never replaced by a file.

    Errors: InputError when the folder is missing or may not be written.
    """
    check_writable(path)
    data = content.encode() if isinstance(content, str) else content
    place = Path(os.path.realpath(path))
    try:
        if _is_special(place):
            with place.open("wb", buffering=0) as stream:
                stream.write(data)
            return
        descriptor, beside = tempfile.mkstemp(prefix=f".{place.name[:100]}.", dir=place.parent)
        try:
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            mask = os.umask(0)
            os.umask(mask)
            Path(beside).chmod(0o666 & ~mask)
            Path(beside).replace(place)
        except BaseException:
            Path(beside).unlink()
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
