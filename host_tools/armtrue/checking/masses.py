"""Masses and their centres that no link of the arm can have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from armtrue.checking.report import Finding
from armtrue.io.robot import Robot

# A centre of mass lies in its link or what hangs on it; an arm's own reach leaves room for both [m].
_BEYOND_REACH_M = 1.0
_HEAVIEST_LINK_KG = 10_000.0


def find(robot: Robot) -> list[Finding]:
    """One error for each mass or centre of mass that cannot be."""
    return list(_of_links(robot))


def _of_links(robot: Robot) -> Iterator[Finding]:
    furthest = robot.reach_m + _BEYOND_REACH_M
    centres = [
        (f"links[{k}].com", link["com"]) for k, link in enumerate(robot.spec.get("links", []), start=1)
    ]
    if "payload" in robot.spec:
        centres.append(("payload.com", robot.spec["payload"]["com"]))
    for place, centre in centres:
        away = math.hypot(*centre)
        if away > furthest:
            yield _finding(
                place,
                away,
                f"a centre of mass {away:.4g} m from its frame",
                f"{furthest:.3g} m at most",
                "millimetres",
            )
    for k, link in enumerate(robot.spec.get("links", []), start=1):
        if link["mass"] > _HEAVIEST_LINK_KG:
            found = f"a mass of {link['mass']:.5g} kg"
            yield _finding(
                f"links[{k}].mass", link["mass"], found, f"{_HEAVIEST_LINK_KG:.0f} kg at most", "grams"
            )


def _finding(place: str, value: float, found: str, expected: str, likely: str) -> Finding:
    return Finding(
        "masses",
        "error",
        f"{place}: found {found}, expected {expected} (this looks like {likely})",
        {"place": place, "found": value},
        "Correct the masses in robot.yaml or the URDF, or leave them out: springs are then fitted without them.",
    )
