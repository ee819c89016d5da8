"""Armtrue: fit a real arm, see where the model fails, compensate.

The whole path in a notebook:

    from armtrue import check, fit, load_data, load_model, load_robot

    robot = load_robot("robot.yaml")
    data = load_data("data.csv", robot)
    print(check(data, robot))
    result = fit(data, robot, load_model("model.yaml", robot))
    result.predict(load_data("poses.csv", robot, need_position=False))  # (N, 3), metres, measuring frame
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armtrue.checking import CheckReport, Finding, check
    from armtrue.diagnosis import Diagnosis, Refinement, diagnose, refine
    from armtrue.errors import InputError
    from armtrue.fitting import Fit, add, fit
    from armtrue.io import Dataset, Model, Robot, load_data, load_model, load_robot
    from armtrue.planning import Cell, Plan, plan, plan_campaign

# Imported at first use: `armtrue --help` should not wait for the numerical library.
_NAMES = {
    "checking": ("CheckReport", "Finding", "check"),
    "diagnosis": ("Diagnosis", "Refinement", "diagnose", "refine"),
    "errors": ("InputError",),
    "fitting": ("Fit", "add", "fit"),
    "io": ("Dataset", "Model", "Robot", "load_data", "load_model", "load_robot"),
    "planning": ("Cell", "Plan", "plan", "plan_campaign"),
}
_HOME = {name: f"armtrue.{module}" for module, names in _NAMES.items() for name in names}

__version__: str  # of the release, from the file VERSION; firmware and tables carry the same

__all__ = [
    "Cell",
    "CheckReport",
    "Dataset",
    "Diagnosis",
    "Finding",
    "Fit",
    "InputError",
    "Model",
    "Plan",
    "Refinement",
    "Robot",
    "__version__",
    "add",
    "check",
    "diagnose",
    "fit",
    "load_data",
    "load_model",
    "load_robot",
    "plan",
    "plan_campaign",
    "refine",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return Path(__file__).with_name("VERSION").read_text(encoding="ascii").strip()
    if name not in _HOME:
        raise AttributeError(f"module 'armtrue' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOME)
