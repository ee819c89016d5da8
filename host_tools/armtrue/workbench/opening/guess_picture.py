"""The nominal arm and the measured points before a fit: with a wrong sign or unit it does not reach them."""

from __future__ import annotations

import numpy as np

from armtrue.arrays import Array, rms_length
from armtrue.checking import Finding
from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, Columns, align, alignment_columns, thinned
from armtrue.checking.run import NO_ARM
from armtrue.errors import InputError
from armtrue.io import Dataset, Robot
from armtrue.io.columns import POSITION, commanded_joints
from armtrue.io.dataset import without_fixed_targets
from armtrue.report.markup import Markup, tag
from armtrue.report.pictures.effect_picture import corners, framed, path, projected
from armtrue.tables.chain import chain_from_robot, flanges, pose

_MOST = 120


def guess_picture(data: Dataset, robot: Robot, findings: list[Finding]) -> Markup | None:
    """Nominal arm, measured points as the file gives them, and a line from each to where the arm says it is.

    None where nothing aligns. `findings`: of the check of `data`, so that the caption does not contradict them.
    """
    try:
        riding = alignment_columns(without_fixed_targets(data))
        joints, points, reached = _lines(thinned(riding, _MOST), robot)
    except (InputError, ValueError):
        return None
    chain = chain_from_robot(robot.spec)
    middle = int(np.argmin(np.sum((joints - np.median(joints, axis=0)) ** 2, axis=1)))
    arm = np.vstack([corners(chain, joints[middle], {}), reached[middle]])
    lengths = np.linalg.norm(points - reached, axis=1)
    rms = rms_length(points - reached)
    words = (
        f"The nominal arm at one pose, {len(points)} measured points as the file gives them, and a line from each to "
        f"where the arm would be: {f'{rms:.1f} m' if rms >= 1.0 else f'{1e3 * rms:.1f} mm'} RMS. "
        f"{_verdict(lengths, chain.reach_m, findings)}"
    )
    return tag("figure", _svg(projected([arm, points, reached]), words), tag("figcaption", words))


def _lines(columns: Columns, robot: Robot) -> tuple[Array, Array, Array]:
    """Joints (N, n), measured points and where the arm would be, both (N, 3) [m] in the base's frame.

    Each set-up of the instrument is aligned separately, with an offset for each reflector. No scale is removed.
    """
    stations = columns.get("station", np.zeros(len(columns["x"])))
    parts = []
    for station in np.unique(stations):
        part = {name: c[stations == station] for name, c in columns.items() if name != "station"}
        target = np.unique(part.get("target", part["x"] * 0.0), return_inverse=True)[1].reshape(-1)
        aligned = align(part | {"target": target.astype(np.float64)}, robot)
        tools = np.array([tool["xyz"] for tool in aligned.flange_from_tool.values()])
        flange = flanges(part, robot.spec)
        reached = flange[:, :3, 3] + np.einsum("nij,nj->ni", flange[:, :3, :3], tools[target])
        base = pose(aligned.measuring_from_base)
        measured = np.column_stack([part[axis] for axis in POSITION])
        joints = np.column_stack([part[name] for name in commanded_joints(part)])
        parts.append((joints, (measured - base[:3, 3]) @ base[:3, :3], reached))
    joints, points, reached = (np.concatenate(each) for each in zip(*parts, strict=True))
    return joints, points, reached


def _verdict(lengths: Array, reach_m: float, findings: list[Finding]) -> str:
    far = int(np.count_nonzero(lengths > NOMINAL_ERROR_PER_REACH * reach_m))
    if 2 * far > len(lengths):
        return "The arm does not reach its points."
    if any(finding.code in NO_ARM for finding in findings):
        return "The check says what is wrong with the files as they stand."
    return "The arm reaches its points" + (f", all but {far} of them." if far else ".")


def _svg(drawn: list[Array], words: str) -> Markup:
    arm, points, reached = drawn
    lines = "".join(
        f"M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" for (x, y), (u, v) in zip(points, reached, strict=True)
    )
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
    return framed(
        words,
        tag("path", class_="arm", d=path(arm)),
        tag("path", class_="planned-arm", d=lines),
        tag("path", class_="dots strong-dots", d=dots),
    )
