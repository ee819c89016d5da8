"""Poses and their reference corrections, for a C++ test: `reference_cases.py FOLDER` writes the files.

The reference is the exact inverse of the model in double precision (`armtrue.tables.Reference`), which shares no code
with the firmware. A file, little-endian: int32 length of the image, number of joints, of sensors and of cases; the
image; then for each case int64 target [2^-32 turn or metre] of every joint, int32 temperature difference of every
sensor, payload and time as `Surroundings` of firmware/core/evaluation/terms.h has them, int32 direction and reference
correction of every joint.
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "sim")]

import arms  # noqa: E402
from armtrue.tables import ExportOptions, FittedArm, Reference, export, fitted_arm  # noqa: E402
from armtrue.tables.reference import Surroundings  # noqa: E402
from fuzz_corpus import EXPRESSIONS  # noqa: E402

FOLDER = ROOT / "firmware/core/evaluation/reference"
CASES = 60
# Least singular value of the Jacobian, by the reach: nearer to singularities the joints say little about the tool.
REGULAR = 0.12
PAYLOAD_KG = 3.0
_UNIT = 2.0**32


def skewed(document: dict[str, Any]) -> dict[str, Any]:
    """The same arm with every second frame turned about all three axes; two motors drive other joints, too."""
    kinematics = document["robot"]["kinematics"]
    rows = []
    for k, row in enumerate(kinematics["joints"]):
        a, d, alpha = (row.get(name) or 0.0 for name in ("a", "d", "alpha"))
        xyz = [a, -d * np.sin(alpha), d * np.cos(alpha)]
        kept = {name: row[name] for name in ("name", "type", "offset", "gear_ratio", "limits")}
        rows.append(
            {**kept, "xyz": xyz, "rpy": [alpha, 0.2 - 0.1 * k, 0.15] if k % 2 == 0 else [alpha, 0.0, 0.0]}
        )
    coupling = [
        {"joint": joint, "driving": driving, "ratio": ratio}
        for joint, driving, ratio in ((3, 2, -1.0), (5, 4, 0.25), (6, 4, -0.125))
    ]
    frames = {**kinematics, "convention": "chain", "joints": rows}
    return {**document, "robot": {**document["robot"], "kinematics": frames, "coupling": coupling}}


def documents() -> dict[str, tuple[FittedArm, bool]]:
    """Arms with every effect that a small table has room for, and whether the attitude is held."""
    result = {}
    for name in ("kr30", "scara", "stanford"):
        document = json.loads(arms.full_document(name))
        document["parameters"] = [p for p in document["parameters"] if p["effect"] != "transmission_pwl"]
        result[name] = fitted_arm(document, name), False
        if name != "scara":  # four joints hold no attitude
            result[f"{name}_pose"] = fitted_arm(document, name), True
        if name == "kr30":
            result["at_command"] = fitted_arm({**document, "statics": "nominal"}, name), False
            result["skewed_pose"] = fitted_arm(skewed(document), "skewed"), True
    document = json.loads(arms.full_document("kr30"))
    document["parameters"] = []
    tables = arms.with_tables(document, spacing_rad=0.8, grid_nodes=2)
    result["tables"] = fitted_arm(tables, "tables"), False
    document["parameters"] = [
        arms.parameter(f"motor{1 + k % 6}", text, 1e-5) for k, text in enumerate(EXPRESSIONS)
    ]
    result["nodes"] = fitted_arm(document, "nodes"), False
    return result


def regular(arm: FittedArm, joints: np.ndarray, around: Surroundings, full_pose: bool) -> np.ndarray:
    """Whether each row is away from singularities."""
    jacobian = Reference(arm, "").real(joints, around)[1]
    rows = jacobian[:, :3]
    if full_pose:
        rows = np.concatenate([rows, 0.25 * arm.chain.reach_m * jacobian[:, 3:]], axis=1)
    least = np.linalg.svd(rows, compute_uv=False)[:, min(rows.shape[1:]) - 1]
    return np.asarray(least > REGULAR * arm.chain.reach_m)


def chosen(around: Surroundings, rows: np.ndarray) -> Surroundings:
    """The surroundings of some rows."""

    def pick(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[rows]

    temperature = {name: values[rows] for name, values in around.temperature.items()}
    return Surroundings(temperature, pick(around.payload), pick(around.time), pick(around.direction))


def file_of(arm: FittedArm, full_pose: bool) -> bytes:
    """Image and cases."""
    image = bytes(export(arm, ExportOptions(full_pose=full_pose)).image)
    rng = np.random.default_rng(3)
    joints = arms.random_joints(arm, 20 * CASES, rng)
    around = arms.random_surroundings(arm, 20 * CASES, rng, PAYLOAD_KG)
    unit = np.where(arm.chain.prismatic, 1.0, 1.0 / (2.0 * np.pi)) * _UNIT
    target = np.round(joints * unit).astype(np.int64)
    joints = target / unit
    rows = np.flatnonzero(regular(arm, joints, around, full_pose))[:CASES]
    assert len(rows) == CASES, f"{len(rows)} regular poses"
    around = chosen(around, rows)
    reference = Reference(arm, "")
    length = 0.25 * arm.chain.reach_m if full_pose else None
    right = reference.solve(joints[rows], around, length).joints
    correction = np.round(right * unit).astype(np.int64) - target[rows]
    n, sensors = arm.chain.joint_count, arm.chain.sensors
    head = struct.pack("<4i", len(image), n, len(sensors), CASES)
    body = b""
    for case, row in enumerate(rows):
        differences = [
            round((around.temperature[s][case] - arm.chain.temperature_reference) * 2**20) for s in sensors
        ]
        values = [
            *differences, round(float(around.payload[case]) * 2**20), round(float(around.time[case]) * 2**10),
            *np.sign(around.direction[case]).astype(int), *correction[case],
        ]  # fmt: skip
        body += struct.pack(f"<{n}q{len(values)}i", *target[row], *values)
    return head + image + body


def main() -> int:
    """Write the files into the folder that the command line names."""
    folder = Path(sys.argv[1])
    for name, (arm, full_pose) in documents().items():
        (folder / f"{name}.bin").write_bytes(file_of(arm, full_pose))
    return 0


if __name__ == "__main__":
    sys.exit(main())
