"""Every command with its inputs and options damaged: no traceback, no hang, no input changed, exit codes as documented.

    .venv/bin/python tests/fuzz/fuzz_commands.py --seconds 120 --seed 1

A trial begins with a call that works and damages one to three of its words or files. As root the runs have a mount
namespace with their own /dev: a command that replaces its output file would otherwise replace the machine's device.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import hashlib
import os
import random
import resource
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import click
import typer

EXIT_CODES = {0, 1, 2}
DEVICE_EXIT_CODES = EXIT_CODES | {3}  # nothing answers on the bus
HANG_SECONDS = 120
MEMORY_BYTES = 6 * 1024**3
CLONE_NEWNS = 0x00020000
DEVICES = {"null": (1, 3), "zero": (1, 5), "full": (1, 7), "random": (1, 8), "urandom": (1, 9)}

# Calls that work in the folder that `prepare` makes. {out}: a name that does not exist yet.
CALLS = """
check data.csv --robot robot.yaml --json {out}
fit data.csv --robot robot.yaml --model model.yaml --out {out} --folds 2 --seed 1 --skip-bad
add fit.json backlash --joints 2 --out {out} --json {out}.json
remove fit.json joint_scale --out {out}
predict fit.json test.csv --out {out}
compare fit.json test.csv --json {out} --skip-bad
diagnose fit.json --json {out}
report fit.json --out {out}
export fit.json --out {out} --max-rate 1 --max-correction 0.1 --damping 0.01 --dead-band 0 --sequence 3 --sign k1
tables info t.bin --json {out} --key k1.pub
compensate t.bin test.csv --out {out} --engine fixed
compensate t.bin test.csv --out {out} --engine double
keygen --out {out}
effects gear_mesh --json {out}
explain held out
init foreign.csv --robot robot.yaml --out {out} --force
plan --robot robot.yaml --model model.yaml --poses 8 --out {out}
simulate scenario.yaml --out {out}
device info --interface virtual --channel 0 --json {out}
upload t.bin --interface virtual --channel 0
"""
NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e300",
    "-1e300",
    "9" * 30,
    "7" * 6000,
    "0x10",
    "",
    " ",
    "1,5",
    "½",
]
WORDS = [
    "",
    "x",
    "-",
    "--",
    "'",
    "é" * 300,
    "a\nb",
    "..",
    "/",
    "[rad]",
    "{}",
    "gear_mesh",
    "1,2,3,4,5,6,7",
    "=",
    "a=b",
]
PATHS = [
    "no/such/file", ".", "/dev/null", "/dev/full", "/dev/zero", "/dev/urandom", "empty", "folder", "link.csv",
    "sparse", "data.csv", "fit.json", "t.bin", "robot.yaml", "model.yaml", "k1", "k1.pub", "test.csv", "foreign.csv",
    "\udcff", "long" * 100,
]  # fmt: skip
BYTES = [
    b"\0",
    b"\xff",
    b"nan",
    b"-1e308",
    b"9" * 400,
    b"&a [*a]",
    b'"',
    b",",
    b";",
    b"\t",
    b"\n",
    b"{",
    b"]",
    b": ",
    b"!!",
]


@dataclass
class Trial:
    """One call; `faults` is empty if it behaved as documented."""

    words: list[str]
    damaged: str
    faults: list[str] = field(default_factory=list)


def prepare(folder: Path) -> None:
    """Writes a small campaign, a fit of it, its tables and keys."""
    import armtrue_sim

    scenarios = Path(__file__).resolve().parents[2] / "sim/scenarios"
    armtrue_sim.cli_simulate(scenarios / "kr30-eccentric-gear.yaml", folder)
    shutil.copy(scenarios / "kr30-eccentric-gear.yaml", folder / "scenario.yaml")
    for name in ("data.csv", "test.csv"):
        lines = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join(lines[:61]) + "\n")
    effects = "[base_frame, tool_offset, joint_offset, joint_scale]"
    (folder / "model.yaml").write_text(f"effects: {effects}\n")
    (folder / "foreign.csv").write_text((folder / "data.csv").read_text().replace(",", ";").replace(".", ","))
    for call in (
        "fit data.csv --robot robot.yaml --model model.yaml --out fit.json",
        "keygen --out k1",
        "export fit.json --out t.bin",
    ):
        command = [sys.executable, "-m", "armtrue", *call.split()]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (folder / "empty").touch()
    (folder / "folder").mkdir()
    (folder / "link.csv").symlink_to("data.csv")
    with (folder / "sparse").open("wb") as stream:
        stream.truncate(20 * 1024**3)


def fingerprints(folder: Path) -> dict[str, str]:
    """Checksum of every file except the sparse one."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file() and path.name != "sparse":
            found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def own_devices() -> None:
    """A /dev of this process's own, in a mount namespace that ends with it. Only root needs it, and can have it."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNS) != 0:
        raise OSError(ctypes.get_errno(), "as root these runs need a mount namespace; unshare failed")
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", "/dev"], check=True)
    for name, (major, minor) in DEVICES.items():
        os.mknod(f"/dev/{name}", 0o666 | stat.S_IFCHR, os.makedev(major, minor))
    Path("/dev/shm").mkdir()


def damaged_call(chance: random.Random, folder: Path, commands: click.Group) -> Trial:
    """A working call with one to three words or files damaged."""
    words = shlex.split(chance.choice(CALLS.strip().splitlines()).format(out="made"))
    done = []
    files = {path.name for path in folder.iterdir() if path.is_file() and path.name != "sparse"}
    for _ in range(chance.randint(1, 3)):
        at = chance.randrange(1, len(words))
        what = chance.choice(["file", "number", "word", "path", "option", "drop", "twice", "swap"])
        if what == "file" and words[at] in files:
            done.append(f"{words[at]}: {damage_file(chance, folder / words[at])}")
        elif what == "option":
            words += [chance.choice(options_of(words, commands)), chance.choice(NUMBERS + WORDS + PATHS)]
        elif what == "drop":
            del words[at]
        elif what == "swap":
            words[at] = chance.choice(words[1:])
        elif what == "twice":
            words.append(words[at])
        else:
            words[at] = chance.choice({"number": NUMBERS, "word": WORDS}.get(what, PATHS))
        if len(words) < 2:
            break
    return Trial(words, "; ".join(done))


def options_of(words: list[str], commands: click.Group) -> list[str]:
    """Options of the command that `words` name; 'commission' and 'monitor' wait for a bus and are not called."""
    command: click.Command | None = commands
    for word in words:
        if not isinstance(command, click.Group):
            break
        command = command.commands.get(word)
    named = [option for parameter in (command.params if command else []) for option in parameter.opts]
    return [option for option in named if option.startswith("-")] or ["--help"]


def damage_file(chance: random.Random, path: Path) -> str:
    """Cuts, inserts, replaces, flips or repeats bytes of a file; returns the result's size and checksum as text."""
    content = bytearray(path.read_bytes())
    for _ in range(chance.choice([1, 1, 1, 5])):
        at = chance.randrange(len(content) + 1)
        kind = chance.choice(["cut", "insert", "replace", "flip", "repeat"])
        if kind == "cut":
            del content[at : at + chance.choice([1, 10, 10000])]
        elif kind == "insert":
            content[at:at] = chance.choice(BYTES)
        elif kind == "replace":
            piece = chance.choice(BYTES)
            content[at : at + len(piece)] = piece
        elif kind == "flip" and at < len(content):
            content[at] ^= 1 << chance.randrange(8)
        else:
            content[at:at] = content[max(0, at - 200) : at]
    path.write_bytes(content)
    return f"{len(content)} bytes, sha256 {hashlib.sha256(content).hexdigest()[:12]}"


