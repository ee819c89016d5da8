"""The arm among its points before anything is fitted: a wrong sign or unit is an arm that does not reach them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armtrue.arrays import Array
from armtrue.checking.alignment import NOMINAL_ERROR_PER_REACH, align, alignment_columns, thinned
from armtrue.errors import InputError
from armtrue.io import Robot, load_data
from armtrue.report.markup import Markup, tag
from armtrue.report.pictures.effect_picture import corners, framed, path, projected
from armtrue.tables.chain import chain_from_robot, pose

_MOST = 120


def guess_picture(dataset: Path, robot: Robot) -> Markup | None:
    """Nominal arm, measured points, and a line from each to where the arm says it is; None where nothing aligns."""
    try:
        data = load_data(dataset, robot, strict=False)
        columns = thinned(alignment_columns(data), _MOST)
        aligned = align(columns, robot)
    except (InputError, ValueError):
        return None
    chain = chain_from_robot(robot.spec)
    joints = np.column_stack([columns[f"q{k}"] for k in range(1, chain.joint_count + 1)])
    base = pose(aligned.measuring_from_base)
    tool = pose(next(iter(aligned.flange_from_tool.values())))
    reached = chain.tool_poses(joints, tool)[:, :3, 3]
    measured = np.column_stack([columns[axis] for axis in "xyz"]) / (aligned.scale or 1.0)
    points = (measured - base[:3, 3]) @ base[:3, :3]
    middle = int(np.argmin(np.sum((joints - np.median(joints, axis=0)) ** 2, axis=1)))
    arm = np.vstack([corners(chain, joints[middle], {}), reached[middle]])
    drawn = projected([arm, points, reached])
    reaches = aligned.rms_m < NOMINAL_ERROR_PER_REACH * chain.reach_m
    words = (
        f"The nominal arm at one pose, {len(points)} measured points, and a line from each to where the arm would be: "
        f"{1e3 * aligned.rms_m:.1f} mm RMS. "
        f"The arm {'reaches' if reaches else 'does not reach'} its points."
    )
    return tag("figure", _svg(drawn, words), tag("figcaption", words))


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
