"""state.json: the session as programs read it (the contract, Workbench)."""

from __future__ import annotations

from typing import Any

from armtrue.workbench.engine import Engine
from armtrue.workbench.session import Node

_NOTHING: dict[str, Any] = {
    "effects": [], "error": None, "noise_floor_um": None, "verdict": None, "candidates": [], "steps": [], "models": [],
}  # fmt: skip


def state(engine: Engine) -> dict[str, Any]:
    """The shown model with its diagnosis, and the steps to it.

    `busy`: an action runs. `diagnosing`: the diagnosis runs; until it has ended, verdict is null and candidates are
    empty.
    """
    now = {"status": engine.said, "failure": engine.failure, "busy": engine.task is not None}
    if not engine.is_open:
        return {**_NOTHING, **now}
    session = engine.session
    node = session.node
    known = session.diagnosis_of(node.number) or {"candidates": [], "error": {}}
    diagnosis = {key: value for key, value in known.items() if key != "spectra"}
    return {
        **diagnosis,
        "effects": node.effects,
        "error": {**node.error, **diagnosis["error"]},
        "noise_floor_um": node.noise_floor_um,
        "verdict": node.verdict,
        "steps": [_step(each) for each in session.path],
        "left_out": node.left_out,
        "left_out_error": node.left_out_error,
        "model": node.number,
        "models": [{"model": each.number, "parent": each.parent, **_step(each)} for each in session.nodes],
        **now,
        "diagnosing": engine.background.task is not None,
    }


def _step(node: Node) -> dict[str, Any]:
    keys = ("removed", "effects", "error", "noise_floor_um", "verdict", "name")
    added = node.added[0] if len(node.added) == 1 else node.added or None
    return {"added": added, **{key: getattr(node, key) for key in keys}}