def run(trial: Trial, folder: Path) -> None:
    """Runs the call in a child process and records its faults."""
    before = fingerprints(folder)
    said = folder.parent / "said"
    child = os.fork()
    if child == 0:
        become(trial.words, folder, said)
    status = wait(child)
    text = said.read_text(errors="replace")
    if status is None:
        trial.faults.append(f"hangs: no end within {HANG_SECONDS} s")
    elif status not in (DEVICE_EXIT_CODES if trial.words[0] in ("device", "upload") else EXIT_CODES):
        trial.faults.append(f"exit status {status}")
    if "Traceback" in text:
        trial.faults.append("traceback: " + text[-1500:])
    after = fingerprints(folder)
    changed = [name for name, content in before.items() if after.get(name) != content]
    allowed = written_in_place(trial.words, folder)
    trial.faults += [f"input changed: {name}" for name in changed if name not in allowed]
    if os.getuid() == 0:
        gone = [name for name in DEVICES if not Path(f"/dev/{name}").is_char_device()]
        trial.faults += [f"/dev/{name} is no device any more" for name in gone]


def written_in_place(words: list[str], folder: Path) -> set[str]:
    """Files that the call names as an output and not as an input: it may overwrite those."""
    named_as_output: set[str] = set()
    others: list[str] = []
    pending = ""
    for word in words:
        name, equals, value = word.partition("=")
        if pending:
            named_as_output.add(word)
            pending = ""
        elif word in ("--out", "-o", "--json", "--record"):
            pending = word
        elif equals and name in ("--out", "--json", "--record"):
            named_as_output.add(value)
        else:
            others.append(word)
    read = {(folder / word).resolve() for word in others if len(word) < 200}
    in_place = words[0] in ("add", "remove", "refine")
    outputs = {word for word in named_as_output if len(word) < 200}
    allowed = {word for word in outputs if in_place or (folder / word).resolve() not in read}
    beside = {f"{word}{suffix}" for word in allowed for suffix in (".fit.json", ".pub")}
    inside = [path for word in allowed for path in (folder / word).glob("*") if path.is_relative_to(folder)]
    under = {str(path.relative_to(folder)) for path in inside if path.resolve() not in read}
    # Another name of a file that is written changes with it.
    targets = {(folder / word).resolve() for word in allowed}
    aliases = {path.name for path in folder.iterdir() if path.resolve() in targets}
    return allowed | beside | aliases | (under if words[0] in ("init", "simulate") else set())


