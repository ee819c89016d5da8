"""Times `./dev demo` and `./dev test` in a fresh clone of HEAD on a bare Debian 12, and prints a table of each.

The bare Debian is debootstrap's minimal one in a folder, entered with chroot; added are only git and this machine's
settings for access to its package servers. Needs root.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEMO_S, TEST_S, TEST_AGAIN_S = 210, 720, 480
STEP = re.compile(r"^  (\d\d-\S+) (\d+) s, (\d+) s of processor$", re.MULTILINE)
MIRROR = "http://deb.debian.org/debian"
TO_THE_NETWORK = (
    *("/etc/apt/apt.conf.d", "/etc/apt/sources.list.d", "/etc/ssl/certs", "/usr/share/keyrings"),
    *("/etc/hosts", "/etc/pip.conf", "/etc/resolv.conf"),
)
# In a mount namespace of its own: what it mounts is gone when the command ends, and the folder can be removed.
ENTER = """
set -e
mount --rbind "$1" "$1"
mount -t proc proc "$1/proc"
mount --rbind /sys "$1/sys"
mount --rbind /dev "$1/dev"
[ ! -d "$2" ] || mount --bind "$2" "$1/root/shared"
exec chroot "$1" sh -c 'cd /root/armtrue && exec ./dev "$1"' sh "$3"
"""


def bare_debian(folder: Path) -> None:
    """Make `folder` a minimal Debian 12 with a clone, and real measurements where tests look for them."""
    command = [
        "debootstrap",
        "--variant=minbase",
        "--include=ca-certificates,git",
        "bookworm",
        folder,
        MIRROR,
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    ours = [path for path in TO_THE_NETWORK if Path(path).exists()]
    subprocess.run(["cp", "-rL", "--parents", "--remove-destination", *ours, folder], check=True)
    subprocess.run(["git", "clone", "-q", ROOT, folder / "root" / "armtrue"], check=True)
    (folder / "root" / "shared").mkdir()


def timed(folder: Path, command: str) -> tuple[float, str]:
    """Seconds that `./dev COMMAND` took there, and what it printed. Ends the program where it failed."""
    begin = time.monotonic()
    run = subprocess.run(
        ["unshare", "--mount", "sh", "-c", ENTER, "sh", folder, ROOT.parent / "shared", command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "CCACHE_DISABLE": "1", "HOME": "/root"},
    )
    took = time.monotonic() - begin
    if run.returncode != 0:
        print(run.stdout[-4000:], file=sys.stderr)
        sys.exit(f"from_a_clone: ./dev {command} ended with status {run.returncode}")
    return took, run.stdout


def main() -> None:
    """Print the tables."""
    print("| | goal [s] | took [s] |\n|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="armtrue-bare-") as name:
        bare_debian(Path(name))
        took, _ = timed(Path(name), "demo")
        print(f"| `./dev demo` | {DEMO_S} | {took:.0f} |", flush=True)
    with tempfile.TemporaryDirectory(prefix="armtrue-bare-") as name:
        bare_debian(Path(name))
        took, printed = timed(Path(name), "test")
        print(f"| `./dev test` | {TEST_S} | {took:.0f} |", flush=True)
        took, _ = timed(Path(name), "test")
        print(f"| `./dev test`, again | {TEST_AGAIN_S} | {took:.0f} |", flush=True)
    print("\n| step of `./dev test` | wall [s] | processor [s] |\n|---|---|---|")
    for step, wall, processor in STEP.findall(printed):
        print(f"| {step} | {wall} | {processor} |")


if __name__ == "__main__":
    main()
