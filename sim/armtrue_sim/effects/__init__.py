"""True errors of every effect of the contract's catalogue: one function per effect, sizes drawn or given."""

from . import (  # noqa: F401  (each registers its effects)
    elastic,
    gears,
    geometry,
    grid,
    instrument,
    measurement,
    thermal,
)
from .base import EFFECTS, EffectContext, EffectTruth, build_effect, default_joints
from .gears import mesh_orders

__all__ = ["EFFECTS", "EffectContext", "EffectTruth", "build_effect", "default_joints", "mesh_orders"]