def become(words: list[str], folder: Path, said: Path) -> None:
    """The child: its own session, its own output, bounded memory, and then the command."""
    os.setsid()
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    out = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    nothing = os.open("/dev/null", os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(out, 1)
    os.dup2(out, 2)
    sys.argv = ["armtrue", *words]
    from armtrue.cli import main

    status = 1
    try:
        main()
        status = 0
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 0
    except BaseException:
        import traceback

        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        os._exit(status)


def wait(child: int) -> int | None:
    """Exit status, or a negative signal number; None if the child had to be killed."""
    end = time.monotonic() + HANG_SECONDS
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def main() -> int:
    """Runs trials until the time or their number is up; prints each fault with the command line that causes it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--trials", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    chance = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as made:
        good = Path(made) / "good"
        good.mkdir()
        prepare(good)
        if os.getuid() == 0:
            own_devices()
        from armtrue.cli.app import app

        commands = typer.main.get_command(app).whole()
        import armtrue.fitting  # noqa: F401 - what children share

        trials = faulty = 0
        end = time.monotonic() + given.seconds
        while trials < given.trials and time.monotonic() < end:
            folder = Path(made) / "trial"
            shutil.rmtree(folder, ignore_errors=True)
            subprocess.run(["cp", "-a", "--sparse=always", str(good), str(folder)], check=True)
            trial = damaged_call(chance, folder, commands)
            if len(trial.words) > 1:
                run(trial, folder)
            trials += 1
            for fault in trial.faults:
                faulty += 1
                print(
                    f"trial {trials}: armtrue {shlex.join(trial.words)!a} [{trial.damaged}]\n  {fault}",
                    flush=True,
                )
        print(f"{trials} trials, {faulty} faults")
        return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
