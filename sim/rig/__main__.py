"""python -m rig [--timeout SECONDS] -- COMMAND…"""

from __future__ import annotations

import argparse
import sys

from rig import CanUnavailableError, run_on_bus


def main() -> int:
    """Run the command line; exit status is the command's own, 125 if there is no bus, 124 on time-out."""
    parser = argparse.ArgumentParser(prog="rig", description="Run a command where vcan0 and vcan1 exist.")
    parser.add_argument("--timeout", type=float, default=600.0, metavar="SECONDS")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args()
    command = arguments.command[1:] if arguments.command[:1] == ["--"] else arguments.command
    if not command:
        parser.error("a command is needed after --")
    try:
        return run_on_bus(command, arguments.timeout)
    except CanUnavailableError as problem:
        print(f"rig: {problem}", file=sys.stderr)
        return 125
    except TimeoutError as problem:
        print(f"rig: {problem}", file=sys.stderr)
        return 124


if __name__ == "__main__":
    sys.exit(main())
