"""Run bare-metal ARM images in QEMU: a recorded input in, the output and exact instruction counts back.

Images are built by the CMake presets `stm32f405`, `cortex-m7` and `r5f` (`build_images`). A test image talks
to the host by semihosting (`firmware/ports/arm/semihosting.h`): its command line names the host files that it
reads and writes (`run_image`). A product image talks on its serial ports (`board`) or on CAN
(`real_time_board`).
"""

from __future__ import annotations

import collections
import contextlib
import dataclasses
import json
import os
import pathlib
import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[1]


class QemuError(RuntimeError):
    """The emulator or the image in it did not do what was asked; the message holds what it printed."""


@dataclasses.dataclass(frozen=True)
class Run:
    """Result of one run of a test image: exit status, printed text, output file."""

    status: int
    printed: str
    output: bytes


def build_images(preset: str, *targets: str) -> pathlib.Path:
    """Configure and build a bare-metal preset; returns the folder with its ELF, BIN, HEX and map files."""
    folder = ROOT / "build" / preset
    if not (folder / "build.ninja").exists():
        subprocess.run(["cmake", "--preset", preset], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    command = ["cmake", "--build", str(folder), "-j", "2"]
    if targets:
        command += ["--target", *targets]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return folder / "images"


def _test_command(
    elf: pathlib.Path, machine: str, arguments: Sequence[str], extra: Sequence[str] = ()
) -> list[str]:
    semihosting = ",".join(["enable=on", "target=native", *(f"arg={argument}" for argument in arguments)])
    return [
        "qemu-system-arm", "-M", machine, "-kernel", str(elf), "-display", "none", "-monitor", "none",
        "-serial", "null", "-icount", "shift=0", "-semihosting-config", semihosting, *extra,
    ]  # fmt: skip


def run_image(
    elf: pathlib.Path,
    recorded: bytes = b"",
    *,
    machine: str = "netduinoplus2",
    timeout_s: float = 300.0,
    extra: Sequence[str] = (),
) -> Run:
    """Run a test image with `recorded` as its input file and return what it wrote to its output file.

    The image's command line is `INPUT OUTPUT`. One instruction takes one nanosecond of virtual time, so counts
    read by `InstructionCounter` are exact and repeatable.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, sink = pathlib.Path(folder, "in"), pathlib.Path(folder, "out")
        source.write_bytes(recorded)
        command = _test_command(elf, machine, [str(source), str(sink)], extra)
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, check=False)
        except subprocess.TimeoutExpired as error:
            raise QemuError(
                f"{elf.name} did not end within {timeout_s} s; it printed {error.stderr!r}"
            ) from error
        return Run(done.returncode, done.stderr, sink.read_bytes() if sink.exists() else b"")


def instructions_by_function(
    elf: pathlib.Path, recorded: bytes = b"", *, machine: str = "netduinoplus2", timeout_s: float = 300.0
) -> dict[str, int]:
    """Executed instructions per function (linker symbol) over a whole run of a test image, most first.

    Every instruction is logged (about 80 bytes each), so use a short input. This function shows where the
    instructions are spent; `InstructionCounter` counts them.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, sink, log = (pathlib.Path(folder, name) for name in ("in", "out", "log"))
        source.write_bytes(recorded)
        command = _test_command(elf, machine, [str(source), str(sink)])
        command += ["-singlestep", "-d", "exec,nochain", "-D", str(log)]
        subprocess.run(command, capture_output=True, timeout=timeout_s, check=False)
        counts: collections.Counter[str] = collections.Counter()
        with log.open(encoding="ascii", errors="replace") as lines:
            counts.update(line.rsplit(None, 1)[-1] for line in lines if line.startswith("Trace"))
    return dict(counts.most_common())


@dataclasses.dataclass(frozen=True)
class Board:
    """An emulated board that runs: its process, and the TCP port of each serial port in order."""

    process: subprocess.Popen[str]
    ports: tuple[int, ...]

    def slcan_url(self, serial: int = 0) -> str:
        """The python-can channel (`interface='slcan'`) of a serial port of the board."""
        return f"socket://127.0.0.1:{self.ports[serial]}"


@contextlib.contextmanager
def _ended_here(process: subprocess.Popen[str]) -> Iterator[None]:
    """End the emulator when the block ends; raise QemuError with its stderr if it had ended by itself."""
    try:
        yield
    finally:
        status = process.poll()
        process.kill()
        last_words = process.communicate()[1]
        if status is not None:
            raise QemuError(f"the emulator ended by itself, status {status}: {last_words}")


@contextlib.contextmanager
def board(
    elf: pathlib.Path, *, machine: str = "netduinoplus2", serial_ports: int = 2, extra: Sequence[str] = ()
) -> Iterator[Board]:
    """Run a product image that speaks SLCAN; each of its first serial ports is a TCP server on this machine.

    The image runs in real time (no instruction counting), answers on every port, and is ended when the block ends.
    """
    command = ["qemu-system-arm", "-M", machine, "-kernel", str(elf), "-display", "none", "-monitor", "none"]
    with contextlib.ExitStack() as ours:
        # The emulator inherits listening sockets: no other process can take a port, and clients need not wait for one.
        listeners = [ours.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(serial_ports)]
        ports = tuple(int(listener.getsockname()[1]) for listener in listeners)
        for number, listener in enumerate(listeners):
            command += [
                "-chardev",
                f"socket,id=serial{number},fd={listener.fileno()},server=on,wait=off,nodelay=on",
            ]
            command += ["-serial", f"chardev:serial{number}"]
        process = subprocess.Popen(
            [*command, *extra],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            pass_fds=[listener.fileno() for listener in listeners],
        )
    with _ended_here(process):
        for port in ports:
            _wait_for_slcan(port)
        yield Board(process, ports)


def _wait_for_slcan(port: int, timeout_s: float = 180.0) -> None:
    """Wait until the SLCAN adapter on a TCP port reports its version; a booting board drops what it receives."""
    with socket.create_connection(("127.0.0.1", port), timeout=0.5) as line:
        said = b""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if not said:
                line.sendall(b"V\r")
            with contextlib.suppress(TimeoutError):
                said += (heard := line.recv(256))
                if not heard:
                    break  # the emulator ended
                continue
            if said:
                return  # nothing more follows
    raise QemuError(f"the board did not answer on its serial port within {timeout_s} s; it said {said!r}")


class QemuMonitor:
    """QEMU's machine protocol (QMP) on a Unix socket."""

    def __init__(self, path: pathlib.Path, process: subprocess.Popen[str], timeout_s: float = 180.0) -> None:
        deadline = time.monotonic() + timeout_s
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(timeout_s)
        while True:
            try:
                self._socket.connect(str(path))
                break
            except OSError as error:
                if process.poll() is not None:
                    raise QemuError(f"the emulator ended: {process.communicate()[1]}") from error
                if time.monotonic() > deadline:
                    raise QemuError(f"the emulator opened no monitor within {timeout_s} s") from error
                time.sleep(0.05)
        self._process = process
        self._lines = self._socket.makefile("rw", encoding="utf-8")
        self._read_line()
        self.call("qmp_capabilities")

    def _read_line(self) -> str:
        try:
            line = self._lines.readline()
        except ConnectionError:
            line = ""
        if not line:
            raise QemuError(f"the emulator ended: {self._process.communicate()[1]}")
        return line

    def call(self, command: str, **arguments: Any) -> Any:
        """Execute one command; returns its result, raises QemuError with QEMU's message."""
        self._lines.write(json.dumps({"execute": command, "arguments": arguments}) + "\n")
        self._lines.flush()
        while True:
            answer = json.loads(self._read_line())
            if "error" in answer:
                raise QemuError(f"{command}: {answer['error']['desc']}")
            if "return" in answer:
                return answer["return"]

    def close(self) -> None:
        """Close the connection; the emulator keeps running."""
        self._lines.close()
        self._socket.close()


# A loop (wfi; b .-4) for the application cores: else they would execute the real-time core's image as their own.
_PARKED_AT = 0x07F00000
_PARKED_CODE = 0x17FFFFFF_D503207F

# In QEMU 7.2 the board's display port looks for a sound card. (QEMU 11.1 refuses an -audiodev that the machine
# does not name; in 7.2 the machine cannot name one.)
_SILENT = os.environ | {"QEMU_AUDIO_DRV": "none"}


@dataclasses.dataclass(frozen=True)
class WaysIn:
    """How often the image's CAN handlers ran since its start, by caller (`armtrue_ways_in`)."""

    can0_interrupts: int
    can1_interrupts: int
    polls: int


@dataclasses.dataclass(frozen=True)
class RealTimeBoard:
    """An emulated Zynq UltraScale+ whose first Cortex-R5F runs an image."""

    process: subprocess.Popen[str]
    monitor: QemuMonitor
    serial_log: pathlib.Path
    elf: pathlib.Path

    def ways_in(self) -> WaysIn:
        """Read the product image's counters out of its memory; the image does not notice."""
        command = ["arm-none-eabi-nm", str(self.elf)]
        symbols = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        found = re.search(r"^(\w+) \w armtrue_ways_in$", symbols, re.MULTILINE)
        if found is None:
            raise QemuError(f"{self.elf.name} has no symbol armtrue_ways_in")
        dump = self.monitor.call("human-monitor-command", **{"command-line": f"xp /3wx 0x{found[1]}"})
        return WaysIn(*(int(word, 16) for word in dump.partition(":")[2].split()))

    def wait_for_text(self, text: str, timeout_s: float = 180.0) -> str:
        """Everything printed on the UART so far, as soon as it contains `text`."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            printed = self.serial_log.read_bytes().decode("ascii") if self.serial_log.exists() else ""
            if text in printed:
                return printed
            if self.process.poll() is not None:
                raise QemuError(f"the emulator ended: {self.process.communicate()[1]}")
            time.sleep(0.05)
        raise QemuError(f"the image did not print {text!r} within {timeout_s} s")


@contextlib.contextmanager
def real_time_board(elf: pathlib.Path, buses: Sequence[str] = ()) -> Iterator[RealTimeBoard]:
    """Run an image on a Cortex-R5F of the emulated Zynq UltraScale+.

    `buses`: SocketCAN interfaces tied to its CAN controllers, in order (CAN0, CAN1); none is needed to boot.
    The core is powered off after reset, as in the hardware: the monitor switches it on.
    """
    with tempfile.TemporaryDirectory(prefix="armtrue-qemu-") as folder:
        monitor_path, serial_log = pathlib.Path(folder, "qmp"), pathlib.Path(folder, "uart")
        machine = "xlnx-zcu102" + "".join(f",canbus{i}=canbus{i}" for i in range(len(buses)))
        command = ["qemu-system-aarch64", "-M", machine, "-smp", "6", "-m", "128M", "-display", "none", "-S"]
        command += ["-accel", "tcg,tb-size=32"]  # MiB; inside User-Mode Linux memory is short
        for i, bus in enumerate(buses):
            command += ["-object", f"can-bus,id=canbus{i}"]
            command += ["-object", f"can-host-socketcan,id=socketcan{i},if={bus},canbus=canbus{i}"]
        command += ["-serial", f"file:{serial_log}", "-monitor", "none"]
        command += ["-qmp", f"unix:{monitor_path},server=on,wait=off"]
        command += ["-device", f"loader,addr={_PARKED_AT},data={_PARKED_CODE},data-len=8"]
        command += ["-device", f"loader,addr={_PARKED_AT},cpu-num=0"]
        command += ["-device", f"loader,file={elf},cpu-num=4"]
        process = subprocess.Popen(
            command, env=_SILENT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        with _ended_here(process):
            monitor = QemuMonitor(monitor_path, process)
            core = "/machine/soc/rpu-cluster/rpu-cpu[0]"
            monitor.call("qom-set", path=core, property="start-powered-off", value=False)
            monitor.call("system_reset")
            monitor.call("cont")
            yield RealTimeBoard(process, monitor, serial_log, elf)
            monitor.close()
