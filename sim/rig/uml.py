"""Run one command inside a User-Mode Linux that has vcan interfaces.

Debian's user-mode-linux is a Linux kernel built as an ordinary program. Its root is the host's own
file tree (hostfs), so the command finds the same checkout, the same .venv and the same build
folder, and what it writes is there afterwards. UML itself always exits 0: the command's status
comes back in a file, and a missing file is an error.

Its clock ticks at 100 Hz on one processor: nothing measured inside says anything about time.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from rig.buses import BUSES, FD_MTU, CanUnavailableError

KERNEL = "linux.uml"
MODULE_ROOT = Path("/usr/lib/uml/modules")
MODULES = ("can", "can-raw", "can-bcm", "can-gw", "vcan", "vxcan")
# What UML 6.1 cannot save of a processor's registers, and what to preload where a processor has it.
WIDE_REGISTERS = "amx_tile"
WIDE_REGISTERS_SOURCE = Path(__file__).with_name("wide_registers.c")
# Variables of the caller that mean something inside as well, beside ARMTRUE_*.
PASSED_ON = ("PATH", "PYTHONPATH", "HOME", "LANG", "TERM", "COLUMNS", "LINES", "CI")


def _module_files() -> list[Path]:
    """The module files in load order, dependencies first."""
    releases = sorted(MODULE_ROOT.glob("*/modules.dep"))
    if not releases:
        raise CanUnavailableError(
            f"{MODULE_ROOT} holds no kernel modules: install Debian's user-mode-linux, "
            f"or load the vcan module of this machine's own kernel"
        )
    listing = releases[-1]
    needs: dict[str, list[str]] = {}
    for line in listing.read_text().splitlines():
        file, _, dependencies = line.partition(":")
        needs[file] = dependencies.split()
    by_name = {Path(file).stem: file for file in needs}
    ordered: list[str] = []

    def add(file: str) -> None:
        for dependency in needs[file]:
            add(dependency)
        if file not in ordered:
            ordered.append(file)

    for name in MODULES:
        if name not in by_name:
            raise CanUnavailableError(
                f"{listing} lists no module {name}; expected Debian's user-mode-linux 6.1 or later"
            )
        add(by_name[name])
    return [listing.parent / file for file in ordered]


def _has_wide_registers() -> bool:
    """Whether this processor has AMX, whose registers UML 6.1 cannot restore."""
    return WIDE_REGISTERS in Path("/proc/cpuinfo").read_text().split()


def _host_environment(job: Path) -> dict[str, str] | None:
    """The environment that UML itself runs in, where it needs one unlike ours."""
    if not _has_wide_registers():
        return None
    library = job / "wide_registers.so"
    build = ["cc", "-O1", "-shared", "-fPIC", "-o", str(library), str(WIDE_REGISTERS_SOURCE)]
    try:
        done = subprocess.run(build, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise CanUnavailableError(
            f"this processor has {WIDE_REGISTERS}, for which {KERNEL} needs {WIDE_REGISTERS_SOURCE.name} "
            f"beside it, and there is no C compiler: install gcc"
        ) from None
    if done.returncode != 0:
        raise CanUnavailableError(f"{WIDE_REGISTERS_SOURCE} does not compile: {done.stderr.strip()}")
    return os.environ | {"LD_PRELOAD": str(library)}


_machines = itertools.count(os.getpid())


def _one_processor() -> str:
    """The number of a processor that we may run on: each machine gets the next one."""
    ours = sorted(os.sched_getaffinity(0))
    return str(ours[next(_machines) % len(ours)])


def _init_script(job: Path, command: Sequence[str], environment: Mapping[str, str], cwd: Path) -> str:
    """The first process inside: mounts, modules, buses, command, status, power off."""
    # What was written must be on the host, and what was printed must have left, before the status appears: the
    # machine is killed then. (Powering off prints a line of the kernel's.) stty drains the console.
    finish = (
        'finish() { echo "$1" > "$status.part"; sync; stty onlcr 2>/dev/null; mv "$status.part" "$status"; '
        "sleep 600; }"
    )
    lines = [
        "#!/bin/bash",
        "mount -t proc proc /proc",
        "mount -t sysfs sysfs /sys",
        "mount -t tmpfs tmpfs /dev/shm 2>/dev/null",
        "[ -e /dev/fd ] || ln -s /proc/self/fd /dev/fd",
        "stty -onlcr 2>/dev/null",
        f"exec 2>&1; status={shlex.quote(str(job / 'status'))}",
        finish,
        "ip link set lo up || finish 125",
    ]
    lines += [f"insmod {shlex.quote(str(file))} || finish 125" for file in _module_files()]
    for bus in BUSES:
        lines.append(
            f"ip link add dev {bus} type vcan && ip link set {bus} mtu {FD_MTU} txqueuelen 1000 up || finish 125"
        )
    lines += [f"export {name}={shlex.quote(value)}" for name, value in environment.items()]
    lines += [
        "export ARMTRUE_RIG=uml",
        f"cd {shlex.quote(str(cwd))} || finish 125",
        f"setsid {shlex.join(command)}",
        "finish $?",
    ]
    return "\n".join(lines) + "\n"


def run_in_uml(
    command: Sequence[str],
    timeout_s: float,
    environment: Mapping[str, str] | None = None,
    memory_mib: int = 768,
) -> int:
    """Boot, run `command` in the present directory, power off; its output goes to our stdout.

    Args:
      command: program and arguments, absolute or found on PATH.
      timeout_s: everything included; the machine is killed beyond it.
      environment: variables to set beside those of PASSED_ON.
      memory_mib: the machine's RAM.

    Returns the exit status of the command (125: the machine could not be set up).
    Raises CanUnavailableError if User-Mode Linux is not installed or died; TimeoutError.
    """
    kernel = shutil.which(KERNEL)
    if kernel is None:
        raise CanUnavailableError(
            f"this kernel has no AF_CAN and {KERNEL} is not on the PATH; install Debian's user-mode-linux"
        )
    passed = {k: v for k, v in os.environ.items() if k in PASSED_ON or k.startswith("ARMTRUE_")}
    if not sys.stdout.isatty():
        # The machine's console is a terminal to those inside, whatever it is written to out here.
        passed["TERM"] = "dumb"
    passed |= dict(environment or {})
    with tempfile.TemporaryDirectory(prefix="armtrue-rig-") as folder:
        job = Path(folder)
        init = job / "init.sh"
        init.write_text(_init_script(job, command, passed, Path.cwd()))
        init.chmod(0o755)
        arguments = [
            kernel, f"mem={memory_mib}M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "rw",
            f"init={init}", "con=null", "con0=null,fd:1", "quiet", "loglevel=1", f"uml_dir={job}/",
            "random.trust_cpu=on",
        ]  # fmt: skip
        # Every system call inside is handed from one process of UML to another and back, which is much quicker where
        # both run on the same processor.
        machine = subprocess.Popen(
            ["taskset", "--cpu-list", _one_processor(), *arguments],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env=_host_environment(job),
        )
        status = job / "status"
        give_up = time.monotonic() + timeout_s
        try:
            while machine.poll() is None and not status.exists():
                if time.monotonic() > give_up:
                    raise TimeoutError(
                        f"`{shlex.join(command)}` did not end within {timeout_s:g} s inside {KERNEL}"
                    )
                time.sleep(0.02)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(machine.pid, signal.SIGKILL)
            machine.wait()
        if not status.exists():
            raise CanUnavailableError(
                f"{KERNEL} ended without reporting a status (exit {machine.returncode})"
            )
        return int(status.read_text())
