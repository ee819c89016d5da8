"""Shows what a benchmark prints, and keeps it in docs/results.md between `<!-- NAME: begin -->` and `... end -->`."""

from __future__ import annotations

import sys
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[1] / "docs" / "results.md"


def main() -> int:
    """Pass standard input on; 2 where the page has no such marks, 1 where nothing came."""
    name, lines = sys.argv[1], []
    for line in sys.stdin:
        print(line, end="", flush=True)
        lines.append(line)
    printed = "".join(lines).strip()
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = RESULTS.read_text()
    if begin not in text or end not in text:
        print(f"into_results: {RESULTS} has no marks '{begin}' and '{end}'", file=sys.stderr)
        return 2
    if not printed:
        print(f"into_results: nothing came for {name}, {RESULTS.name} stays", file=sys.stderr)
        return 1
    before, after = text.split(begin)[0], text.split(end)[1]
    RESULTS.write_text(f"{before}{begin}\n{printed}\n{end}{after}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
