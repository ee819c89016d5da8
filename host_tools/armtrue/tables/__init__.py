"""Tables: the firmware's image of a fit. Written, read, signed, and run by both engines.

docs/table-format.md gives every bit. The steps: `fitted_arm` (the exported part of a fit) → `export` (compile,
limits, records) → image → `compensate` (fixed: the firmware's code; double: the fit's inverse).
"""

from armtrue.tables.export import Exported, ExportOptions, export
from armtrue.tables.fitted import FittedArm, fitted_arm
from armtrue.tables.fixed import FixedEngine, Verdict, validate
from armtrue.tables.reference import Reference, Surroundings

__all__ = [
    "ExportOptions",
    "Exported",
    "FittedArm",
    "FixedEngine",
    "Reference",
    "Surroundings",
    "Verdict",
    "export",
    "fitted_arm",
    "validate",
]
