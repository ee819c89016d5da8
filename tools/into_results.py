"""Runs a benchmark, prints its output, and writes it into docs/results.md or docs/effects.md.

    into_results.py NAME COMMAND...

The output replaces the text between `<!-- NAME: begin -->` and `<!-- NAME: end -->` on the first page that has these
marks. The output of a command that failed or was killed is printed but not written.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = (DOCS / "results.md", DOCS / "effects.md")


def main() -> int:
    """Returns the command's status if it failed, 2 if no page has the marks, 1 if it printed nothing or was killed."""
    name, command = sys.argv[1], sys.argv[2:]
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = next((p for p in PAGES if p.exists() and {begin, end} <= set(p.read_text().splitlines())), None)
    if page is None:
        names = " nor ".join(str(p) for p in PAGES)
        print(f"into_results: neither {names} has lines '{begin}' and '{end}'", file=sys.stderr)
        return 2
    lines = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        for line in running.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    if running.returncode != 0:
        print(
            f"into_results: {command[0]} ended with status {running.returncode}, {page.name} stays",
            file=sys.stderr,
        )
        return 1 if running.returncode < 0 else running.returncode
    printed = "".join(lines).strip()
    if not printed:
        print(f"into_results: nothing came for {name}, {page.name} stays", file=sys.stderr)
        return 1
    text = page.read_text()
    before, after = text.split(begin)[0], text.split(end)[1]
    page.write_text(f"{before}{begin}\n{printed}\n{end}{after}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
