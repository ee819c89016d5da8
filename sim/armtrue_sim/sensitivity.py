"""Displacements of the tool by coefficients, at the exact arm, and the part that a model leaves unexplained.

Independent of the fitter's Jacobian on purpose: it decides which hidden effects are visible at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .arm import COORDINATES, Arm, Columns, Term
from .mechanics.expression import evaluate
from .mechanics.transforms import Array


def unit_term(coordinate: str, expression: str = "1", effect: str = "probe") -> Term:
    """A term for `sensitivity`, which differentiates by its coefficient."""
    return Term(effect, (), coordinate, expression, 0.0, "1")


def geometry_terms(arm: Arm) -> list[Term]:
    """Terms of a purely geometric model: base, tool, every joint zero, every link (redundant on purpose)."""
    terms = [unit_term(f"base.{c}") for c in COORDINATES] + [unit_term(f"tool.{c}") for c in COORDINATES[:3]]
    for k in range(1, arm.chain.n + 1):
        terms.append(unit_term(f"motor{k}"))
        terms += [unit_term(f"link{k}.{c}") for c in COORDINATES[:5]]
    return terms


def coordinate_sensitivity(arm: Arm, q: Array, columns: Columns) -> dict[str, Array]:
    """d position / d coordinate, (N, 3) by coordinate name, at the real arm: the geometric Jacobian's columns.

    A turn about an axis through o moves the tool p by axis x (p - o), a shift by its axis (Craig, section 5.8). First
    order in the arm's own errors (millimetres on a metre): the link's shift and a wrong linkage's slope are left out.
    """
    chain = arm.chain
    frames, tool_rotation, tool = arm.true_frames(q, columns)
    result: dict[str, Array] = {}

    def add(name: str, rotation: Array, origin: Array) -> None:
        for i, axis in enumerate("xyz"):
            direction = np.broadcast_to(rotation[..., :, i], tool.shape)
            result[f"{name}.t{axis}"] = direction
            result[f"{name}.r{axis}"] = np.cross(direction, tool - origin)

    add("base", np.eye(3), np.zeros(3))
    for k in range(chain.n):
        add(f"link{k + 1}", frames.rotation[k], frames.origin[k])
    add("tool", tool_rotation, tool)
    joint = np.stack(
        [result[f"link{k + 1}.{'tz' if chain.prismatic[k] else 'rz'}"] for k in range(chain.n)], axis=2
    )
    motor = joint @ chain.coupling
    result |= {f"motor{k + 1}": motor[:, :, k] for k in range(chain.n)}
    rotation = arm.measuring_from_base.rotation
    return {name: moved @ rotation.T for name, moved in result.items()}


def sensitivity(arm: Arm, q: Array, columns: Columns, terms: Sequence[Term]) -> Array:
    """d position / d coefficient of each term, (3N, m). q (N, n); columns as in `Arm.true_pose`."""
    state = arm.standing_state(q, columns)
    moved = coordinate_sensitivity(arm, q, columns)
    result = np.empty((len(state.q), 3, len(terms)))
    for j, term in enumerate(terms):
        value = np.broadcast_to(evaluate(term.expression, state), len(state.q))
        result[:, :, j] = value[:, None] * moved[term.coordinate]
    return result.reshape(-1, len(terms))


def orthonormal_range(columns: Array, relative: float = 1e-7) -> Array:
    """Orthonormal basis of the span of columns (M, m), scaled to unit norm; directions below `relative` are dropped."""
    norms = np.linalg.norm(columns, axis=0)
    kept = columns[:, norms > 0.0] / norms[norms > 0.0]
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    return u[:, s > relative * s[0]] if len(s) else np.empty((len(columns), 0))


def rms(displacement: Array) -> float:
    """Root of the mean squared length of displacements (N, 3)."""
    return float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))


def unexplained(displacement: Array, basis: Array) -> Array:
    """Residuals of displacements (N, 3) after the least-squares fit in an orthonormal `basis` (3N, r)."""
    flat = displacement.ravel()
    return (flat - basis @ (basis.T @ flat)).reshape(displacement.shape)
