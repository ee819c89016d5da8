"""Columns `dir` that are shifted by one row or have wrong signs, found from the order of the rows."""

from __future__ import annotations

from armtrue.checking.report import Finding
from armtrue.io.columns import span
from armtrue.io.dataset import Dataset
from armtrue.io.ways import agreements

# By chance, half of all motions agree. An arm that went straight from pose to pose agrees except for a few
# interruptions; an arm that passed other points can have any share, which shows nothing.
_AGREES = 0.98
_DISAGREES = 0.9
_WORDS = {
    "one row late": "moved up by one row",
    "one row early": "moved down by one row",
    "reversed": "taken with the opposite sign",
    "0 for −1": "0 stands for −1",
    "1 for −1, 0 for 1": "1 stands for −1 and 0 for 1",
}
# Entries of dataset.yaml that convert the column to −1 and 1.
_SCALES = {
    "reversed": "scale: -1",
    "0 for −1": "scale: 2, offset: -1",
    "1 for −1, 0 for 1": "scale: -2, offset: 1",
}


def find(data: Dataset) -> list[Finding]:
    """A warning for each change (shift, sign or coding) that makes contradictory directions agree with the motions."""
    shares = agreements(data.columns)
    return [
        _finding(data, joints, way, words, shares)
        for way, words in _WORDS.items()
        if (joints := _joints_read_better(shares, way))
    ]


def are_zero_or_one(data: Dataset) -> set[int]:
    """Joints whose `dir` has 0 and 1 for the two directions."""
    shares = agreements(data.columns)
    return {k for way in _WORDS if way.startswith(("0", "1")) for k in _joints_read_better(shares, way)}


def _joints_read_better(shares: dict[int, dict[str, float]], way: str) -> list[int]:
    return [
        k
        for k, of_joint in shares.items()
        if of_joint["as it stands"] < _DISAGREES
        and of_joint.get(way, 0.0) >= _AGREES
        and of_joint[way] == max(of_joint.values())
    ]


def _finding(
    data: Dataset, joints: list[int], way: str, words: str, shares: dict[int, dict[str, float]]
) -> Finding:
    now = max(shares[k]["as it stands"] for k in joints)
    then = min(shares[k][way] for k in joints)
    columns = span("dir", joints)
    mend = f"Correct {columns} in the file"
    if way in _SCALES:
        example = f"dir{joints[0]}: {{column: dir{joints[0]}, {_SCALES[way]}}}"
        mend = f"Give {columns} '{_SCALES[way]}' in a dataset.yaml, as in '{example}'"
    return Finding(
        "directions_off",
        "warning",
        f"{data.file.name}: {columns}: found agreement with the motion from the previous row in {now:.0%} of the "
        f"motions, and in {then:.0%} if {words}",
        {"joints": joints, "way": way, "share": now, "share_if_changed": then},
        f"{mend}, or take the directions from the order of the rows: 'derive: {{dir: from_order}}' in a dataset.yaml. "
        "With wrong directions, effects such as backlash are not found.",
    )
