"""Readers of robot.yaml, model.yaml, measurements and dataset.yaml. They raise only `InputError`."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armtrue.io.dataset import Dataset, load_data
    from armtrue.io.model import Model, load_model
    from armtrue.io.robot import Robot, load_robot

# Imported at first use: `armtrue --help` reads no measurements.
_HOME = {
    "Dataset": "dataset",
    "Model": "model",
    "Robot": "robot",
    "load_data": "dataset",
    "load_model": "model",
    "load_robot": "robot",
}

__all__ = ["Dataset", "Model", "Robot", "load_data", "load_model", "load_robot"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'armtrue.io' has no attribute '{name}'")
    return getattr(importlib.import_module(f"armtrue.io.{_HOME[name]}"), name)
