import os
import subprocess
import sys
from pathlib import Path

import pytest

from armtrue.errors import InputError
from armtrue.io.files import check_writable, read_text, write_file


def test_text_is_written_as_utf8_with_ordinary_permissions(tmp_path):
    write_file(tmp_path / "a", "µ\n")
    assert (tmp_path / "a").read_bytes() == "µ\n".encode()
    (tmp_path / "b").touch()
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_an_interrupted_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    (tmp_path / "fit.json").write_text("old")

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_file(tmp_path / "fit.json", "new")
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "old"


def test_a_killed_write_leaves_the_old_file(tmp_path):
    """SIGKILL, which allows no clean-up, between the last byte written and the renaming."""
    (tmp_path / "fit.json").write_text("old")
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from armtrue.io.files import write_file\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write_file(Path(sys.argv[1]), 'new' * 100000)\n"
    )
    run = subprocess.run([sys.executable, "-c", program, str(tmp_path / "fit.json")], check=False)
    assert run.returncode == -9
    assert (tmp_path / "fit.json").read_text() == "old"


@pytest.mark.parametrize(("name", "words"), [("nowhere/a", "found no folder"), (".", "found a folder")])
def test_unwritable_path_is_refused_with_the_reason(tmp_path, name, words):
    with pytest.raises(InputError, match=words):
        check_writable(tmp_path / name)


def test_file_too_large_not_utf8_or_missing_is_refused(tmp_path):
    (tmp_path / "large").write_bytes(b"x" * 11)
    with pytest.raises(InputError, match="found 11 bytes, expected at most 10"):
        read_text(tmp_path / "large", largest_bytes=10)
    (tmp_path / "latin").write_bytes(b"\xb5m")
    with pytest.raises(InputError, match="found byte 0xb5 at offset 0"):
        read_text(tmp_path / "latin")
    with pytest.raises(InputError, match="no such file"):
        read_text(Path(tmp_path / "none"))
