"""Small table images of every kind, the seeds of firmware/core/table/fuzz: `fuzz_corpus.py FOLDER` writes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "sim")]

import arms  # noqa: E402
from armtrue.tables import ExportOptions, export, fitted_arm  # noqa: E402

# Each makes another kind of record or node.
EXPRESSIONS = [
    "1", "q1", "th2*q1", "sin(q1)", "cos(3*q2)", "sin(q1 + 2*q2)", "sin(q1^2)", "abs(q1)", "sign(q2)*q2",
    "min(q1, q2)", "max(q1, -0.3)", "1/(q2 + 4)", "exp(-time/1800)", "dT", "payload*cos(q2)", "dir1", "tau2",
    "tau3*abs(tau3)/1000", "sqrt(1 + q1^2)",
]  # fmt: skip


def seeds() -> dict[str, bytes]:
    """Name and content: the flag byte of the harness, then an image."""
    result = {}
    for name in ("scara", "kr30", "stanford", "palletiser"):
        document = json.loads(arms.full_document(name))
        bare = {
            **document,
            "parameters": [p for p in document["parameters"] if p["effect"] != "transmission_pwl"],
        }
        for full_pose in (False, True):
            image = export(fitted_arm(bare, name), ExportOptions(full_pose=full_pose)).image
            result[f"{name}{'_pose' if full_pose else ''}"] = b"\x01" + image
    document = json.loads(arms.full_document("kr30"))
    document["parameters"] = [arms.parameter("motor2", text, 1e-6) for text in EXPRESSIONS]
    result["nodes"] = b"\x03" + export(fitted_arm(document, "nodes"), ExportOptions()).image
    document["parameters"] = []
    tables = arms.with_tables(document, spacing_rad=0.8, grid_nodes=2)
    result["tables"] = b"\x01" + export(fitted_arm(tables, "tables"), ExportOptions()).image
    signed = export(fitted_arm(document, "signed"), ExportOptions(secret_seed=bytes(range(32)))).image
    result["signed"] = b"\x00" + signed
    return result


def main() -> int:
    """Write the seeds into the folder that the command line names."""
    folder = Path(sys.argv[1])
    for name, content in seeds().items():
        (folder / name).write_bytes(content)
    return 0


if __name__ == "__main__":
    sys.exit(main())
