"""What `armtrue[workbench]` installs beyond the tool: its packages, and its own files. For docs/results.md.

`./dev bench workbench` runs it.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OWN = ROOT / "host_tools" / "armtrue" / "workbench"


def main() -> None:
    """Print the table."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    packages = project["optional-dependencies"]["workbench"]
    files = [
        f for f in OWN.rglob("*") if f.suffix in (".py", ".js", ".css") and not f.name.startswith("test_")
    ]
    size = sum(file.stat().st_size for file in files) / 1e6
    print("| further packages of `armtrue[workbench]` | its own files [MB] |")
    print("|---|---|")
    print(f"| {', '.join(packages) or 'none'} | {size:.2f} |")


if __name__ == "__main__":
    main()
