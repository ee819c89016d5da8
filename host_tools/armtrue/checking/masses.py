"""Masses and their centres that no link of the arm can have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from armtrue.checking.report import Finding
from armtrue.io.dataset import Dataset
from armtrue.io.robot import Robot

# A centre of mass lies in its link or an attached part: within the arm's reach and this margin [m].
_BEYOND_REACH_M = 1.0
_HEAVIEST_LINK_KG = 10_000.0
# A payload heavier than the arm is taken for grams above this; below, a link's mass may be the wrong one.
_LEAST_GRAMS = 100.0


def find(data: Dataset, robot: Robot) -> list[Finding]:
    """One error for each impossible mass or centre of mass, and a warning for a payload heavier than the arm."""
    return [*_of_links(robot), *_of_payload(data, robot)]


def _of_payload(data: Dataset, robot: Robot) -> Iterator[Finding]:
    moving = sum(link["mass"] for link in robot.spec.get("links", []))
    payload = data.columns.get("payload")
    if payload is None or moving <= 0.0 or float(payload.max()) <= moving:
        return
    at = int(payload.argmax())
    heaviest = float(payload[at])
    grams = " (this looks like grams)" if heaviest > _LEAST_GRAMS else ""
    yield Finding(
        "payload",
        "warning",
        f"{data.file.name} row {data.rows[at]} column payload: found {heaviest:.5g} kg, expected less than the arm's "
        f"own moving links, which weigh {moving:.4g} kg{grams}",
        {"row": int(data.rows[at]), "payload": heaviest, "moving_mass": moving},
        "Give payload its unit in dataset.yaml, as in 'payload: {column: payload, unit: g}', or correct the masses of "
        f"the links in {robot.kinematics_file}.",
    )


def _of_links(robot: Robot) -> Iterator[Finding]:
    furthest = robot.reach_m + _BEYOND_REACH_M
    named = "links" if robot.urdf is None else f"{robot.urdf.name}: links on joint"
    links = {f"{named}[{k}]": link for k, link in enumerate(robot.spec.get("links", []), start=1)}
    with_payload = {**links, "payload": robot.spec["payload"]} if "payload" in robot.spec else links
    for place, link in with_payload.items():
        if (away := math.hypot(*link["com"])) > furthest:
            found = f"a centre of mass {away:.4g} m from its frame, expected {furthest:.3g} m at most"
            yield _finding(f"{place}.com", away, found, "millimetres")
    for place, link in links.items():
        if (mass := link["mass"]) > _HEAVIEST_LINK_KG:
            found = f"a mass of {mass:.5g} kg, expected {_HEAVIEST_LINK_KG:.0f} kg at most"
            yield _finding(f"{place}.mass", mass, found, "grams")


def _finding(place: str, value: float, found: str, likely: str) -> Finding:
    return Finding(
        "masses",
        "error",
        f"{place}: found {found} (this looks like {likely})",
        {"place": place, "found": value},
        "Correct the masses in robot.yaml or the URDF, or leave them out: springs are then fitted without them.",
    )
